//! The vocabulary of every other crate: voxel types, shapes, levels, brick ids, spaces, value codes, aprons, occupancy,
//! transfer functions, macro-cells, the camera, stereo, clipping, slices, sampling, lighting, gradients, surfaces, meshes,
//! expressions, layers and the scene. Plain values and arithmetic: no I/O, no threads, no GPU.
//!
//! Spaces, from the world to bricks:
//! - *world*: physical units; voxel `(i, j, k)` of level 0 has its **centre** at `origin + (i, j, k) * spacing`.
//! - *voxel*: continuous level-0 voxels; voxel `i` spans `[i, i + 1)`, so the volume is the box `[0, extent)`.
//! - *level voxel*: voxel space divided by the level's factor (1 or a power of two per axis).
//! - *brick index*: level voxels divided by the brick edge.

pub mod apron;
pub mod bounds;
pub mod camera;
pub mod channel;
pub mod clip;
pub mod combination;
pub mod compositing;
pub mod counted;
mod cut_face;
mod ensure;
mod enum_all;
pub mod expression;
pub mod extremes;
pub mod float_slots;
mod foreground;
pub mod geometry;
pub mod gradients;
pub mod jitter;
mod label_boxes;
pub mod labels;
pub mod lattice;
pub mod layer;
pub mod lighting;
pub mod macrocells;
pub mod mesh;
pub mod mode;
pub mod near_name;
pub mod numbers;
pub mod occupancy;
pub mod orientation;
pub mod page;
pub mod picture;
pub mod placement;
pub mod preintegration;
pub mod pyramid;
pub mod ray;
pub mod sampling;
pub mod scene;
mod scene_check;
pub mod scene_error;
pub mod slice;
pub mod slot_encoding;
pub mod space;
pub mod stereo;
pub mod supersampling;
pub mod surface;
mod time_axis;
mod time_unit;
mod timeline;
pub mod transfer;
pub mod units;
mod viewpoint;
pub mod voxel_type;

pub use apron::{Apron, MAX_APRON};
pub use bounds::{ReachError, Standing};
pub use camera::{Camera, Frustum, PixelRect, Projection, ViewRays};
pub use channel::ChannelLook;
pub use clip::{Clip, ClipError, ClipPlane, MAX_CLIP_PLANES, MAX_PLANES};
pub use combination::Combination;
pub use compositing::{Blend, VolumeFrame};
pub use counted::{are, counted};
pub use cut_face::CutFace;
pub use expression::{Expression, ExpressionError, MAX_VOLUMES, Operand, PrecisionError};
pub use float_slots::{KeptSlots, Window};
pub use foreground::Foreground;
pub use geometry::{Geometry, box_corners};
pub use gradients::{GradientNodes, PaddedCodes};
pub use jitter::Jitter;
pub use label_boxes::LabelBoxes;
pub use labels::{LabelCodes, LabelColor, LabelLook};
pub use lattice::{Lattice, Segment};
pub use layer::SceneLayer;
pub use lighting::{Gradient, Lighting, LightingModel};
pub use macrocells::{MacroCells, OpaqueCodes};
pub use mesh::{Layer, Mesh, MeshCapacity, MeshError, MeshLook, MeshLookError, ShownMesh};
pub use mode::{Extreme, Mode};
pub use occupancy::{Occupancy, OccupancyBins};
pub use orientation::{Orientation, Side};
pub use page::{PAGE_EDGE_BRICKS, PageId, Paging};
pub use picture::{Difference, FrameSettings, Picture};
pub use placement::{Placement, PlacementError};
pub use preintegration::{Integrals, Medium};
pub use pyramid::{LevelGrid, Pyramid};
pub use ray::Ray;
pub use sampling::{Filter, Method, Needs, Sampling};
pub use scene::{LevelPolicy, Scene, SceneExpression};
pub use scene_check::StoreCounts;
pub use scene_error::{LayerError, SceneError};
pub use slice::Slice;
pub use slot_encoding::{FloatSlots, SlotEncoding, SlotFormat};
pub use space::{BrickId, BrickIndex, Extent, Level, VoxelBox, VoxelIndex};
pub use stereo::{Stereo, StereoError, StereoLayout};
pub use supersampling::{PictureSum, PixelSample, PixelSamples, PixelSamplesError};
pub use surface::{Isosurface, Surface};
pub use time_axis::{TimeAxis, TimeProblem};
pub use time_unit::{time_symbol, time_unit, time_unit_s};
pub use timeline::{Timeline, VolumeTime};
pub use transfer::{
    Region, Shape, Subject, TransferChoice, TransferFile, TransferFunction, TransferGrid, TransferTable,
};
pub use viewpoint::Viewpoint;
pub use voxel_type::{Voxel, VoxelType};

/// Default number of voxels along the edge of a brick's core.
pub const DEFAULT_BRICK_EDGE: u32 = 64;
