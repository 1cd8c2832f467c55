//! The panels beside the picture. Each shows the scene and returns the commands that the hand gives; none changes anything itself.

pub(crate) mod help;
pub(crate) mod histogram;
pub(crate) mod layers;
pub(crate) mod status;
pub(crate) mod view;
