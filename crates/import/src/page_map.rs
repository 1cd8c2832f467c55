//! Plane-to-page map of a stack's files: a rule where pages follow one another along axes, else a list. A picture is a page.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::options::OpenOptions;

/// Axes of a list of planes, slowest first.
pub(crate) const LISTED: [Axis; 3] = [Axis::T, Axis::C, Axis::Z];

/// Place of a plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    /// The file's number in the stack.
    pub(crate) file: u32,
    /// The page's number in the file, from 0.
    pub(crate) page: u32,
}

/// Map from planes to pages of files.
#[derive(Debug, PartialEq)]
pub(crate) struct PageMap {
    /// Sizes in pages: samples within a page are not counted as channels. Those along x and y are a page's.
    pub(crate) sizes: Sizes,
    pub(crate) order: PageOrder,
}

#[derive(Debug, PartialEq)]
pub(crate) enum PageOrder {
    /// Pages along these axes (of t, c, z), slowest first, through files of equally many pages.
    Along { axes: Vec<Axis>, pages_per_file: u32 },
    /// One place for each plane, along [`LISTED`].
    Listed(Vec<Place>),
}

impl PageMap {
    /// Maps pages along axes, slowest first. `sizes` has their number along each.
    pub(crate) fn along(axes: &[Axis], sizes: Sizes, pages_per_file: u32) -> Self {
        Self { sizes, order: PageOrder::Along { axes: axes.to_vec(), pages_per_file } }
    }

    /// Bytes of the list of places.
    pub(crate) fn held_bytes(&self) -> usize {
        match &self.order {
            PageOrder::Along { .. } => 0,
            PageOrder::Listed(places) => size_of_val(&places[..]),
        }
    }

    /// The place of a plane, given by its step, channel and slice. Every index is below its size.
    pub(crate) fn place(&self, plane: [u32; 3]) -> Place {
        match &self.order {
            PageOrder::Along { axes, pages_per_file } => {
                let (page, per_file) = (self.sizes.number_of(plane, axes), *pages_per_file as u64);
                Place { file: (page / per_file) as u32, page: (page % per_file) as u32 }
            }
            PageOrder::Listed(places) => places[self.sizes.number_of(plane, &LISTED) as usize],
        }
    }

    /// All planes in the order of a list.
    fn planes(&self) -> impl Iterator<Item = [u32; 3]> + use<> {
        let sizes = self.sizes;
        (0..sizes.planes()).map(move |number| sizes.plane_of(number, &LISTED))
    }

    /// Places of all planes, file by file.
    pub(crate) fn by_file(&self) -> Vec<Place> {
        let mut places: Vec<Place> = self.planes().map(|plane| self.place(plane)).collect();
        places.sort_unstable();
        places
    }

    /// Returns the same map as a rule, if the planes of one file lie along these axes.
    pub(crate) fn shortened(self, axes: &[Axis]) -> Self {
        let rule = Self::along(axes, self.sizes, self.sizes.planes().try_into().unwrap_or(u32::MAX));
        let is_same = self.planes().all(|plane| self.place(plane) == rule.place(plane));
        if is_same { rule } else { self }
    }

    /// Skips these pages, ascending, in the map of one file.
    pub(crate) fn without(self, left_out: &[u32]) -> Self {
        let planes = self.sizes.planes() as u32;
        if left_out.first().is_none_or(|&first| first >= planes) {
            return self;
        }
        let kept: Vec<u32> =
            (0..planes + left_out.len() as u32).filter(|page| left_out.binary_search(page).is_err()).collect();
        let place = |plane| Place { file: 0, page: kept[self.place(plane).page as usize] };
        let places = self.planes().map(place).collect();
        Self { order: PageOrder::Listed(places), ..self }
    }

    /// Distinguishes this map from others of the same files, for the identity of an input.
    pub(crate) fn kind(&self) -> String {
        match &self.order {
            PageOrder::Along { axes, .. } => format!("{axes:?}"),
            PageOrder::Listed(_) => "listed".into(),
        }
    }
}

/// Page axes and sizes by the caller's axes: the one missing size follows from the number of pages.
pub(crate) fn as_told(axes: &AxisOrder, pages: u32, options: &OpenOptions) -> Result<(Vec<Axis>, Sizes), String> {
    let [page_axes @ .., Axis::Y, Axis::X] = axes.axes() else {
        return Err(format!("axes '{axes}' do not end in yx, the order of pixels in a page"));
    };
    let given = |axis| match axis {
        Axis::T => options.times,
        Axis::C => options.channels,
        _ => None,
    };
    let known: u64 = page_axes.iter().filter_map(|&a| given(a)).map(u64::from).product();
    let unknown: Vec<Axis> = page_axes.iter().copied().filter(|&a| given(a).is_none()).collect();
    let rest = (pages as u64).checked_div(known).unwrap_or(0) as u32;
    let fits = rest as u64 * known == pages as u64;
    match unknown[..] {
        [] if known == pages as u64 => {}
        [_] if fits => {}
        [] | [_] => return Err(format!("{pages} pages do not divide into axes '{axes}' of the given sizes")),
        _ => {
            return Err(format!(
                "axes '{axes}' leave several sizes of {pages} pages open; give `channels` and `times`, too"
            ));
        }
    }
    let sizes: Vec<u32> = page_axes.iter().map(|&a| given(a).unwrap_or(rest)).collect();
    Ok((page_axes.to_vec(), Sizes::from_ordered(page_axes, &sizes)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_that_follows_a_rule_becomes_one() {
        let sizes = Sizes::from_ordered(&[Axis::T, Axis::C, Axis::Z], &[2, 3, 2]);
        let axes = [Axis::Z, Axis::T, Axis::C];
        let rule = PageMap::along(&axes, sizes, 12);
        let listed = || {
            let places = (0..2).flat_map(|t| (0..3).flat_map(move |c| (0..2).map(move |z| (t, c, z))));
            places.map(|(t, c, z)| rule.place([t, c, z])).collect::<Vec<_>>()
        };
        assert_eq!(PageMap { sizes, order: PageOrder::Listed(listed()) }.shortened(&axes), rule);
        let mut turned = listed();
        turned.swap(3, 7);
        let list = PageMap { sizes, order: PageOrder::Listed(turned.clone()) };
        let kept = list.shortened(&axes);
        assert_eq!(kept, PageMap { sizes, order: PageOrder::Listed(turned) });
        assert_eq!(kept.by_file(), rule.by_file());
    }
}
