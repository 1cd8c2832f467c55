//! Readers of foreign formats as one streaming [`Source`] trait. Knows nothing of stores.

mod error;
mod source;

pub use error::ImportError;
pub use source::{Access, Source, SourceInfo};
