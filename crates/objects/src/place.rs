//! Places of objects by address, the hosts and buckets known in this process, and documents read of late.

use crate::address::{Address, is_address};
use crate::fault::Fault;
use crate::objects::{Object, Objects, Version};
use std::collections::HashMap;
use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A name among the objects of a host or bucket.
#[derive(Clone)]
pub struct Place {
    /// The address before the name.
    root: Arc<str>,
    /// The objects of the host or bucket.
    pub objects: Arc<dyn Objects>,
    /// Folders and name, without slashes at the ends.
    pub name: String,
}

impl Place {
    /// The place of a name in this one.
    pub fn join(&self, inner: &str) -> Self {
        let name = if self.name.is_empty() { inner.to_owned() } else { format!("{}/{inner}", self.name) };
        Self { root: self.root.clone(), objects: self.objects.clone(), name }
    }

    /// Reads the object here, or takes the one [looked at ahead](Place::look_ahead), once: see [`Objects::whole`].
    ///
    /// # Errors
    /// As for [`Objects::whole`].
    pub fn whole(&self, most_bytes: u64) -> io::Result<Option<Object>> {
        match self.take_ahead() {
            Some(object) => Ok(object),
            None => self.objects.whole(&self.name, most_bytes),
        }
    }

    /// The object looked at ahead, of late and not taken before; within, `None` if it is absent.
    fn take_ahead(&self) -> Option<Option<Object>> {
        let key = (self.root.clone(), self.name.clone());
        let (read, object) = lock(&DOCUMENTS).as_mut()?.remove(&key)?;
        (read.elapsed() < KEPT).then(|| object.map(Arc::unwrap_or_clone))
    }

    /// Reads a document here, or finds the one read within the last five seconds: an opening looks at some again and again. `None` if there is none.
    ///
    /// # Errors
    /// As for [`Objects::whole`].
    pub fn document(&self, most_bytes: u64) -> io::Result<Option<Arc<Object>>> {
        self.look_up(std::slice::from_ref(&self.name), most_bytes).pop().unwrap_or(Ok(None))
    }

    /// Reads objects in folders here all at once, for [`Place::document`] and [`Place::whole`] to find.
    pub fn look_ahead(&self, inner: &[String], most_bytes: u64) {
        let names: Vec<String> = inner.iter().map(|inner| self.join(inner).name).collect();
        self.look_up(&names, most_bytes);
    }

    /// Whether the document here, or its absence, was read or told within the last five seconds.
    pub fn is_known(&self) -> bool {
        let key = (self.root.clone(), self.name.clone());
        lock(&DOCUMENTS).as_ref().and_then(|known| known.get(&key)).is_some_and(|(read, _)| read.elapsed() < KEPT)
    }

    /// The object here as it was kept on disk: see [`Objects::kept`].
    pub fn kept(&self) -> Option<Vec<u8>> {
        self.objects.kept(&self.name)
    }

    /// Takes a document as read now, absent without bytes: another one has told of it, whose state is its state.
    pub fn know(&self, document: Option<Vec<u8>>, teller: &Version) {
        let known = document.map(|bytes| {
            let version = Version { bytes: bytes.len() as u64, ..teller.clone() };
            Arc::new(Object { bytes, version })
        });
        let key = (self.root.clone(), self.name.clone());
        lock(&DOCUMENTS).get_or_insert_with(HashMap::new).insert(key, (Instant::now(), known));
    }

    /// Forgets all parts on disk of the object here: its bytes are damaged.
    pub fn forget(&self) {
        self.objects.forget(&self.name);
    }

