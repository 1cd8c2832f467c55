//! Lists of cells of several levels: drawn with ancestors, fading, or absent.

use crate::list::{OWN, finest, list};
use crate::scenery::{scaled, u8_codes, uneven, views, vivid, waves, wavy};
use crate::shot::{Shot, assert_telling};
use crate::stage::{CPU, MOST, RAYCAST, SORTED, Stage, fill, open};
use crate::volume::Volume;
use brickyard::pager::{DrawCell, DrawList, Layer, PixelShare, VolumeNeeds};
use brickyard::volume::*;
use glam::DVec3;

const U8: (f64, f64) = (0.0, 255.0);

/// Some subtrees stay coarse, and every third cell is drawn from an ancestor.
fn mixed(volume: &Volume, frame: &FrameSettings) -> DrawList {
    let stop = |id: BrickId| (id.level.0 as u32 + id.index.x + 2 * id.index.y + id.index.z) % 3 == 2;
    let coarser =
        |id: BrickId| (id.index.x + id.index.y + id.index.z).is_multiple_of(3) as u8 * (1 + id.index.z as u8 % 2);
    let list = list(volume, frame, &stop, &|id| vec![(coarser(id), PixelShare::ALL)]);
    let levels: std::collections::BTreeSet<_> = list.cells.iter().map(|c| c.brick.level).collect();
    assert!(levels.len() >= 3 && list.cells.iter().any(|c| c.brick.level > c.cell.level), "{levels:?}");
    list
}

#[test]
fn mixed_levels_and_stand_ins_match_the_oracle() {
    let volume = wavy([61, 70, 52], 16);
    let mut stage = Stage::exact(&[&volume]);
    let transfer = vivid(U8);
    let mut views = views(&volume);
    // Along an edge of bricks rounding decides a sample's brick, and with it the level.
    views.retain(|(name, _)| !name.contains("edges"));
    for (i, (name, rays)) in views.into_iter().enumerate() {
        // With an error of 3 pixels the lattice has several zones in view; with 0.3 two.
        let zones = |pixel_error| (pixel_error, Lattice::for_view(0.7, 0.8, &rays, pixel_error, 5));
        let lattices = [(0.0, Lattice::uniform(0.7, 0)), zones(0.3), zones(3.0)];
        // All combinations from outside and from inside.
        let (lattices, modes) = match i {
            0 | 1 => (&lattices[..], &Mode::ALL[..]),
            _ => (&lattices[..1], &[Mode::Dvr, Mode::MinIp, Mode::Isosurface][..]),
        };
        for &(pixel_error, lattice) in lattices {
            for &mode in modes {
                let frame = volume.frame_in(mode, rays, &transfer, lattice);
                let shot = Shot::new(&frame, mixed(&volume, &frame), &transfer);
                let what = format!("{name}, {mode:?}, zones by {pixel_error} pixels");
                let per_mille = |n: usize| n * (rays.width * rays.height) as usize / 1000;
                if mode != Mode::Isosurface {
                    shot.agree(&mut stage, &MOST, 0, &what);
                    continue;
                }
                // Where segments are longer than voxels, bricks take those of neighbours, perhaps of another level.
                let allowed = per_mille(if pixel_error > 1.0 { 40 } else { 2 });
                let expected = shot.oracle(&stage.volumes);
                shot.agree_with(&expected, &mut stage, &[CPU, RAYCAST], allowed, &what);
                // Where levels meet, cells of `sorted` do not have the previous cell's findings.
                shot.agree_with(&expected, &mut stage, &[SORTED], per_mille(40), &what);
                let Some(found) = shot.render(&mut stage, SORTED).filter(|_| pixel_error <= 1.0) else { continue };
                let background = Picture::quantise(frame.background);
                let is_hole = |(a, b): &(&[u8; 3], &[u8; 3])| **a == background && **b != background;
                let holes = found.rgb.iter().zip(&expected.rgb).filter(is_hole).count();
                assert!(holes <= per_mille(1), "{what}: {holes} holes");
            }
        }
    }
}

