//! A file map that outlives its file: bytes lost to a truncation, a vanished network share or a failing disk read as zeros instead of raising the
//! signal (SIGBUS) that ends the process.
//!
//! A signal handler, installed with the first map, looks the faulting address up in a table of all maps, covers the fault with pages of zeros and
//! returns, so the read goes on. Zeros look like data: readers check [`GuardedMap::lost`] *after* copying or decoding, and discard everything from a
//! map with lost bytes. A file cut short within a page reads as zeros without a signal; readers without a checksum or the like compare the file's
//! length too. Faults elsewhere, and signals sent by a process (they have no address), go to the previous handler. A signal handler may only use
//! atomics and system calls, so the table is a list of blocks, never freed, whose places are taken and returned by atomic stores.
//!
//! Cost: a scan of the table for each new map, otherwise nothing unless a fault occurs.

use memmap2::{Advice, Mmap};
use std::fs::File;
use std::ops::{Deref, Range};
use std::ptr::{null, null_mut};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering, fence};

/// Read-only memory map of a whole file. Bytes lost while it is mapped (by a truncation, or a failing disk or network) read as zeros, without a fatal
/// signal.
///
/// Check [`GuardedMap::lost`] after copying or decoding, and discard everything read from a map with lost bytes. In a file cut short within a page,
/// the rest of the page reads as zeros although `lost` is false: only a checksum or the file's length reveals it.
pub struct GuardedMap {
    map: Mmap,
    place: &'static Place,
}

impl GuardedMap {
    /// Maps a file. The first map of the process installs the SIGBUS handler.
    ///
    /// # Errors
    /// If the operating system refuses the map or the handler.
    pub fn new(file: &File) -> std::io::Result<Self> {
        install()?;
        // SAFETY: the map is read-only, its pages are kept readable by the handler, and it is lent as bytes, for which every value is valid. No file
        // can be protected from writers. Under a concurrent write, reads give old or new bytes: nothing read here may be trusted twice, and readers
        // check their copied or decoded data.
        let map = unsafe { Mmap::map(file) }?;
        let place = Place::take(map.as_ptr() as usize, map.len());
        Ok(Self { map, place })
    }

    /// Whether bytes of the file could not be read and were replaced by zeros.
    pub fn lost(&self) -> bool {
        // Earlier reads must precede this load: another thread's fault may have put the zeros there.
        fence(Ordering::Acquire);
        self.place.faults.load(Ordering::Acquire) > 0
    }

    /// Requests read-ahead of a range of bytes from the kernel. A refusal costs speed only.
    pub fn advise(&self, range: Range<usize>) {
        if let Err(error) = self.map.advise_range(Advice::WillNeed, range.start, range.len()) {
            tracing::debug!(%error, "madvise");
        }
    }
}

impl Deref for GuardedMap {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map
    }
}

impl Drop for GuardedMap {
    fn drop(&mut self) {
        // Before the unmap, after which the addresses may be reused.
        self.place.give_back();
    }
}

/// An entry of the table, for one map.
struct Place {
    /// Address of the first byte, or [`FREE`], or [`TAKEN`].
    start: AtomicUsize,
    /// Address past the last byte.
    end: AtomicUsize,
    /// Number of repaired faults.
    faults: AtomicUsize,
}

const FREE: usize = 0;
/// No longer free, not yet valid.
const TAKEN: usize = 1;

/// The fault of a map, counted from 1, at which all behind it is given up: each hole costs the process up to two of its some ten thousand mappings.
const MAX_HOLES: usize = 8;

struct Block {
    places: [Place; 256],
    /// Null, or a block that is never freed.
    next: AtomicPtr<Block>,
}

static TABLE: Block = Block::new();

impl Block {
    const fn new() -> Self {
        Self { places: [const { Place::new() }; 256], next: AtomicPtr::new(null_mut()) }
    }

    fn next(&self) -> Option<&'static Block> {
        // SAFETY: the pointer is null or points to a leaked block.
        unsafe { self.next.load(Ordering::Acquire).as_ref() }
    }

    /// The next block, created if missing.
    fn next_or_new(&self) -> &'static Block {
        if let Some(next) = self.next() {
            return next;
        }
        let new: *mut Block = Box::into_raw(Box::new(Block::new()));
        let added = self.next.compare_exchange(null_mut(), new, Ordering::AcqRel, Ordering::Acquire);
        match added {
            // SAFETY: it came from a box, and is never freed.
            Ok(_) => unsafe { &*new },
            // SAFETY: another thread was faster: the new block is still private to this one, and theirs is never freed.
            Err(theirs) => unsafe {
                drop(Box::from_raw(new));
                &*theirs
            },
        }
    }
}

impl Place {
    const fn new() -> Self {
        Self { start: AtomicUsize::new(FREE), end: AtomicUsize::new(0), faults: AtomicUsize::new(0) }
    }