    /// Forgets the documents read in this folder of late: it changed.
    pub fn look_again(&self) {
        let is_inside = |(root, name): &(Arc<str>, String)| {
            *root == self.root
                && name.strip_prefix(&*self.name).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        if let Some(documents) = lock(&DOCUMENTS).as_mut() {
            documents.retain(|key, _| !is_inside(key));
        }
    }

    fn look_up(&self, names: &[String], most_bytes: u64) -> Vec<io::Result<Option<Arc<Object>>>> {
        let key = |name: &String| (self.root.clone(), name.clone());
        let is_fresh = |read: &Instant| read.elapsed() < KEPT;
        let mut found: HashMap<String, Option<Arc<Object>>> = HashMap::new();
        {
            let mut documents = lock(&DOCUMENTS);
            let documents = documents.get_or_insert_with(HashMap::new);
            // Thousands may be told at once, and are looked up one by one.
            if documents.len() >= MOST_UNSWEPT && names.iter().any(|name| !documents.contains_key(&key(name))) {
                documents.retain(|_, (read, _)| is_fresh(read));
            }
            for name in names {
                if let Some((_, document)) = documents.get(&key(name)).filter(|(read, _)| is_fresh(read)) {
                    found.insert(name.clone(), document.clone());
                }
            }
        }
        let missing: Vec<String> = names.iter().filter(|name| !found.contains_key(*name)).cloned().collect();
        let mut failures = HashMap::new();
        for (name, read) in missing.iter().zip(self.objects.several(&missing, most_bytes)) {
            match read {
                Ok(object) => {
                    let document = object.map(Arc::new);
                    let kept = (Instant::now(), document.clone());
                    lock(&DOCUMENTS).get_or_insert_with(HashMap::new).insert(key(name), kept);
                    found.insert(name.clone(), document);
                }
                Err(error) => drop(failures.insert(name.clone(), error)),
            }
        }
        let of_name = |name: &String| match failures.remove(name) {
            Some(error) => Err(error),
            None => Ok(found.get(name).cloned().flatten()),
        };
        names.iter().map(of_name).collect()
    }

    /// Reads the object's end, of at least so many bytes, or takes all of the one [looked at ahead](Place::look_ahead), once: see [`Objects::tail`].
    ///
    /// # Errors
    /// As for [`Objects::tail`].
    pub fn tail(&self, bytes: u64) -> io::Result<Option<Object>> {
        match self.take_ahead() {
            Some(object) => Ok(object),
            None => self.objects.tail(&self.name, bytes),
        }
    }

    /// Reads the object's beginning: see [`Objects::head`].
    ///
    /// # Errors
    /// As for [`Objects::head`].
    pub fn head(&self, bytes: u64) -> io::Result<Option<Object>> {
        self.objects.head(&self.name, bytes)
    }

    /// Reads one range: see [`Objects::ranges`].
    ///
    /// # Errors
    /// As for [`Objects::ranges`].
    pub fn range(&self, range: Range<u64>, version: Option<&Version>) -> io::Result<Vec<u8>> {
        let mut read = self.objects.ranges(&self.name, &[range], version)?;
        read.pop().ok_or_else(|| Fault::Lying { problem: "no range of one asked for".into() }.into())
    }
}

/// The objects and the name at an address; `None` for other paths.
///
/// # Errors
/// If the address is of no known form, its bucket cannot be set up, or this build reads no addresses.
pub fn at(path: &Path) -> io::Result<Option<Place>> {
    if !is_address(path) {
        return Ok(None);
    }
    let text = path.to_str().unwrap_or_default();
    let address = Address::parse(text).map_err(Fault::Unsupported)?;
    let root: Arc<str> = address.root().into();
    let mut known = lock(&HOSTS);
    let hosts = known.get_or_insert_with(HashMap::new);
    let objects = match hosts.get(&root) {
        Some(objects) => objects.clone(),
        None => {
            let objects = connect(&address)?;
            hosts.insert(root.clone(), objects.clone());
            objects
        }
    };
    Ok(Some(Place { root, objects, name: address.path }))
}

/// How long a document is taken for the server's present one.
const KEPT: Duration = Duration::from_secs(5);

/// Documents beyond which those read earlier are forgotten.
const MOST_UNSWEPT: usize = 256;

/// Documents read of late by host or bucket and name, and when.
static DOCUMENTS: Mutex<Option<Documents>> = Mutex::new(None);

type Documents = HashMap<(Arc<str>, String), (Instant, Option<Arc<Object>>)>;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Hosts and buckets by the address before the path.
static HOSTS: Mutex<Option<Hosts>> = Mutex::new(None);

type Hosts = HashMap<Arc<str>, Arc<dyn Objects>>;

/// Forgets all hosts, and the documents read of late.
#[cfg(all(test, feature = "remote"))]
pub(crate) fn forget_hosts() {
    *lock(&HOSTS) = None;
    *lock(&DOCUMENTS) = None;
}

#[cfg(feature = "remote")]
fn connect(address: &Address) -> io::Result<Arc<dyn Objects>> {
    Ok(Arc::new(crate::remote::Remote::new(address)?))
}

#[cfg(not(feature = "remote"))]
fn connect(_: &Address) -> io::Result<Arc<dyn Objects>> {
    Err(Fault::Unsupported("addresses are not read by this build: it lacks the feature `remote`".into()).into())
}
