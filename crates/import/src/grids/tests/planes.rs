//! Grids of which one decodes whole planes.

use super::{Listed, place};
use crate::error::ImportError;
use crate::grids::{Grid, GridList, Grids};
use crate::open::open;
use crate::options::OpenOptions;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::{Extent, VoxelBox};
use serde_json::json;
use std::sync::{Arc, Mutex};

/// A source read by planes, which keeps a list of the boxes read and announced.
struct Planes {
    source: Box<dyn Source>,
    reads: Arc<Mutex<Vec<VoxelBox>>>,
    announced: Arc<Mutex<Vec<VoxelBox>>>,
}

impl Source for Planes {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }
    fn access(&self) -> Access {
        Access::Planes
    }
    fn reader_bytes(&self) -> u64 {
        1000
    }
    fn held_bytes(&self) -> u64 {
        1 << 30
    }
    fn scratch_bytes(&self) -> u64 {
        30
    }
    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.reads.lock().unwrap().push(region);
        self.source.read_box(time, channel, region, out)
    }
    fn announce(&self, _: u32, _: u32, region: VoxelBox) {
        self.announced.lock().unwrap().push(region);
    }
    fn constant_in(&self, _: u32, _: u32, region: VoxelBox) -> Option<f64> {
        (region.min.z > 0).then_some(9.0)
    }
}

/// Planes of the coarse grid are read whole, each once for a box, and not at all below a finer grid.
#[test]
fn planes_are_read_whole_and_only_where_they_show() {
    let (x, y) = (900, 700);
    let coarse: Vec<f64> = (0..x / 2 * y / 2 * 2).map(|i| f64::from(i % 200)).collect();
    let fine = vec![201.0; (x * y) as usize];
    let listed = Listed::new().with("coarse.raw", "u8", [x / 2, y / 2, 2], &coarse, place(2.0, [0.5; 3])).with(
        "fine.raw",
        "u8",
        [x, y, 1],
        &fine,
        place(1.0, [0.0; 3]),
    );
    let path = listed.written(&json!({}));
    let list = GridList::read(&path).unwrap();
    let options = OpenOptions::default();
    let (reads, announced) = (Arc::<Mutex<Vec<VoxelBox>>>::default(), Arc::<Mutex<Vec<VoxelBox>>>::default());
    let grids = list.entries.iter().map(|entry| {
        let options = list.options(entry, &options).unwrap();
        let source = open(std::slice::from_ref(&entry.input), &options).unwrap();
        let is_coarse = entry.name == "coarse.raw";
        let planes = Planes { source, reads: reads.clone(), announced: announced.clone() };
        let source = if is_coarse { Box::new(planes) as Box<dyn Source> } else { planes.source };
        Grid::new(&list, entry, source).unwrap()
    });
    let source = Grids::new(&list, grids.collect(), &options).unwrap();
    assert_eq!((source.info().extent, source.access()), (Extent::new(x, y, 4), Access::Planes));
    let plane = u64::from(x * y);
    assert!(plane > crate::grids::PIECE_VOXELS, "a plane is more than a piece");
    // Marks and cells of a plane, and their numbers along the axes.
    assert_eq!(source.reader_bytes(), 1000 + 2 * plane + 4 * u64::from(x + y + 4));
    assert!(source.held_bytes() > 1 << 30 && source.scratch_bytes() == 30);
    let read = |low: u32, high: u32| {
        reads.lock().unwrap().clear();
        let region = VoxelBox::new([0, 0, low], [x, y, high]);
        let mut out = vec![0; region.extent().volume() as usize];
        source.read_box(0, 0, region, &mut out).unwrap();
        let cell = |[x, y, z]: [u32; 3]| Extent::new(450, 350, 2).linear([x / 2, y / 2, z / 2]) as usize;
        let expected = |voxel: [u32; 3]| if voxel[2] == 0 { 201 } else { coarse[cell(voxel)] as u8 };
        assert!(region.voxels().zip(&out).all(|(voxel, found)| expected(voxel) == *found));
        reads.lock().unwrap().clone()
    };
    let whole = |z: u32| VoxelBox::new([0, 0, z], [x / 2, y / 2, z + 1]);
    assert_eq!(read(0, 1), []);
    assert_eq!(read(1, 2), [whole(0)]);
    // Planes are larger than a piece, so each is filled by itself.
    assert_eq!(read(0, 4), [whole(0), whole(1), whole(1)]);
    let part = VoxelBox::new([10, 20, 1], [13, 30, 3]);
    source.announce(0, 0, part);
    source.announce(0, 0, VoxelBox::new([10, 20, 0], [13, 30, 1]));
    assert_eq!(*announced.lock().unwrap(), [VoxelBox::new([5, 10, 0], [7, 15, 2])]);
    // A coarse cell known to be constant, alone in the box.
    let constant = |low: u32, high: u32| source.constant_in(0, 0, VoxelBox::new([0, 0, low], [5, 5, high]));
    assert_eq!([constant(2, 4), constant(1, 4), constant(0, 1)], [Some(9.0), None, None]);
}
