//! A file map that outlives its file: where a truncation, a vanished network share or a failing disk has taken bytes away,
//! reading gives zeros instead of the signal (SIGBUS) that ends the process.
//!
//! The guard is a signal handler, installed with the first map. It looks the faulting address up in a table of all maps, puts
//! pages of zeros over the fault and returns, so that the read goes on. Zeros look like data: so whoever reads asks
//! [`GuardedMap::lost`] *after* it has copied or decoded, and takes nothing for true of a map that has lost bytes. A file that is cut
//! short within a page reads as zeros without any signal: where nothing else would find that (a checksum, say), readers ask the file for its length too.
//! A fault anywhere else, and a signal that somebody sent (it has no address), are passed on to the handler that was there before. In a
//! signal handler only atomics and system calls are allowed: so the table is a list of blocks that is never freed, and a
//! place in it is taken and given back by atomic stores.
//!
//! Cost: nothing while all goes well, but a scan of the table for each map that is made.

use memmap2::{Advice, Mmap};
use std::fs::File;
use std::ops::{Deref, Range};
use std::ptr::{null, null_mut};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering, fence};

/// A read-only memory map of a whole file. Bytes that are lost while it is mapped (by a truncation, or a disk or
/// network that fails) read as zeros, without a signal that ends the process.
///
/// Readers must ask [`GuardedMap::lost`] after they have copied or decoded, and trust nothing that they read from a map
/// that has lost bytes. Where a file is cut short within a page, the rest of that page reads as zeros although `lost`
/// is false: only a checksum or the length of the file shows that.
pub struct GuardedMap {
    map: Mmap,
    place: &'static Place,
}

impl GuardedMap {
    /// Maps a file, and installs the handler of SIGBUS signals with the first map of the process.
    ///
    /// # Errors
    /// If the operating system refuses the map or the handler.
    pub fn new(file: &File) -> std::io::Result<Self> {
        install()?;
        // SAFETY: the map is read-only, of pages that the handler keeps readable, and lent as bytes, for which every value is valid.
        // That nobody writes to the file meanwhile cannot be had of any file. Where somebody does, reads give old bytes or new
        // ones: so nothing that is read here may be trusted twice, and readers check what they have copied or decoded.
        let map = unsafe { Mmap::map(file) }?;
        let place = Place::take(map.as_ptr() as usize, map.len());
        Ok(Self { map, place })
    }

    /// Whether bytes of the file could not be read, so that zeros were read in their place.
    pub fn lost(&self) -> bool {
        // What was read before is read before: another thread's fault may have put the zeros there.
        fence(Ordering::Acquire);
        self.place.faults.load(Ordering::Acquire) > 0
    }

    /// Asks the kernel to read a range of bytes ahead. A refusal costs speed only.
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
        // Before the map goes: afterwards its addresses can be anybody's.
        self.place.give_back();
    }
}

/// A map's place in the table.
struct Place {
    /// Address of the first byte, or [`FREE`], or [`TAKEN`].
    start: AtomicUsize,
    /// Address past the last byte.
    end: AtomicUsize,
    /// How often the map has been mended.
    faults: AtomicUsize,
}

const FREE: usize = 0;
/// Not free any more, but not to be looked at yet.
const TAKEN: usize = 1;

/// Faults of a map after which everything behind the next one is given up: each hole costs the process up to two of its
/// mappings, of which it may have some ten thousand.
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
        // SAFETY: the pointer is null or that of a leaked block.
        unsafe { self.next.load(Ordering::Acquire).as_ref() }
    }

    /// The next block, made if there is none.
    fn next_or_new(&self) -> &'static Block {
        if let Some(next) = self.next() {
            return next;
        }
        let new: *mut Block = Box::into_raw(Box::new(Block::new()));
        let added = self.next.compare_exchange(null_mut(), new, Ordering::AcqRel, Ordering::Acquire);
        match added {
            // SAFETY: it came from a box, and is never freed.
            Ok(_) => unsafe { &*new },
            // SAFETY: another thread was faster: nobody else has seen the new one, and theirs is never freed.
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

    /// The place of the map that holds an address.
    fn of(address: usize) -> Option<&'static Self> {
        let holds = |place: &&Place| {
            let (start, end) = (place.start.load(Ordering::Acquire), place.end.load(Ordering::Acquire));
            // Where the place has changed hands meanwhile, the two do not belong together.
            start > TAKEN && (start..end).contains(&address) && place.start.load(Ordering::Acquire) == start
        };
        std::iter::successors(Some(&TABLE), |block| block.next()).find_map(|block| block.places.iter().find(holds))
    }
}

