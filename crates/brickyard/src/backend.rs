//! The two rendering backends behind one face: slots in, pictures out.

use crate::options::SessionOptions;
pub use crate::options::{BackendChoice, CompositorChoice};
use brickyard_pager::{BrickSource, DrawList, Upload};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuPreference, GpuRenderer};
use brickyard_software::{SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::{FrameSettings, Needs, Picture, Pyramid, SlotEncoding};

/// What a backend is built for.
#[derive(Clone, Copy, Debug)]
pub struct BackendNeeds {
    /// How slot codes stand for values.
    pub encoding: SlotEncoding,
    /// Voxels along a brick's core edge.
    pub edge: u32,
    /// What the pictures need of bricks.
    pub bricks: Needs,
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
    /// Whether rays leap over what shows nothing.
    pub leaps: bool,
}

impl BackendNeeds {
    /// What a source needs under these options.
    pub(crate) fn new(source: &dyn BrickSource, options: &SessionOptions) -> Self {
        let pyramid = source.pyramid();
        // Slots that could ever be filled at one time step and channel, and a tenth more so that the cut may have them all.
        let bricks = pyramid.brick_count();
        Self {
            encoding: SlotEncoding::new(source.voxel_type(), source.value_range(), source.has_non_finite()),
            edge: pyramid.edge(),
            bricks: options.bricks,
            compositor: options.compositor,
            levels: pyramid.levels().len() as u32,
            gpu_memory_bytes: options.gpu_memory_bytes,
            max_size_px: options.max_size_px,
            max_slots: u32::try_from(bricks + bricks / 8 + 2).unwrap_or(u32::MAX),
            threads: options.threads,
            leaps: options.leaps,
        }
    }
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
    #[error("the CPU backend has no `{0}` compositor, only `raycast`: use --compositor raycast, or --backend gpu")]
    CpuCompositor(&'static str),
}

impl BackendError {
    /// Whether the device is gone, so that [`Backend::renew`] may help.
    pub fn is_loss(&self) -> bool {
        matches!(self, Self::Gpu(GpuError::DeviceLost(_)))
    }
}

/// A renderer and the slots it draws from.
pub enum Backend {
    /// wgpu.
    Gpu(Box<GpuRenderer>),
    /// The CPU.
    Cpu(Box<SoftwareRenderer>),
}

impl Backend {
    /// Makes the chosen backend and says which in one line.
    ///
    /// # Errors
    /// If the GPU was asked for and there is none, the backend does not have the compositor, or the memory cannot hold a
    /// picture and one brick.
    pub fn new(choice: BackendChoice, needs: &BackendNeeds) -> Result<(Self, String), BackendError> {
        let cpu = |why: &str| -> Result<(Self, String), BackendError> {
            match needs.compositor {
                CompositorChoice::Auto | CompositorChoice::Raycast => {}
                CompositorChoice::Sorted => return Err(BackendError::CpuCompositor("sorted")),
                CompositorChoice::Compute => return Err(BackendError::CpuCompositor("compute")),
            }
            let renderer = SoftwareRenderer::new(SoftwareOptions {
                encoding: needs.encoding,
                edge: needs.edge,
                needs: needs.bricks,
                memory_bytes: needs.gpu_memory_bytes,
                max_picture_px: needs.max_size_px.into(),
                threads: needs.threads,
                leaps: needs.leaps,
            })?;
            Ok((Self::Cpu(Box::new(renderer)), format!("cpu, {} threads{why}", needs.threads)))
        };
        let gpu = |preference: GpuPreference| -> Result<(Self, String), BackendError> {
            let compositor = match needs.compositor {
                CompositorChoice::Auto => Compositor::default(),
                CompositorChoice::Sorted => Compositor::Sorted,
                CompositorChoice::Raycast => Compositor::Raycast,
                CompositorChoice::Compute => Compositor::Compute,
            };
            let (levels, max_slots) = (needs.levels, needs.max_slots);
            let options =
                GpuOptions { preference, compositor, levels, max_slots, leaps: needs.leaps, ..Default::default() };
            let renderer = GpuRenderer::new(
                &options,
                needs.encoding,
                needs.edge,
                needs.bricks,
                needs.gpu_memory_bytes,
                needs.max_size_px,
            )?;
            let line = format!("gpu, {}{}", renderer.adapter(), refusal(&renderer));
            Ok((Self::Gpu(Box::new(renderer)), line))
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

    /// Starts a lost GPU anew, from the choice of the adapter on. All slots are empty then, and there may be fewer.
    ///
    /// # Errors
    /// If there is no GPU any more, or it gives too little.
    pub fn renew(&mut self) -> Result<(), BackendError> {
        match self {
            Self::Gpu(r) => r.renew()?,
            Self::Cpu(_) => {}
        }
        Ok(())
    }

    /// `gpu` or `cpu`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Gpu(_) => "gpu",
            Self::Cpu(_) => "cpu",
        }
    }

    /// `sorted`, `raycast` or `compute`.
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

    /// What [`Backend::bytes`] would be, had the device not refused some of it.
    pub fn asked_bytes(&self) -> u64 {
        match self {
            Self::Gpu(r) => r.asked_bytes(),
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

    /// For each cell of the last list drawn, in its order, how much light was left where a ray entered it, the most of all
    /// rays: 0 of a cell that nobody could see. `None` where that is not known: of projections and of `sorted`.
    pub fn visibility(&self) -> Option<&[f32]> {
        match self {
            Self::Gpu(r) => r.visibility(),
            Self::Cpu(r) => r.visibility(),
        }
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

/// What is to be said where the device gave less than it was asked for.
fn refusal(renderer: &GpuRenderer) -> String {
    let (asked, got) = (renderer.asked_bytes(), renderer.gpu_bytes());
    let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
    match asked > got {
        true => format!(", which refused {:.1} MiB: {:.1} MiB are used", mib(asked), mib(got)),
        false => String::new(),
    }
}
