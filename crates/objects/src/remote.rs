//! A host or bucket, read by `object_store` on a runtime of tokio: the one place of a runtime in the workspace.
//!
//! After a passing fault a request is made again, up to [`TRIES`] times, after growing pauses of random length. An answer is checked
//! against the range asked for, and read up to its limit. [`MOST_AT_ONCE`] requests of a host are under way at a time; others wait for their turn.
//!
//! Objects kept on disk are asked for on condition that they changed, once for each reading of them; ranges of an object in a known state need no
//! request. While the server cannot be reached they are taken as they are, and counted.

mod aws_profile;
mod buckets;
mod faults;
mod joined;
mod limits;
mod wanted;

use crate::address::Address;
use crate::cancellation::Cancellation;
use crate::disk_cache::{DiskCache, Part};
use crate::fault::Fault;
use crate::link::Link;
use crate::objects::{Object, Objects, Version};
use crate::traffic::{BYTES, CANCELLED, FAILURES, REQUESTS, UNCONFIRMED, note_time};
use faults::fault_of;
use futures_util::StreamExt;
use futures_util::future::{Either, join_all, select, try_join_all};
use joined::{Joined, join};
use limits::{ANSWER_WAIT, CONNECT_WAIT, MOST_AT_ONCE};
use object_store::path::Path;
use object_store::{GetRange, ObjectStore};
use serde::de::IgnoredAny;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::ops::Range;
use std::pin::pin;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::sync::{OnceCell, Semaphore};
use tokio::time::{sleep, timeout};
use wanted::Wanted;

/// Requests made for one answer, at most.
const TRIES: u32 = 6;

/// After so many given up in a row a request is made once.
const MOST_GIVEN_UP: u32 = 3;

/// Pause before the second try; doubled for each further one.
const FIRST_PAUSE: Duration = Duration::from_millis(100);

/// The part that stands for an absent object.
const ABSENT: &str = "absent";

/// A server out of reach is left alone for so long by readings of kept parts.
const LEFT_ALONE: Duration = Duration::from_secs(30);

/// Objects of one host or bucket.
pub(crate) struct Remote {
    store: Box<dyn ObjectStore>,
    /// Whether the server knows ranges by their distance from the end: Azure's does not.
    has_suffixes: bool,
    /// Whether the server lists objects: those of buckets do.
    has_lists: bool,
    turns: Semaphore,
    link: Link,
    cache: Option<DiskCache>,
    /// When the server could not be reached last.
    unreached: Mutex<Option<Instant>>,
    /// Requests given up one after the other, though their faults pass elsewhere.
    given_up: AtomicU32,
    /// An object given by the server.
    given: OnceCell<String>,
    /// Whether the server refuses access to absent objects, as buckets do whose list is private.
    hides_absence: OnceCell<bool>,
}

/// The runtime of all requests.
fn runtime() -> io::Result<&'static Runtime> {
    static RUNTIME: OnceLock<Result<Runtime, String>> = OnceLock::new();
    let built = RUNTIME.get_or_init(|| {
        // A program around may have chosen another before.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let built =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("objects").enable_all().build();
        built.map_err(|error| error.to_string())
    });
    built.as_ref().map_err(|error| io::Error::other(error.clone()))
}

/// Waits for requests, unless this thread's are [cancelled](Cancellation) meanwhile.
fn wait<T>(requests: impl Future<Output = T>) -> io::Result<T> {
    let Some(cancellation) = Cancellation::current() else { return Ok(runtime()?.block_on(requests)) };
    let ended = runtime()?.block_on(async {
        match select(pin!(cancellation.cancelled()), pin!(requests)).await {
            Either::Left(_) => Err(Fault::Cancelled),
            Either::Right((answers, _)) => Ok(answers),
        }
    });
    Ok(ended?)
}

/// A request that counts as cancelled, if it is dropped before it ended.
struct Begun {
    has_ended: bool,
}

