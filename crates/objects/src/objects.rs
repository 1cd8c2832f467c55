//! The trait behind which objects of a host or bucket are read.

use crate::link::Link;
use std::io;
use std::ops::Range;

/// State of an object when it was read: another one has another.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Version {
    /// Bytes of the whole object.
    pub bytes: u64,
    /// The server's tag for these bytes, or else the time of their last change; `None` if it tells neither.
    pub tag: Option<String>,
    /// Whether every later change has another tag: times of the last seconds, and weak tags beside them, do not tell two changes apart.
    pub is_settled: bool,
}

/// Bytes of an object, or of its end.
#[derive(Clone, Debug)]
pub struct Object {
    /// The bytes read.
    pub bytes: Vec<u8>,
    /// The object's state.
    pub version: Version,
}

/// Objects of one host or bucket. All calls block, and may be made by many threads.
pub trait Objects: Send + Sync {
    /// Reads an object of at most so many bytes; `None` if there is none.
    ///
    /// # Errors
    /// A [`Fault`](crate::Fault) of the server or the link, after retries.
    fn whole(&self, name: &str, most_bytes: u64) -> io::Result<Option<Object>>;

    /// Reads several objects at once: see [`Objects::whole`]. A document of JSON that ends too early is asked for again.
    fn several(&self, names: &[String], most_bytes: u64) -> Vec<io::Result<Option<Object>>>;

    /// Reads the last bytes of an object, or all if there are fewer; `None` if there is none.
    ///
    /// # Errors
    /// As for [`Objects::whole`].
    fn tail(&self, name: &str, bytes: u64) -> io::Result<Option<Object>>;

    /// Reads the first bytes of an object, or all if there are fewer; `None` if there is none.
    ///
    /// # Errors
    /// As for [`Objects::whole`].
    fn head(&self, name: &str, bytes: u64) -> io::Result<Option<Object>>;

    /// Reads ranges of an object, each whole; of a known state, if one is given.
    ///
    /// # Errors
    /// As for [`Objects::whole`]; or if the object is absent, changed, or ends before.
    fn ranges(&self, name: &str, ranges: &[Range<u64>], version: Option<&Version>) -> io::Result<Vec<Vec<u8>>>;

    /// The whole object as it was kept on this machine's disk, without a question to the server; `None` if it is not kept.
    fn kept(&self, name: &str) -> Option<Vec<u8>>;

    /// The link to the host.
    fn link(&self) -> &Link;

    /// Forgets all parts of an object on disk: its bytes are damaged.
    fn forget(&self, name: &str);

    /// Names of the folders in a folder.
    ///
    /// # Errors
    /// As for [`Objects::whole`]; or if the server keeps no list.
    fn folders(&self, name: &str) -> io::Result<Vec<String>>;
}