    fn take(start: usize, bytes: usize) -> &'static Self {
        let mut block = &TABLE;
        loop {
            let is_mine =
                |place: &&Place| place.start.compare_exchange(FREE, TAKEN, Ordering::AcqRel, Ordering::Relaxed).is_ok();
            if let Some(place) = block.places.iter().find(is_mine) {
                place.end.store(start + bytes, Ordering::Release);
                place.faults.store(0, Ordering::Relaxed);
                place.start.store(start, Ordering::Release);
                return place;
            }
            block = block.next_or_new();
        }
    }

    fn give_back(&self) {
        self.start.store(FREE, Ordering::Release);
    }

    /// The place of the map containing an address.
    fn of(address: usize) -> Option<&'static Self> {
        let holds = |place: &&Place| {
            let (start, end) = (place.start.load(Ordering::Acquire), place.end.load(Ordering::Acquire));
            // If the place was reused meanwhile, the two loads do not belong together.
            start > TAKEN && (start..end).contains(&address) && place.start.load(Ordering::Acquire) == start
        };
        std::iter::successors(Some(&TABLE), |block| block.next()).find_map(|block| block.places.iter().find(holds))
    }
}

/// The previous handler, a leaked box.
static PREVIOUS: AtomicPtr<libc::sigaction> = AtomicPtr::new(null_mut());
static PAGE_BYTES: AtomicUsize = AtomicUsize::new(0);

/// Installs the handler, once.
fn install() -> std::io::Result<()> {
    static DONE: OnceLock<Result<(), i32>> = OnceLock::new();
    let done = DONE.get_or_init(|| install_now().map_err(|error| error.raw_os_error().unwrap_or(0)));
    done.map_err(std::io::Error::from_raw_os_error)
}

fn install_now() -> std::io::Result<()> {
    let checked = |code: libc::c_int| if code == 0 { Ok(()) } else { Err(std::io::Error::last_os_error()) };
    // SAFETY: `sysconf` reads a constant. All-zero is a valid `sigaction`, and both calls get valid pointers or null. The handler does only
    // signal-safe work, and the values it needs are stored before its installation.
    unsafe {
        PAGE_BYTES.store(libc::sysconf(libc::_SC_PAGESIZE) as usize, Ordering::Release);
        let mut previous: libc::sigaction = std::mem::zeroed();
        checked(libc::sigaction(libc::SIGBUS, null(), &mut previous))?;
        PREVIOUS.store(Box::into_raw(Box::new(previous)), Ordering::Release);
        checked(set_handler())
    }
}

/// Makes [`on_bus_error`] the handler; returns the system call's result.
fn set_handler() -> libc::c_int {
    // SAFETY: all-zero is a valid `sigaction`; the call gets a valid pointer and null.
    unsafe {
        let mut action: libc::sigaction = std::mem::zeroed();
        action.sa_sigaction = on_bus_error as *const () as usize;
        action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
        libc::sigaction(libc::SIGBUS, &action, null_mut())
    }
}

extern "C" fn on_bus_error(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the kernel passes the signal's own info, present because the handler was installed with `SA_SIGINFO`.
    let info_read = unsafe { &*info };
    // Only the kernel's reports of a failed access carry an address. In a signal sent by `kill` or `sigqueue` the same bytes hold the sender and its
    // payload; a report of broken memory without a reader is no failed access.
    let is_fault = matches!(info_read.si_code, libc::BUS_ADRERR | libc::BUS_OBJERR | libc::BUS_MCEERR_AR);
    // SAFETY: signals with these codes have an address.
    let is_mended = is_fault && mend(unsafe { info_read.si_addr() } as usize);
    if !is_mended {
        pass_on(signal, info, context);
        if !is_fault {
            // Earlier handlers (Rust's own, for one) restore the signal's default and return, so a fault recurs and ends the process. A sent signal
            // does not recur, and the maps still need their guard.
            set_handler();
        }
    }
}

/// Covers a fault in one of the maps with zeros; returns false if it lies in none, or the system refuses.
fn mend(address: usize) -> bool {
    let Some(place) = Place::of(address) else { return false };
    let page_bytes = PAGE_BYTES.load(Ordering::Acquire);
    let first = address & !(page_bytes - 1);
    let is_last = place.faults.fetch_add(1, Ordering::Relaxed) + 1 >= MAX_HOLES;
    let bytes = if is_last { place.end.load(Ordering::Acquire) - first } else { page_bytes };
    let flags = libc::MAP_PRIVATE | libc::MAP_FIXED | libc::MAP_ANON;
    // SAFETY: the pages lie inside one of our maps (whose last page is all its own). It cannot go away now: the failed access is this thread's,
    // through a borrow of the map. Readable pages are replaced only past the last hole, by zeros with the same access; the fault was counted before,
    // so readers of those zeros find the map lost afterwards.
    let zeros = unsafe { libc::mmap(first as *mut libc::c_void, bytes, libc::PROT_READ, flags, -1, 0) };
    zeros != libc::MAP_FAILED
}