impl Drop for Begun {
    fn drop(&mut self) {
        CANCELLED.fetch_add(u64::from(!self.has_ended), Ordering::Relaxed);
    }
}

impl Remote {
    /// Sets a host or bucket up, without a request.
    ///
    /// # Errors
    /// If the address or the environment's settings do not fit.
    pub(crate) fn new(address: &Address) -> io::Result<Self> {
        let unfit = |error: object_store::Error| Fault::Unsupported(format!("{}: {error}", address.root()));
        // Sets the library of cryptography, which connections need.
        runtime()?;
        let store = buckets::connect(address).map_err(unfit)?;
        Ok(Self {
            store,
            has_suffixes: address.scheme != "az",
            has_lists: !address.scheme.starts_with("http"),
            turns: Semaphore::new(MOST_AT_ONCE),
            link: Link::default(),
            cache: buckets::cache(address),
            unreached: Mutex::default(),
            given_up: AtomicU32::new(0),
            given: OnceCell::new(),
            hides_absence: OnceCell::new(),
        })
    }

    fn read(&self, name: &str, wanted: &Wanted<'_>) -> io::Result<Object> {
        Ok(wait(self.read_kept(name, wanted, |_| true))??)
    }

    /// Reads an object's part from disk if the server confirms it or cannot be reached, else from the server; and keeps it if it is sound. Absence is
    /// kept, too.
    async fn read_kept(&self, name: &str, wanted: &Wanted<'_>, is_sound: fn(&[u8]) -> bool) -> Result<Object, Fault> {
        let Some((cache, place)) = self.cache.as_ref().zip(wanted.place()) else {
            return self.read_anew(name, wanted).await;
        };
        let (part, absence) = (Part { name, place }, Part { name, place: ABSENT.into() });
        let kept = cache.read(&part).filter(|kept| kept.bytes.len() as u64 <= wanted.most_bytes);
        let is_absent = kept.is_none() && cache.read(&absence).is_some();
        let read = match (&kept, is_absent) {
            (Some(_), _) | (_, true) if self.is_left_alone() => {
                Err(Fault::Unreachable { problem: "not reached before".into() })
            }
            (Some(kept), _) => self.read_patiently(name, &Wanted { unless: Some(kept), ..wanted.clone() }).await,
            (None, _) => self.read_anew(name, wanted).await.map(Some),
        };
        match read {
            Ok(None) => kept.ok_or_else(|| Fault::Lying { problem: "unchanged, as if it were kept here".into() }),
            Ok(Some(read)) => {
                if kept.is_some() || is_absent {
                    cache.forget(name);
                }
                if is_sound(&read.bytes) {
                    cache.write(&part, &read.version, &read.bytes);
                }
                Ok(read)
            }
            Err(fault) if fault.is_passing() && (kept.is_some() || is_absent) => {
                tracing::debug!(name, %fault, "as it was, unconfirmed");
                UNCONFIRMED.fetch_add(1, Ordering::Relaxed);
                self.leave_alone();
                kept.ok_or(Fault::Absent)
            }
            Err(fault) => {
                if kept.is_some() {
                    cache.forget(name);
                }
                if fault == Fault::Absent && !is_absent {
                    cache.write(&absence, &Version { bytes: 0, tag: Some(ABSENT.into()), is_settled: true }, &[]);
                }
                Err(fault)
            }
        }
    }

    fn is_left_alone(&self) -> bool {
        let unreached = *self.unreached.lock().unwrap_or_else(PoisonError::into_inner);
        unreached.is_some_and(|last| last.elapsed() < LEFT_ALONE)
    }

    fn leave_alone(&self) {
        let mut unreached = self.unreached.lock().unwrap_or_else(PoisonError::into_inner);
        if unreached.is_none_or(|last| last.elapsed() >= LEFT_ALONE) {
            *unreached = Some(Instant::now());
        }
    }

