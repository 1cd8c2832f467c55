//! Renderers by name, each with all bricks of some volumes: slots in, frame out.

use crate::volume::Volume;
use brickyard::backend::{BackendChoice, CompositorChoice, Renderer};
use brickyard::pager::{DrawList, Slot, Upload, VolumeNeeds};
use brickyard::render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard::software::{SoftwareOptions, SoftwareRenderer};
use brickyard::volume::Needs;
pub(crate) use brickyard_tests::Way;
use brickyard_tests::{WAYS, leave_out};

pub(crate) const SORTED: Way = WAYS[0];
pub(crate) const RAYCAST: Way = WAYS[1];
pub(crate) const COMPUTE: Way = WAYS[2];
pub(crate) const CPU: Way = WAYS[3];

pub(crate) const ALL: [Way; 4] = [CPU, SORTED, RAYCAST, COMPUTE];

/// All but the one that shares another's shaders.
pub(crate) const MOST: [Way; 3] = [CPU, SORTED, RAYCAST];

/// The largest picture.
const SIZE: (u32, u32) = (160, 160);

/// Volumes and their renderers.
pub(crate) struct Stage<'a> {
    pub(crate) volumes: Vec<&'a Volume>,
    /// Minimum contents of bricks on a GPU, for the use of one renderer in many frames.
    room: Option<Needs>,
    made: Vec<(Way, Needs, Box<dyn Renderer>)>,
}

impl<'a> Stage<'a> {
    /// A stage where each renderer's bricks have exactly a frame's needs.
    pub(crate) fn exact(volumes: &[&'a Volume]) -> Self {
        Self { volumes: volumes.to_vec(), room: None, made: Vec::new() }
    }

    /// A stage where bricks on a GPU have the needs of all these frames.
    pub(crate) fn with_room(volumes: &[&'a Volume], frames: impl IntoIterator<Item = Needs>) -> Self {
        Self { room: frames.into_iter().reduce(Needs::union), ..Self::exact(volumes) }
    }

    /// The renderer for frames with these needs; `None`, with a message, without an adapter.
    pub(crate) fn renderer(&mut self, way: Way, frame: &Needs) -> Option<&mut dyn Renderer> {
        let needs = self.room.filter(|_| way != CPU).map_or(*frame, |room| room.union(*frame));
        let known = self.made.iter().position(|(made, has, _)| (*made, *has) == (way, needs));
        let i = match known {
            Some(i) => i,
            None => {
                let renderer = self.open(way, &needs)?;
                self.made.push((way, needs, renderer));
                self.made.len() - 1
            }
        };
        Some(&mut *self.made[i].2)
    }

    /// A renderer with all bricks.
    fn open(&self, way: Way, needs: &Needs) -> Option<Box<dyn Renderer>> {
        // All volumes' bricks may lie in one pool.
        let room = |own: u32| self.volumes.len() as u32 * own;
        let ample = |needs: VolumeNeeds| VolumeNeeds { most_slots: room(needs.most_slots), ..needs };
        let all: Vec<VolumeNeeds> = self.volumes.iter().map(|volume| ample(volume.needs(needs))).collect();
        let mut renderer = open(way, &all)?;
        for (layer, volume) in self.volumes.iter().enumerate() {
            fill(&mut *renderer, (layer, self.volumes.len()), volume, needs);
        }
        Some(renderer)
    }
}

/// A renderer for such volumes; `None`, with a message, without an adapter.
pub(crate) fn open(way: Way, needs: &[VolumeNeeds]) -> Option<Box<dyn Renderer>> {
    let compositor = match way {
        (BackendChoice::Cpu, _) => {
            let (max_picture_px, skips_empty) = (SIZE.into(), true);
            let options = SoftwareOptions { memory_bytes: 1 << 30, max_picture_px, threads: 2, skips_empty };
            return Some(Box::new(SoftwareRenderer::new(needs, &options).expect("a gibibyte is enough")));
        }
        (_, CompositorChoice::Sorted) => Compositor::Sorted,
        (_, CompositorChoice::Compute) => Compositor::Compute,
        (_, CompositorChoice::Raycast | CompositorChoice::Auto) => Compositor::Raycast,
    };
    match GpuRenderer::new(&GpuOptions { compositor, ..Default::default() }, needs, 256 << 20, SIZE) {
        Ok(renderer) => Some(Box::new(renderer)),
        Err(error @ GpuError::NoAdapter { .. }) => {
            leave_out("gpu", error);
            None
        }
        Err(error) => panic!("{way:?}: {error}"),
    }
}

/// Puts all bricks of layer `layer` of `layers` in their slots for [`placed`]; those that fit, the coarsest first.
pub(crate) fn fill(renderer: &mut dyn Renderer, (layer, layers): (usize, usize), volume: &Volume, needs: &Needs) {
    for brick in volume.bricks() {
        let slot = in_turn(volume.slot(brick), layer, layers);
        if slot.0 < renderer.slots(layer) {
            let upload = Upload { volume: layer, slot, brick, codes: volume.padded(brick, needs) };
            renderer.upload(layer, &upload).expect("the slot is there");
        }
    }
}

/// A layer's list with the slots of all layers interleaved: they may share slots.
pub(crate) fn placed(list: &DrawList, layer: usize, layers: usize) -> DrawList {
    let mut list = list.clone();
    list.cells.iter_mut().for_each(|cell| cell.slot = in_turn(cell.slot, layer, layers));
    list
}

fn in_turn(slot: Slot, layer: usize, layers: usize) -> Slot {
    Slot(slot.0 * layers as u32 + layer as u32)
}
