//! Copies of voxel boxes: from a decoded core into its shell, from core and shells into a padded brick.
//!
//! The cost is memory traffic. Copies of the usual lengths (an apron's width, a core's row) cost no call, and voxels on one cache
//! line are copied together.

use crate::layout::Layout;
use crate::neighbourhood::{Part, Span};
use brickyard_volume::{Apron, VoxelBox};

/// Calls a function with the widths of an apron and a core in bytes, constants if usual.
macro_rules! with_widths {
    ($function:ident($apron:expr, $core:expr, $($argument:expr),*)) => {
        match ($apron, $core) {
            (1, 64) => $function(1, 64, $($argument),*),
            (2, 64) => $function(2, 64, $($argument),*),
            (2, 128) => $function(2, 128, $($argument),*),
            (4, 128) => $function(4, 128, $($argument),*),
            (4, 256) => $function(4, 256, $($argument),*),
            (8, 256) => $function(8, 256, $($argument),*),
            (apron, core) => $function(apron, core, $($argument),*),
        }
    };
}

/// Copies a core's six slabs into its shell (see [`layout`](crate::layout)): those of the low and the high x face, then y, then z.
pub(crate) fn copy_shell(layout: &Layout, core: &[u8], shell: &mut [u8]) {
    let (apron, row) = (layout.apron * layout.voxel_bytes, layout.edge * layout.voxel_bytes);
    let (rows, slice, slab) = (layout.apron * row, layout.edge * row, layout.slab_bytes());
    let (x_slabs, rest) = shell.split_at_mut(2 * slab);
    let (y_slabs, z_slabs) = rest.split_at_mut(2 * slab);
    let [(x_low, x_high), (y_low, y_high), (z_low, z_high)] = [x_slabs, y_slabs, z_slabs].map(|s| s.split_at_mut(slab));
    let sides = x_low.chunks_exact_mut(rows).zip(x_high.chunks_exact_mut(rows));
    let fronts = y_low.chunks_exact_mut(rows).zip(y_high.chunks_exact_mut(rows));
    // From the end: the last decoded voxels are still nearest to the processor.
    for ((codes, (x_low, x_high)), (y_low, y_high)) in core.chunks_exact(slice).zip(sides).zip(fronts).rev() {
        with_widths!(copy_row_ends(apron, row, codes, x_low, x_high));
        y_low.copy_from_slice(&codes[..rows]);
        y_high.copy_from_slice(&codes[slice - rows..]);
    }
    z_low.copy_from_slice(&core[..slab]);
    z_high.copy_from_slice(&core[core.len() - slab..]);
}

#[inline(always)]
fn copy_row_ends(apron: usize, row: usize, rows: &[u8], low: &mut [u8], high: &mut [u8]) {
    let ends = low.chunks_exact_mut(apron).zip(high.chunks_exact_mut(apron));
    for (codes, (low, high)) in rows.chunks_exact(row).zip(ends) {
        low.copy_from_slice(&codes[..apron]);
        high.copy_from_slice(&codes[row - apron..]);
    }
}

/// Copies a stored apron, possibly wider than needed, around the core of a padded brick.
pub(crate) fn paste_apron(layout: &Layout, codes: &[u8], out: &mut [u8]) {
    let mut codes = codes;
    let stored = layout.stored_apron();
    let wanted = Apron { width: layout.apron as u32, ..stored };
    for (from, to) in stored.slabs().into_iter().zip(wanted.slabs()) {
        let (slab, rest) = codes.split_at(from.extent().volume() as usize * layout.voxel_bytes);
        codes = rest;
        paste(layout, [None, Some(Block::of_slab(layout, slab, from, to)), None], out);
    }
}

/// Codes of a part of a padded brick, and their target. In bytes, except the counts of rows and slices.
pub(crate) struct Block<'a> {
    /// Starting with the first code to copy.
    codes: &'a [u8],
    /// From one row to the next, and from one slice to the next.
    row: usize,
    slice: usize,
    /// Place of the first code in the padded brick.
    to: usize,
    /// Bytes copied of each row.
    run: usize,
    rows: usize,
    slices: usize,
}

impl<'a> Block<'a> {
    /// Block of a part with these spans. `codes` is the core for the brick's own part, else the lender's shell.
    pub(crate) fn new(layout: &Layout, part: Part, mut codes: &'a [u8], [x, y, z]: [Span; 3]) -> Self {
        let (mut from, mut size) = ([x.from, y.from, z.from], [layout.edge; 3]);
        if let Some(axis) = (0..3).find(|&a| part.side[a] != 1) {
            // A lender before lends its high side, which lies after its low side.
            let slab = 2 * axis + (part.side[axis] == 0) as usize;
            codes = &codes[slab * layout.slab_bytes()..][..layout.slab_bytes()];
            (from[axis], size[axis]) = (0, layout.apron);
        }
        Self::of_box(layout, codes, size, from, [x.to, y.to, z.to], [x.len, y.len, z.len])
    }

    /// The part of a stored apron's slab `from`, possibly wider, for the slab `to` of a padded brick.
    fn of_slab(layout: &Layout, codes: &'a [u8], from: VoxelBox, to: VoxelBox) -> Self {
        let of = |numbers: [u32; 3]| numbers.map(|n| n as usize);
        let (from_min, to_min, size) = (of(from.min.to_array()), of(to.min.to_array()), of(from.extent().to_array()));
        let first = std::array::from_fn(|a| to_min[a] + layout.stored - layout.apron - from_min[a]);
        Self::of_box(layout, codes, size, first, to_min, of(to.extent().to_array()))
    }