    /// Makes an unconditional request until it is answered or fails for good.
    async fn read_anew(&self, name: &str, wanted: &Wanted<'_>) -> Result<Object, Fault> {
        let read = self.read_patiently(name, wanted).await?;
        read.ok_or_else(|| Fault::Lying { problem: "unchanged, as if it were kept here".into() })
    }

    /// Makes a request until it is answered or fails for good; `None` if the object is as on condition. A server out of reach is asked once where the
    /// part is kept, or after it was out of reach a moment ago.
    async fn read_patiently(&self, name: &str, wanted: &Wanted<'_>) -> Result<Option<Object>, Fault> {
        let mut tries = 1;
        loop {
            let fault = match self.read_once(name, wanted).await {
                Ok(read) => {
                    *self.unreached.lock().unwrap_or_else(PoisonError::into_inner) = None;
                    self.given_up.store(0, Ordering::Relaxed);
                    return Ok(read);
                }
                Err(Fault::Forbidden { .. }) if self.hides_absence(name).await => Fault::Absent,
                Err(fault) => fault,
            };
            FAILURES.fetch_add(u64::from(fault != Fault::Absent), Ordering::Relaxed);
            let is_out_of_reach = matches!(fault, Fault::Unreachable { .. } | Fault::Slow { .. });
            let is_enough = wanted.unless.is_some() || self.is_left_alone();
            let most = if self.given_up.load(Ordering::Relaxed) < MOST_GIVEN_UP { TRIES } else { 1 };
            if !fault.is_passing() || tries >= most || is_enough && is_out_of_reach {
                self.given_up.fetch_add(u32::from(fault.is_passing()), Ordering::Relaxed);
                if is_out_of_reach {
                    self.leave_alone();
                }
                return Err(fault);
            }
            tracing::debug!(name, %fault, tries, "asked again");
            sleep(pause(tries)).await;
            tries += 1;
        }
    }

    /// Reads ranges from the server.
    fn ranges_anew(&self, name: &str, ranges: &[Range<u64>], version: Option<&Version>) -> io::Result<Vec<Vec<u8>>> {
        let joined = join(ranges);
        let parts = joined.iter().map(async |Joined { bytes: Range { start, end }, .. }| {
            let range = Some(GetRange::Bounded(*start..*end));
            let wanted = Wanted { range, version, ..Wanted::whole(end - start) };
            match start < end {
                true => self.read_anew(name, &wanted).await.map(|object| object.bytes),
                false => Ok(Vec::new()),
            }
        });
        let parts = wait(try_join_all(parts))??;
        let mut read = vec![Vec::new(); ranges.len()];
        for (Joined { bytes: Range { start, .. }, numbers }, part) in joined.iter().zip(parts) {
            for number in numbers {
                let Range { start: first, end } = ranges[*number];
                read[*number] = part[(first - start) as usize..(end - start) as usize].to_vec();
            }
        }
        Ok(read)
    }

    /// Whether an object to which access was refused is absent: the server refuses access to surely absent ones, which is asked once, and
    /// still gives one given before.
    async fn hides_absence(&self, name: &str) -> bool {
        let Some(given) = self.given.get() else { return false };
        let first_byte = Wanted { range: Some(GetRange::Bounded(0..1)), ..Wanted::whole(u64::MAX) };
        let look = async || {
            let absent = format!("{name}.{:016x}", RandomState::new().hash_one(name));
            matches!(self.read_once(&absent, &first_byte).await, Err(Fault::Forbidden { .. }))
        };
        *self.hides_absence.get_or_init(look).await && self.read_once(given, &first_byte).await.is_ok()
    }

    /// Reads an object of JSON. One that ends too early is asked for again, twice; then it is taken for the server's own.
    async fn read_document(&self, name: &str, wanted: &Wanted<'_>) -> Result<Object, Fault> {
        let is_sound = |bytes: &[u8]| serde_json::from_slice::<IgnoredAny>(bytes).is_ok();
        for _ in 0..2 {
            let object = self.read_kept(name, wanted, is_sound).await?;
            if object.bytes.trim_ascii_end().ends_with(b"}") {
                return Ok(object);
            }
            FAILURES.fetch_add(1, Ordering::Relaxed);
        }
        self.read_kept(name, wanted, is_sound).await
    }