/// The handler before, a leaked box.
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
    // SAFETY: `sysconf` reads a constant. All-zero is a valid `sigaction`, and both calls get valid pointers or null. The
    // handler keeps to what a signal handler may do, and what it needs is stored before it is installed.
    unsafe {
        PAGE_BYTES.store(libc::sysconf(libc::_SC_PAGESIZE) as usize, Ordering::Release);
        let mut previous: libc::sigaction = std::mem::zeroed();
        checked(libc::sigaction(libc::SIGBUS, null(), &mut previous))?;
        PREVIOUS.store(Box::into_raw(Box::new(previous)), Ordering::Release);
        checked(set_handler())
    }
}

/// Makes [`on_bus_error`] the handler; returns what the system does.
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
    // SAFETY: the kernel passes what belongs to the signal; the handler was installed with `SA_SIGINFO`, so that is there.
    let info_read = unsafe { &*info };
    // Only the kernel's reports of an access that failed carry an address. Of a signal sent by `kill` or `sigqueue` the same bytes are
    // the sender and what it likes; one about memory found broken that nobody reads is no failed access.
    let is_fault = matches!(info_read.si_code, libc::BUS_ADRERR | libc::BUS_OBJERR | libc::BUS_MCEERR_AR);
    // SAFETY: signals with these codes have an address.
    let is_mended = is_fault && mend(unsafe { info_read.si_addr() } as usize);
    if !is_mended {
        pass_on(signal, info, context);
        if !is_fault {
            // Handlers before (Rust's own, for one) give the signal back its default and return, so that a fault comes again and ends the
            // process. One that was sent does not come again, and the maps are still to be guarded.
            set_handler();
        }
    }
}

/// Puts zeros over a fault in one of the maps; false if it is in none, or that is not possible.
fn mend(address: usize) -> bool {
    let Some(place) = Place::of(address) else { return false };
    let page_bytes = PAGE_BYTES.load(Ordering::Acquire);
    let first = address & !(page_bytes - 1);
    let is_last = place.faults.fetch_add(1, Ordering::Relaxed) + 1 >= MAX_HOLES;
    let bytes = if is_last { place.end.load(Ordering::Acquire) - first } else { page_bytes };
    let flags = libc::MAP_PRIVATE | libc::MAP_FIXED | libc::MAP_ANON;
    // SAFETY: the pages lie inside a map of ours (its last page is all its own), which cannot go away now: the access that failed
    // is this thread's, through a borrow of the map. A page that can still be read is replaced only past the last hole, by zeros,
    // with the same access; the fault was counted before, so whoever reads those zeros finds the map lost afterwards.
    let zeros = unsafe { libc::mmap(first as *mut libc::c_void, bytes, libc::PROT_READ, flags, -1, 0) };
    zeros != libc::MAP_FAILED
}

/// Does what would have been done without this handler.
fn pass_on(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the pointer is that of a leaked box, stored before this handler was installed. A handler that is neither the
    // default nor to be ignored is a function of the kind that its flags say. All-zero is a valid `sigaction`. `info` is the
    // kernel's, whose codes above 0 are its own reports.
    unsafe {
        let previous = &*PREVIOUS.load(Ordering::Acquire);
        match previous.sa_sigaction {
            libc::SIG_IGN if (*info).si_code <= 0 => {}
            libc::SIG_DFL | libc::SIG_IGN => {
                // The kernel does not let a fault be ignored. Raised again, the signal arrives when this handler returns.
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
        // From several threads, in and out of order, more often than there are holes.
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
        // A place is used again without its past.
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

    /// In a process of its own, which ends as it would without the handler.
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
        // SAFETY: read as bytes; that it cannot be read is the point.
        let unguarded = unsafe { Mmap::map(&file) }.unwrap();
        file.set_len(0).unwrap();
        std::process::exit(unguarded[5] as i32);
    }

    /// A signal that somebody sends has no address, whatever stands where one would be: here, that of a map.
    #[test]
    fn a_signal_that_is_sent_mends_nothing_and_leaves_the_guard() {
        let file = file_of(3 * page_bytes());
        let map = GuardedMap::new(&file).unwrap();
        // SAFETY: all-zero is a valid `siginfo_t`; its third word of 8 bytes, where faults have their address, is the sender's to fill.
        // The signal goes to this thread, so it is dealt with when the call returns.
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
