//! A panic anywhere in a pack ends it with the panic's message, and leaves a pack that can be resumed.

use super::*;
use brickyard_import::Lent;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Panics at some call of a kind, counted from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
enum At {
    Read(i64),
    Lend(i64),
    Constant(i64),
    Announce(i64),
    /// A change to the file system: by the writer or the settler.
    Change(i64),
    Advanced(i64),
    Aprons(i64),
}

struct Faulty {
    array: Array<u8>,
    at: At,
    /// Remaining calls of this kind.
    left: AtomicI64,
}

impl Faulty {
    fn new(access: Access, at: At) -> Self {
        let array = Array { access, ..Array::new([70, 40, 75], |p| value(p) as u8) };
        let (At::Read(n) | At::Lend(n) | At::Constant(n) | At::Announce(n)) = at else {
            let (At::Change(n) | At::Advanced(n) | At::Aprons(n)) = at else { unreachable!() };
            return Self { array, at, left: AtomicI64::new(n) };
        };
        Self { array, at, left: AtomicI64::new(n) }
    }

    fn call(&self, is_mine: bool) {
        assert!(!is_mine || self.left.fetch_sub(1, Ordering::SeqCst) != 0, "out of bounds, say");
    }
}

impl Source for Faulty {
    fn info(&self) -> &SourceInfo {
        &self.array.info
    }
    fn access(&self) -> Access {
        self.array.access
    }
    fn read_box(&self, t: u32, c: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.call(matches!(self.at, At::Read(_)));
        self.array.read_box(t, c, region, out)
    }
    fn lend(&self, _: u32, _: u32, _: VoxelBox, _: &mut dyn FnMut(Lent<'_>)) -> Result<bool, ImportError> {
        self.call(matches!(self.at, At::Lend(_)));
        Ok(false)
    }
    fn constant_in(&self, _: u32, _: u32, _: VoxelBox) -> Option<f64> {
        self.call(matches!(self.at, At::Constant(_)));
        None
    }
    fn announce(&self, _: u32, _: u32, _: VoxelBox) {
        self.call(matches!(self.at, At::Announce(_)));
    }
}

impl Progress for Faulty {
    fn advanced(&self, _: u64, _: u64) {
        self.call(matches!(self.at, At::Advanced(_)));
    }
    fn aprons(&self, _: u64, _: u64) {
        self.call(matches!(self.at, At::Aprons(_)));
    }
}

/// Packs in a thread of its own, which must end in time; returns its result or its panic.
fn ends(store: &Path, faulty: Faulty, options: &PackOptions) -> Result<PackReport, PackError> {
    let (what, (to_watchdog, ended)) = (faulty.at, channel());
    let (store, options) = (store.to_path_buf(), options.clone());
    std::thread::spawn(move || {
        let fuse = match faulty.at {
            At::Change(n) => n,
            _ => i64::MAX,
        };
        let disk = Trial { fuse: Some(AtomicI64::new(fuse)), panics: true, ..Trial::default() }.disk();
        let faulty = Arc::new(faulty);
        to_watchdog.send(pack_on(&disk, &*faulty, &store, &options, &*faulty)).unwrap();
    });
    match ended.recv_timeout(Duration::from_secs(60)) {
        Ok(done) => done,
        Err(RecvTimeoutError::Timeout) => panic!("{what:?}: the pack hangs"),
        // Before the threads start, or after: on the caller's own.
        Err(RecvTimeoutError::Disconnected) => {
            Err(PackError::Panic { words: CALLER.into(), store: "".into(), done: 0, total: 0 })
        }
    }
}

const CALLER: &str = "the caller's own thread";
const SAID: [&str; 2] = ["out of bounds, say", "a thread that changes files"];

/// Hides expected panics: each trace takes longer than a pack.
fn silence() {
    let previous = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if !panic.payload_as_str().is_some_and(|words| SAID.contains(&words)) {
            previous(panic);
        }
    }));
}

#[test]
fn a_panic_in_any_thread_ends_the_pack_and_is_told() {
    silence();
    let fresh = PackOptions { aprons: 1, threads: 3, ..options(VoxelType::U8) };
    let expected = packed(&Array::new([70, 40, 75], |p| value(p) as u8), &fresh);
    let calls = [0, 1, 20];
    let kinds: [fn(i64) -> At; 7] =
        [At::Read, At::Lend, At::Constant, At::Announce, At::Change, At::Advanced, At::Aprons];
    for access in [Access::Box, Access::Planes] {
        let mut told = 0;
        for at in kinds.iter().flat_map(|kind| calls.map(kind)).chain((7..160).step_by(17).map(At::Change)) {
            let dir = tempfile::tempdir().unwrap();
            let store = dir.path().join("s.zarr");
            match ends(&store, Faulty::new(access, at), &fresh) {
                // There are fewer calls than this.
                Ok(_) => assert_same(&expected, &files(&store), &format!("{access:?} {at:?}")),
                Err(PackError::Panic { words, .. }) => {
                    assert!(SAID.contains(&words.as_str()) || words == CALLER, "{access:?} {at:?}: {words}");
                    told += 1;
                    let resume = PackOptions { exists: Exists::Resume, ..fresh.clone() };
                    pack(&Faulty::new(access, At::Read(-1)), &store, &resume, &()).unwrap();
                    assert_same(&expected, &files(&store), &format!("{access:?} {at:?}, resumed"));
                }
                Err(error) => panic!("{access:?} {at:?}: {error}"),
            }
        }
        assert!(told >= 16, "{access:?}: {told}");
    }
}