    async fn read_once(&self, name: &str, wanted: &Wanted<'_>) -> Result<Option<Object>, Fault> {
        let path = Path::from_url_path(name).map_err(|error| Fault::Unsupported(error.to_string()))?;
        let _turn = self.turns.acquire().await.map_err(|error| Fault::Unsupported(error.to_string()))?;
        REQUESTS.fetch_add(1, Ordering::Relaxed);
        let mut request = Begun { has_ended: false };
        let read = self.request(name, &path, wanted).await;
        request.has_ended = true;
        read
    }

    async fn request(&self, name: &str, path: &Path, wanted: &Wanted<'_>) -> Result<Option<Object>, Fault> {
        let begun = Instant::now();
        let slow = || Fault::Slow { seconds: ANSWER_WAIT.as_secs() };
        let asked = timeout(CONNECT_WAIT + ANSWER_WAIT, self.store.get_opts(path, wanted.options()));
        let answer = match asked.await.map_err(|_| slow())? {
            Ok(answer) => Some(answer),
            Err(object_store::Error::NotModified { .. }) => None,
            Err(error) => return Err(fault_of(&error)),
        };
        if !self.given.initialized() {
            // Another one may be first.
            drop(self.given.set(name.to_owned()));
        }
        let latency = begun.elapsed();
        let Some(answer) = answer else {
            // To the readers it is as if the bytes had come: without them the link would take few such questions at a time.
            note_time(latency);
            self.link.note(wanted.unless.map_or(0, |kept| kept.bytes.len() as u64), latency);
            return Ok(None);
        };
        let version = wanted::version_of(&answer.meta);
        if wanted.is_head() {
            return Ok(Some(Object { bytes: Vec::new(), version }));
        }
        wanted.check(&answer, &version)?;
        let expected = answer.range.end - answer.range.start;
        let mut bytes = Vec::with_capacity(expected as usize);
        let mut parts = answer.into_stream();
        while let Some(part) = timeout(ANSWER_WAIT, parts.next()).await.map_err(|_| slow())? {
            let part = part.map_err(|error| fault_of(&error))?;
            BYTES.fetch_add(part.len() as u64, Ordering::Relaxed);
            bytes.extend_from_slice(&part);
            if bytes.len() as u64 > expected {
                return Err(Fault::Lying { problem: format!("more than the {expected} bytes announced") });
            }
        }
        if (bytes.len() as u64) < expected {
            return Err(Fault::Lying { problem: format!("{} of {expected} bytes announced", bytes.len()) });
        }
        note_time(begun.elapsed());
        self.link.note(expected, latency);
        Ok(Some(Object { bytes, version }))
    }
}

impl Objects for Remote {
    fn whole(&self, name: &str, most_bytes: u64) -> io::Result<Option<Object>> {
        present(self.read(name, &Wanted::whole(most_bytes)))
    }

    fn several(&self, names: &[String], most_bytes: u64) -> Vec<io::Result<Option<Object>>> {
        let wanted = Wanted::whole(most_bytes);
        let read = names.iter().map(async |name| match is_document(name) {
            true => self.read_document(name, &wanted).await,
            false => self.read_kept(name, &wanted, |_| true).await,
        });
        match wait(join_all(read)) {
            Ok(read) => read.into_iter().map(|object| present(object.map_err(io::Error::from))).collect(),
            Err(error) => names.iter().map(|_| Err(io::Error::new(error.kind(), error.to_string()))).collect(),
        }
    }

    fn kept(&self, name: &str) -> Option<Vec<u8>> {
        let part = Part { name, place: Wanted::whole(u64::MAX).place()? };
        Some(self.cache.as_ref()?.read(&part)?.bytes)
    }

