//! Settings of all addresses of a process, by the names of AWS's own tools.

use crate::cache_folder::cache_folder;
use std::path::PathBuf;
use std::sync::{OnceLock, PoisonError, RwLock};

/// How hosts and buckets are reached, and where their objects are kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Address of a service of S3's kind, other than AWS's.
    pub endpoint: Option<String>,
    /// Region of the bucket.
    pub region: Option<String>,
    /// Whether requests go without a signature although credentials are there.
    pub no_sign_request: bool,
    /// Folder in which objects are kept over sessions; `None` to keep none.
    pub cache_folder: Option<PathBuf>,
    /// Most bytes kept there, of all hosts and buckets; 0 to keep none.
    pub cache_bytes: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            endpoint: None,
            region: None,
            no_sign_request: false,
            // This crate's own tests name theirs.
            cache_folder: cache_folder().filter(|_| !cfg!(test)),
            cache_bytes: DEFAULT_CACHE_BYTES,
        }
    }
}

/// Most bytes of objects kept on disk, unless other settings are made.
pub const DEFAULT_CACHE_BYTES: u64 = 10 << 30;

static SETTINGS: OnceLock<RwLock<Settings>> = OnceLock::new();

/// Sets how hosts and buckets are reached from now on; those reached before stay as they are.
pub fn configure(settings: Settings) {
    *shared().write().unwrap_or_else(PoisonError::into_inner) = settings;
}

/// Most bytes of objects kept on disk, by the settings now.
pub fn cache_bytes() -> u64 {
    shared().read().unwrap_or_else(PoisonError::into_inner).cache_bytes
}

/// The settings now.
#[cfg(feature = "remote")]
pub(crate) fn settings() -> Settings {
    shared().read().unwrap_or_else(PoisonError::into_inner).clone()
}

fn shared() -> &'static RwLock<Settings> {
    SETTINGS.get_or_init(RwLock::default)
}