/// Does as the system would without this handler.
fn pass_on(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the pointer is to a leaked box, stored before this handler was installed. A handler other than the default and "ignore" is a function
    // of the kind given by its flags. All-zero is a valid `sigaction`. `info` is the kernel's; codes above 0 are its own reports.
    unsafe {
        let previous = &*PREVIOUS.load(Ordering::Acquire);
        match previous.sa_sigaction {
            libc::SIG_IGN if (*info).si_code <= 0 => {}
            libc::SIG_DFL | libc::SIG_IGN => {
                // The kernel does not allow a fault to be ignored. Raised again, the signal arrives when this handler returns.
                let mut default: libc::sigaction = std::mem::zeroed();
                default.sa_sigaction = libc::SIG_DFL;
                libc::sigaction(signal, &default, null_mut());
                libc::raise(signal);
            }
            handler if previous.sa_flags & libc::SA_SIGINFO != 0 => {
                type Handler = extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void);
                std::mem::transmute::<usize, Handler>(handler)(signal, info, context);
            }
            handler => std::mem::transmute::<usize, extern "C" fn(libc::c_int)>(handler)(signal),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;
    use std::process::Command;

    fn file_of(bytes: usize) -> File {
        let file = tempfile::tempfile().unwrap();
        std::os::unix::fs::FileExt::write_all_at(&file, &vec![7; bytes], 0).unwrap();
        file
    }

    fn page_bytes() -> usize {
        install().unwrap();
        PAGE_BYTES.load(Ordering::Acquire)
    }

    #[test]
    fn what_a_truncation_takes_away_reads_as_zeros() {
        let page = page_bytes();
        let (file, other) = (file_of(100 * page), file_of(3 * page));
        let (map, other_map) = (GuardedMap::new(&file).unwrap(), GuardedMap::new(&other).unwrap());
        assert!(map.iter().all(|&b| b == 7) && !map.lost());
        file.set_len(10 * page as u64 + 5).unwrap();
        // The kernel fills the file's last page with zeros.
        assert!(map[..10 * page + 5].iter().all(|&b| b == 7) && map[10 * page + 5..11 * page].iter().all(|&b| b == 0));
        assert!(!map.lost());
        // From several threads, in and out of order, with more faults than allowed holes.
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let map = &map;
                let pages = (11..100).map(move |i| if thread % 2 == 0 { i } else { 110 - i });
                scope.spawn(move || pages.for_each(|i| assert_eq!(map[i * page + thread], 0)));
            }
        });
        assert!(map.lost());
        assert!(map[..10 * page].iter().all(|&b| b == 7), "what is there stays");
        assert!(other_map.iter().all(|&b| b == 7) && !other_map.lost());
        // A reused place forgets its past.
        drop(map);
        assert!(!GuardedMap::new(&other).unwrap().lost());
    }

    #[test]
    fn there_is_a_place_for_any_number_of_maps() {
        let page = page_bytes();
        let file = file_of(2 * page);
        let maps: Vec<_> = (0..700).map(|_| GuardedMap::new(&file).unwrap()).collect();
        file.set_len(0).unwrap();
        for map in maps.iter().rev().step_by(100) {
            assert!(map.iter().all(|&b| b == 0) && map.lost());
        }
        let address = maps[650].as_ptr() as usize;
        assert!(Place::of(address).is_some());
        drop(maps);
        assert!(Place::of(address).is_none());
    }

    /// Runs in a child process, which ends as it would without the handler.
    #[test]
    fn a_fault_elsewhere_still_ends_the_process() {
        const CHILD: &str = "BRICKYARD_TEST_BUS_ERROR";
        if std::env::var_os(CHILD).is_none() {
            let name = "guarded_map::tests::a_fault_elsewhere_still_ends_the_process";
            let child = Command::new(std::env::current_exe().unwrap()).args(["--exact", name]).env(CHILD, "1").output();
            return assert_eq!(child.unwrap().status.signal(), Some(libc::SIGBUS));
        }
        let file = file_of(9);
        let _guarded = GuardedMap::new(&file).unwrap();
        // SAFETY: read as bytes; failing to read them is the point.
        let unguarded = unsafe { Mmap::map(&file) }.unwrap();
        file.set_len(0).unwrap();
        std::process::exit(unguarded[5] as i32);
    }

    /// A sent signal has no address, whatever its bytes hold in the address's place: here, the address of a map.
    #[test]
    fn a_signal_that_is_sent_mends_nothing_and_leaves_the_guard() {
        let file = file_of(3 * page_bytes());
        let map = GuardedMap::new(&file).unwrap();
        // SAFETY: all-zero is a valid `siginfo_t`; its third word of 8 bytes, the address of a fault, is the sender's to fill. The signal goes to
        // this thread, so it is handled before the call returns.
        let sent = unsafe {
            let mut info: libc::siginfo_t = std::mem::zeroed();
            info.si_signo = libc::SIGBUS;
            info.si_code = libc::SI_QUEUE;
            (&raw mut info).cast::<u64>().add(2).write(map.as_ptr() as u64);
            libc::syscall(libc::SYS_rt_tgsigqueueinfo, libc::getpid(), libc::gettid(), libc::SIGBUS, &raw const info)
        };
        assert_eq!(sent, 0);
        assert!(map.iter().all(|&b| b == 7) && !map.lost(), "nothing was wrong with the map");
        file.set_len(0).unwrap();
        assert!(map.iter().all(|&b| b == 0) && map.lost(), "and now there is");
    }
}