/// Cells left out of the cut are skipped, and give the same picture as invisible cells.
#[test]
fn cells_that_are_not_there_show_nothing() {
    let volume = Volume::new([61, 70, 52], 16, uneven(), u8_codes(), |p| {
        let distance = (p - DVec3::new(30.5, 41.5, 22.5)).length();
        if distance < 9.0 { 250.0 - distance } else { p.element_sum() % 7.0 }
    });
    let mut stage = Stage::exact(&[&volume]);
    let transfer = vivid(U8);
    for (name, rays) in views(&volume) {
        let frame = volume.frame(rays, &transfer, Lattice::for_view(0.4, 0.8, &rays, 0.5, 5));
        let mut shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
        let expected = shot.oracle(&stage.volumes);
        let cells = &mut shot.lists[0].cells;
        let all = cells.len();
        cells.retain(|c| {
            let (low, high) = (c.region.min.to_array(), c.region.max.to_array());
            (0..3).all(|a| low[a] < [41, 52, 33][a] && high[a] > [19, 30, 11][a])
        });
        assert!(cells.len() < all / 2);
        shot.agree_with(&expected, &mut stage, &MOST, 0, name);
    }
}

#[test]
fn an_empty_list_is_the_background() {
    let volume = wavy([8, 8, 8], 8);
    let mut stage = Stage::exact(&[&volume]);
    for mode in Mode::ALL {
        let frame = volume.frame_in(mode, views(&volume)[0].1, &vivid(U8), Lattice::uniform(1.0, 0));
        for way in MOST {
            let Some(found) = Shot::new(&frame, DrawList::default(), &vivid(U8)).render(&mut stage, way) else {
                continue;
            };
            assert!(found.rgb.iter().all(|&p| p == Picture::quantise(frame.background)), "{mode:?} {way:?}");
        }
    }
}

/// The list with one alone of each cell's two entries.
fn one_of_two(list: &DrawList, is_taken: impl Fn(&DrawCell) -> bool) -> DrawList {
    let taken = list.cells.iter().filter(|entry| entry.pixels == PixelShare::ALL || is_taken(entry));
    DrawList { cells: taken.map(|entry| DrawCell { pixels: PixelShare::ALL, ..*entry }).collect() }
}

/// Pixel by pixel, a fading brick is drawn as if it were resident, or as if it were not.
#[test]
fn a_fade_has_each_pixel_of_one_picture_or_the_other() {
    let volume = wavy([45, 37, 52], 16);
    let mut stage = Stage::exact(&[&volume]);
    for way in MOST {
        let mut telling = 0;
        for (share, (name, rays)) in [1, 20, 32, 63].into_iter().cycle().zip(views(&volume)) {
            for mode in Mode::ALL {
                let frame = volume.frame_in(mode, rays, &vivid(U8), Lattice::uniform(0.7, 0));
                let (before, after) =
                    (PixelShare { from: share, ..PixelShare::ALL }, PixelShare { to: share, ..PixelShare::ALL });
                // Not all at once: entries must not exceed slots.
                let fades = |id: BrickId| (id.index.x + 2 * id.index.y + id.index.z) % 4 == 1;
                let entries = |id| if fades(id) { vec![(1, before), (0, after)] } else { vec![OWN] };
                let list = list(&volume, &frame, &|_| false, &entries);
                let lists = [one_of_two(&list, |e| e.cell == e.brick), one_of_two(&list, |e| e.cell != e.brick), list];
                let pictures = lists.map(|list| Shot::new(&frame, list, &vivid(U8)).render(&mut stage, way));
                let [Some(fine), Some(coarse), Some(found)] = pictures else { continue };
                telling += (fine != coarse) as u32;
                for (i, pixel) in found.rgb.iter().enumerate() {
                    let (x, y) = (i as u32 % fine.width, i as u32 / fine.width);
                    let expected = if after.hold(x, y) { &fine.rgb[i] } else { &coarse.rgb[i] };
                    // The same sums in the same order.
                    assert_eq!(pixel, expected, "{name}, {mode:?}, {way:?}: {x} {y}");
                }
            }
        }
        assert!(telling > 30 || telling == 0, "{telling} of 50 pictures show what fades: the others prove nothing");
    }
}

