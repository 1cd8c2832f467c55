//! The panels beside the picture. Each shows a part of the window's state and edits it in place; the window makes commands of what it finds changed.

pub(crate) mod diagnostics;
pub(crate) mod help;
pub(crate) mod histogram;
pub(crate) mod layers;
pub(crate) mod menu;
pub(crate) mod status;
pub(crate) mod view;