    fn link(&self) -> &Link {
        &self.link
    }

    fn tail(&self, name: &str, bytes: u64) -> io::Result<Option<Object>> {
        let mut wanted = Wanted { range: Some(GetRange::Suffix(bytes)), ..Wanted::whole(bytes) };
        let known;
        if !self.has_suffixes {
            let Some(object) = present(self.read(name, &Wanted::whole(0)))? else {
                return Ok(None);
            };
            known = object.version;
            wanted.range = Some(GetRange::Bounded(known.bytes.saturating_sub(bytes)..known.bytes));
            wanted.version = Some(&known);
        }
        present(self.read(name, &wanted))
    }

    fn head(&self, name: &str, bytes: u64) -> io::Result<Option<Object>> {
        present(self.read(name, &Wanted { range: Some(GetRange::Bounded(0..bytes)), ..Wanted::whole(bytes) }))
    }

    fn ranges(&self, name: &str, ranges: &[Range<u64>], version: Option<&Version>) -> io::Result<Vec<Vec<u8>>> {
        let part = |range: &Range<u64>| Part { name, place: format!("{}-{}", range.start, range.end) };
        let kept = self.cache.as_ref().zip(version.filter(|version| version.tag.is_some() && version.is_settled));
        let find = |range: &Range<u64>| {
            let (cache, version) = kept?;
            let bytes = cache.read(&part(range)).filter(|kept| kept.version == *version)?.bytes;
            (bytes.len() as u64 == range.end - range.start).then_some(bytes)
        };
        let mut found: Vec<Option<Vec<u8>>> = ranges.iter().map(find).collect();
        let missing: Vec<usize> = (0..ranges.len()).filter(|i| found[*i].is_none()).collect();
        let read = self.ranges_anew(name, &missing.iter().map(|i| ranges[*i].clone()).collect::<Vec<_>>(), version)?;
        for (i, bytes) in missing.into_iter().zip(read) {
            if let Some((cache, version)) = kept {
                cache.write(&part(&ranges[i]), version, &bytes);
            }
            found[i] = Some(bytes);
        }
        Ok(found.into_iter().flatten().collect())
    }

    fn forget(&self, name: &str) {
        if let Some(cache) = &self.cache {
            cache.forget(name);
        }
    }

    fn folders(&self, name: &str) -> io::Result<Vec<String>> {
        let no_list =
            || Fault::Unsupported("the server keeps no list of its folders; name an image or array in it".into());
        if !self.has_lists {
            return Err(no_list().into());
        }
        let path = Path::from_url_path(name).map_err(|error| Fault::Unsupported(error.to_string()))?;
        REQUESTS.fetch_add(1, Ordering::Relaxed);
        let listed = runtime()?.block_on(self.store.list_with_delimiter(Some(&path)));
        let listed = listed.map_err(|error| match fault_of(&error) {
            Fault::Absent => Fault::Absent,
            fault @ (Fault::Forbidden { .. } | Fault::Unreachable { .. }) => fault,
            _ => no_list(),
        })?;
        let names = listed.common_prefixes.iter().filter_map(|path| path.filename());
        Ok(names.map(str::to_owned).collect())
    }
}

/// Whether an object is a document of Zarr, by its name.
fn is_document(name: &str) -> bool {
    let last = name.rsplit('/').next().unwrap_or(name);
    last.ends_with(".json") || last.starts_with(".z")
}

/// An object, unless it is absent.
fn present(read: io::Result<Object>) -> io::Result<Option<Object>> {
    match read {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        read => read.map(Some),
    }
}

/// The pause after so many tries: between half of its length and all of it.
fn pause(tries: u32) -> Duration {
    let random = RandomState::new().hash_one(tries) as f64 / u64::MAX as f64;
    (FIRST_PAUSE * (1 << (tries - 1))).mul_f64(0.5 + random / 2.0)
}

#[cfg(test)]
mod tests;
