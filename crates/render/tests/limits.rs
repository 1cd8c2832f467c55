//! Limits of a GPU renderer: refusals, behaviour when the device refuses memory, and byte counts.

mod bricks;

use bricks::{Bricks, COMPOSITORS, MEMORY_BYTES, rays, transfer};
use brickyard_pager::{DrawList, Slot, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;

fn render(
    bricks: &Bricks,
    renderer: &mut GpuRenderer,
    frames: &[FrameSettings],
    draw: &DrawList,
) -> Result<Picture, GpuError> {
    let frames: Vec<VolumeFrame> = frames.iter().cloned().map(VolumeFrame::alone).collect();
    renderer.render(&bricks.layers(&frames, draw), None)
}

#[test]
fn what_does_not_fit_is_a_typed_error() {
    let bricks = Bricks::new();
    for compositor in COMPOSITORS {
        let Some(mut renderer) = bricks.renderer(compositor, 1) else { return };
        assert!(renderer.gpu_bytes() <= MEMORY_BYTES);
        assert!(matches!(renderer.upload(0, Slot(0), &[0; 7]), Err(GpuError::Mismatch(_))));
        let mut render =
            |frames: &[FrameSettings]| render(&bricks, &mut renderer, frames, &DrawList::default()).map(|_| ());
        let frame = bricks.frame(&transfer(0.1));
        let large = FrameSettings { rays: rays(65, 8), ..frame.clone() };
        assert!(matches!(render(&[large]), Err(GpuError::PictureTooLarge { .. })));
        let table = TransferTable::from_entries(frame.table.entries[..9].to_vec(), 1.0).into();
        assert!(matches!(render(&[FrameSettings { table, ..frame.clone() }]), Err(GpuError::Mismatch(_))));
        assert!(matches!(render(&[frame.clone(), frame.clone()]), Err(GpuError::Mismatch(_))), "one layer too many");
        assert_eq!(render(&[frame]), Ok(()), "the renderer still works");

        let options = GpuOptions { compositor, ..Default::default() };
        let needs = VolumeNeeds { edge: 64, levels: 16, most_slots: u32::MAX, ..bricks.needs };
        let new = |bytes| GpuRenderer::new(&options, &[needs], bytes, (512, 512)).map(|_| ());
        let Err(GpuError::Budget { least_bytes, .. }) = new(1 << 20) else { panic!("1 MiB is not enough") };
        assert_eq!(new(least_bytes), Ok(()));
    }
}

#[test]
fn sorted_refuses_layers_that_have_no_common_order() {
    let bricks = Bricks::new();
    let Some(mut renderer) = bricks.renderer(Compositor::Sorted, 2) else { return };
    let frame = bricks.frame(&transfer(0.1));
    let placement = Placement::from_text("0.8 -0.6 0 12  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    let turned = FrameSettings { placement, ..frame.clone() };
    let refused = render(&bricks, &mut renderer, &[frame, turned], &DrawList::default());
    assert!(matches!(refused, Err(GpuError::Mismatch(problem)) if problem.contains("sorted")));
}

/// Of three volumes whose bricks share no slots.
#[test]
fn budgets_are_shared_and_hard() {
    let bricks = Bricks::new();
    let needs = [(16, VoxelType::U8), (12, VoxelType::U16), (16, VoxelType::F32)].map(|(edge, voxel_type)| {
        let encoding = SlotEncoding::new(voxel_type, (0.0, 255.0), true);
        VolumeNeeds { edge, encoding, ..bricks.needs }
    });
    let with = |bytes| GpuRenderer::new(&GpuOptions::default(), &needs, bytes, (64, 64));
    let least = match with(1000) {
        Err(GpuError::Budget { least_bytes, .. }) => least_bytes,
        Err(error @ GpuError::NoAdapter { .. }) => return bricks::missing::leave_out("gpu", error),
        other => panic!("{other:?}"),
    };
    assert!(with(least - 1).is_err());
    let smallest = with(least).expect("the least works");
    assert!((0..3).all(|volume| smallest.slots(volume) == 2) && smallest.gpu_bytes() <= least);
    let ample = with(MEMORY_BYTES).expect("all works");
    assert!((0..3).all(|volume| ample.slots(volume) == 9) && ample.gpu_bytes() <= MEMORY_BYTES);
}

/// The number of slots is halved until all fits; the rest draws the same picture.
#[test]
fn refused_memory_ends_in_fewer_slots() {
    let bricks = Bricks::new();
    let frame = bricks.frame(&transfer(0.1));
    for compositor in COMPOSITORS {
        let Some(mut ample) = bricks.renderer(compositor, 1) else { return };
        let new = |refuse_above_bytes| {
            let needs = VolumeNeeds { most_slots: 500, ..bricks.needs };
            let options = GpuOptions { compositor, refuse_above_bytes, ..Default::default() };
            GpuRenderer::new(&options, &[needs], MEMORY_BYTES, (64, 64))
        };
        // 500 slots of 24^3 texels of 1 or 2 bytes; of 125 or 62 one texture takes less than two megabytes.
        let whole = new(u64::MAX).expect("a renderer");
        assert_eq!((whole.slots(0), whole.asked_bytes()), (500, whole.gpu_bytes()));
        let mut less = new(2 << 20).expect("a renderer");
        assert!((60..300).contains(&less.slots(0)), "{compositor:?}: {} slots", less.slots(0));
        assert!(less.gpu_bytes() < whole.gpu_bytes() && less.asked_bytes() == whole.gpu_bytes());
        let pictures = [&mut ample, &mut less].map(|renderer| {
            let list = bricks.upload(renderer);
            render(&bricks, renderer, std::slice::from_ref(&frame), &list).expect("a picture")
        });
        assert_eq!(pictures[0], pictures[1], "{compositor:?}");
        // Even the least atlas is too much here.
        assert!(matches!(new(1000), Err(GpuError::OutOfMemory { .. })), "{compositor:?}");
    }
}

#[test]
fn a_new_transfer_function_uploads_no_brick() {
    let bricks = Bricks::new();
    for compositor in COMPOSITORS {
        let Some(mut renderer) = bricks.renderer(compositor, 1) else { return };
        let list = bricks.upload(&mut renderer);
        let before = renderer.uploaded_bytes();
        let pictures = [0.1, 0.8]
            .map(|hue| render(&bricks, &mut renderer, &[bricks.frame(&transfer(hue))], &list).expect("a picture"));
        assert_ne!(pictures[0], pictures[1]);
        assert_eq!(renderer.uploaded_bytes(), before);
        assert!(renderer.last_frame_ms() > 0.0);
    }
}
