//! The two rendering backends behind one face: slots in, pictures out.

use brickyard_pager::{DrawList, Upload};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuPreference, GpuRenderer};
use brickyard_software::{SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::{FrameSettings, Picture, Pyramid, SlotEncoding};

/// Which backend to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// The GPU if there is a real one, else the CPU.
    #[default]
    Auto,
    /// Any GPU adapter, a software one too.
    Gpu,
    /// The CPU.
    Cpu,
}

/// How a backend is to gather samples into a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompositorChoice {
    /// What measures fastest over all scenes: `raycast`, on the GPU and on the CPU.
    #[default]
    Auto,
    /// Bricks back to front, blended; GPU only.
    Sorted,
    /// A ray per pixel, front to back.
    Raycast,
}

/// What a backend is built for.
#[derive(Clone, Copy, Debug)]
pub struct BackendNeeds {
    /// How slot codes stand for values.
    pub encoding: SlotEncoding,
    /// Voxels along a brick's core edge.
    pub edge: u32,
    /// Voxels copied from neighbours on each side.
    pub apron: u32,
    /// How samples are gathered.
    pub compositor: CompositorChoice,
    /// Levels of the pyramid.
    pub levels: u32,
    /// The hard limit for slots, tables, targets and staging.
    pub gpu_memory_bytes: u64,
    /// The largest picture to be rendered, pixels.
    pub max_size_px: (u32, u32),
    /// No more slots than this are of use: the number of bricks there are.
    pub max_slots: u32,
    /// Threads of the CPU backend.
    pub threads: usize,
}

/// A backend that could not be made or has failed.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// The GPU backend's error.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The CPU backend's error.
    #[error(transparent)]
    Cpu(#[from] SoftwareError),
    /// The CPU backend knows one compositor.
    #[error("the CPU backend has no `sorted` compositor, only `raycast`: use --compositor raycast, or --backend gpu")]
    CpuSorted,
}

/// A renderer and the slots it draws from.
pub enum Backend {
    /// wgpu.
    Gpu(Box<GpuRenderer>),
    /// The CPU.
    Cpu(SoftwareRenderer),
}

impl Backend {
    /// Makes the chosen backend and says which in one line.
    ///
    /// # Errors
    /// If the GPU was asked for and there is none, the backend does not have the compositor, or the memory cannot hold a
    /// picture and one brick.
    pub fn new(choice: BackendChoice, needs: &BackendNeeds) -> Result<(Self, String), BackendError> {
        let cpu = |why: &str| -> Result<(Self, String), BackendError> {
            if needs.compositor == CompositorChoice::Sorted {
                return Err(BackendError::CpuSorted);
            }
            let renderer = SoftwareRenderer::new(SoftwareOptions {
                encoding: needs.encoding,
                edge: needs.edge,
                apron: needs.apron,
                memory_bytes: needs.gpu_memory_bytes,
                max_picture_px: needs.max_size_px.into(),
                threads: needs.threads,
            })?;
            Ok((Self::Cpu(renderer), format!("cpu, {} threads{why}", needs.threads)))
        };
        let gpu = |preference: GpuPreference| -> Result<(Self, String), BackendError> {
            let compositor = match needs.compositor {
                CompositorChoice::Auto => Compositor::default(),
                CompositorChoice::Sorted => Compositor::Sorted,
                CompositorChoice::Raycast => Compositor::Raycast,
            };
            let options = GpuOptions { preference, compositor, levels: needs.levels, max_slots: needs.max_slots };
            let renderer = GpuRenderer::new(
                &options,
                needs.encoding,
                needs.edge,
                needs.apron,
                needs.gpu_memory_bytes,
                needs.max_size_px,
            )?;
            let name = renderer.adapter().to_string();
            Ok((Self::Gpu(Box::new(renderer)), format!("gpu, {name}")))
        };
        match choice {
            BackendChoice::Cpu => cpu(""),
            BackendChoice::Gpu => gpu(GpuPreference::Any),
            BackendChoice::Auto => match gpu(GpuPreference::Hardware) {
                Err(BackendError::Gpu(GpuError::NoAdapter { .. })) => cpu(" (no hardware GPU)"),
                other => other,
            },
        }
    }

    /// `gpu` or `cpu`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Gpu(_) => "gpu",
            Self::Cpu(_) => "cpu",
        }
    }

    /// `sorted` or `raycast`.
    pub fn compositor(&self) -> &'static str {
        match self {
            Self::Gpu(r) => r.compositor().name(),
            Self::Cpu(_) => Compositor::Raycast.name(),
        }
    }

    /// How many bricks fit.
    pub fn slots(&self) -> u32 {
        match self {
            Self::Gpu(r) => r.slots(),
            Self::Cpu(r) => r.slots(),
        }
    }

    /// Everything the backend has allocated for slots, tables, targets and staging.
    pub fn bytes(&self) -> u64 {
        match self {
            Self::Gpu(r) => r.gpu_bytes(),
            Self::Cpu(r) => r.bytes(),
        }
    }

    /// Puts a padded brick into its slot.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn upload(&mut self, upload: &Upload) -> Result<(), BackendError> {
        match self {
            Self::Gpu(r) => r.upload(upload.slot, &upload.codes)?,
            Self::Cpu(r) => r.upload(upload.slot, upload.codes.clone()),
        }
        Ok(())
    }

    /// Renders one frame.
    ///
    /// # Errors
    /// If the device is lost or out of memory.
    pub fn render(
        &mut self,
        frame: &FrameSettings,
        pyramid: &Pyramid,
        draw: &DrawList,
    ) -> Result<Picture, BackendError> {
        Ok(match self {
            Self::Gpu(r) => r.render(frame, pyramid, draw)?,
            Self::Cpu(r) => r.render(frame, pyramid, draw),
        })
    }
}