    /// Block of `count` voxels along each axis, at `from` in a box of this size and at `to` in the padded brick.
    fn of_box(
        layout: &Layout,
        codes: &'a [u8],
        size: [usize; 3],
        from: [usize; 3],
        to: [usize; 3],
        count: [usize; 3],
    ) -> Self {
        let bytes = layout.voxel_bytes;
        let place = |[x, y, z]: [usize; 3], [width, height, _]: [usize; 3]| ((z * height + y) * width + x) * bytes;
        Self {
            codes: &codes[place(from, size)..],
            row: size[0] * bytes,
            slice: size[0] * size[1] * bytes,
            to: place(to, [layout.padded(); 3]),
            run: count[0] * bytes,
            rows: count[1],
            slices: count[2],
        }
    }
}

/// Copies up to three blocks, side by side along x, to their places in a padded brick.
pub(crate) fn paste(layout: &Layout, bar: [Option<Block>; 3], out: &mut [u8]) {
    let (apron, row) = (layout.apron * layout.voxel_bytes, layout.edge * layout.voxel_bytes);
    let width = layout.padded() * layout.voxel_bytes;
    let padded_slice = layout.padded() * width;
    if let [Some(before), Some(own), Some(after)] = &bar
        && [before.run, own.run, after.run] == [apron, row, apron]
    {
        for z in 0..own.slices {
            let out = &mut out[before.to + z * padded_slice..][..own.rows * width];
            let codes = [before, own, after].map(|block| &block.codes[z * block.slice..]);
            with_widths!(copy_whole_rows(apron, row, codes, out));
        }
        return;
    }
    for block in bar.iter().flatten() {
        for z in 0..block.slices {
            let out = &mut out[block.to + z * padded_slice..];
            copy_runs(block.run, &block.codes[z * block.slice..], block.row, block.rows, out, width);
        }
    }
}

/// Fills rows of a padded brick. The blocks have no gaps between their rows.
#[inline(always)]
fn copy_whole_rows(apron: usize, row: usize, [before, own, after]: [&[u8]; 3], out: &mut [u8]) {
    let aprons = before.chunks_exact(apron).zip(after.chunks_exact(apron));
    let codes = own.chunks_exact(row).zip(aprons);
    for (out, (own, (before, after))) in out.chunks_exact_mut(apron + row + apron).zip(codes) {
        out[..apron].copy_from_slice(before);
        out[apron..apron + row].copy_from_slice(own);
        out[apron + row..].copy_from_slice(after);
    }
}

/// Copies the first `run` bytes of every `step` to those of every `out_step`, `count` times.
fn copy_runs(run: usize, codes: &[u8], step: usize, count: usize, out: &mut [u8], out_step: usize) {
    let runs = codes.chunks(step).zip(out.chunks_mut(out_step)).take(count);
    macro_rules! with_run {
        ($($usual:literal),*) => {
            match run {
                $($usual => runs.for_each(|(codes, out)| out[..$usual].copy_from_slice(&codes[..$usual])),)*
                _ => runs.for_each(|(codes, out)| out[..run].copy_from_slice(&codes[..run])),
            }
        };
    }
    with_run!(1, 2, 4, 8, 64, 128, 256);
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::GradientNodes;

    /// Each part of a padded brick is the same from a shell as from the core, alone or with its bar.
    #[test]
    fn shells_hold_what_neighbours_take() {
        for (edge, apron, voxel_bytes) in [
            (4, 1, 1),
            (4, 2, 2),
            (3, 2, 1),
            (64, 1, 1),
            (64, 2, 1),
            (64, 1, 2),
            (64, 2, 2),
            (64, 1, 4),
            (64, 2, 4),
            (2, 2, 4),
        ] {
            let gradients = GradientNodes { edge: edge as u32, layers: 0 };
            let layout = Layout { edge, apron, stored: 0, voxel_bytes, code_bytes: voxel_bytes, gradients };
            let core: Vec<u8> = (0..layout.core_bytes()).map(|i| ((i * 2654435761) >> 11) as u8).collect();
            let mut shell = vec![0; layout.shell_bytes()];
            copy_shell(&layout, &core, &mut shell);
            let span = |side| [(edge - apron, 0, apron), (0, apron, edge), (0, apron + edge, apron)][side];
            let spans = |part: Part| part.side.map(span).map(|(from, to, len)| Span { from, to, len });
            let codes = |part| if part == Part::OWN { &core } else { &shell };
            let block = |part| Some(Block::new(&layout, part, codes(part), spans(part)));
            let (mut alone, mut in_bars) = (vec![0; layout.padded_bytes()], vec![0; layout.padded_bytes()]);
            Part::all().for_each(|part| paste(&layout, [None, block(part), None], &mut alone));
            Part::bars().for_each(|bar| paste(&layout, bar.map(block), &mut in_bars));
            assert!(alone == in_bars, "{layout:?}");
            for (i, code) in alone.chunks_exact(voxel_bytes).enumerate() {
                // With itself for each neighbour, a core repeats.
                let along = |stride| (i / stride % layout.padded() + edge - apron) % edge;
                let at = [along(1), along(layout.padded()), along(layout.padded().pow(2))];
                let from = ((at[2] * edge + at[1]) * edge + at[0]) * voxel_bytes;
                assert_eq!(code, &core[from..from + voxel_bytes], "{layout:?} {i}");
            }
        }
    }
}