/// A camera that turns faster than cuts are made sees parts left coarse by the last one: many cells, of few bricks.
#[test]
fn a_list_may_have_more_entries_than_there_are_slots() {
    let volume = Volume::new([30; 3], 8, Geometry::default(), u8_codes(), scaled(u8_codes(), waves));
    let frame = volume.frame(views(&volume)[0].1, &vivid(U8), Lattice::uniform(0.7, 0));
    let draw = list(&volume, &frame, &|_| false, &|_| vec![(1, PixelShare::ALL)]);
    let expected = Shot::new(&frame, draw.clone(), &vivid(U8)).oracle(&[&volume]);
    assert_telling(&expected, "coarse bricks");
    for way in MOST {
        let needs = VolumeNeeds { most_slots: 9, ..volume.needs(&frame.needs()) };
        let Some(mut few) = open(way, &[needs]) else { continue };
        fill(&mut *few, (0, 1), &volume, &frame.needs());
        assert!(few.slots(0) == 9 && draw.cells.len() == 64, "{way:?}");
        let frame = VolumeFrame::alone(frame.clone());
        let layer = Layer { volume: 0, frame: &frame, pyramid: &volume.pyramid, draw: &draw, cut: 0 };
        let found = few.render(&[layer], None).expect("a picture");
        crate::shot::assert_close(&found, &expected, 0, &format!("{way:?}"));
        assert!(few.visibility(0).is_none_or(|seen| seen.len() == 64), "{way:?}");
    }
}

/// A slot holds its latest brick, and a frame uses its own transfer function: no skip outlives either.
#[test]
fn nothing_is_left_of_bricks_and_functions_before() {
    let fill_of = |value: f64| Volume::new([30, 30, 30], 32, uneven(), u8_codes(), move |_| value);
    let (clear, full) = (fill_of(10.0), fill_of(200.0));
    let transfer = vivid(U8);
    let rays = views(&clear)[0].1;
    let frame = clear.frame(rays, &transfer, Lattice::uniform(0.7, 0));
    let pictures = [&clear, &full].map(|volume| Shot::new(&frame, finest(volume, &frame), &transfer).oracle(&[volume]));
    assert_ne!(pictures[0], pictures[1]);
    for way in MOST {
        let mut stage = Stage::exact(&[&clear]);
        for (volume, expected) in [&clear, &full, &clear, &full].into_iter().zip(pictures.iter().cycle()) {
            let Some(renderer) = stage.renderer(way, &frame.needs()) else { continue };
            fill(renderer, (0, 1), volume, &frame.needs());
            let shot = Shot::new(&frame, finest(volume, &frame), &transfer);
            shot.agree_with(expected, &mut stage, &[way], 0, "another brick in a slot");
        }
    }
    let volume = wavy([45, 37, 52], 16);
    let mut stage = Stage::exact(&[&volume]);
    let other = |opacity: &[[f64; 2]]| TransferFunction { opacity: opacity.to_vec(), ..vivid(U8) };
    let reversed = other(&[[40.0, 0.4], [60.0, 0.2], [80.0, 0.0]]);
    for transfer in [vivid(U8), reversed, other(&[[110.0, 0.0], [130.0, 0.3], [160.0, 0.1]]), vivid(U8)] {
        let frame = volume.frame(rays, &transfer, Lattice::uniform(0.7, 0));
        Shot::new(&frame, finest(&volume, &frame), &transfer).agree(&mut stage, &MOST, 0, "edited");
    }
}
