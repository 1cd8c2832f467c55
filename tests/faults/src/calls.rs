//! Replacements for libc's functions. Each finds its path, applies the rules, makes the call (to the kernel, or for listings to
//! libc's own function), and records it.

use crate::kernel::{self, call, fail, keeping_errno, path_at, path_of};
use crate::record::{self, Entry};
use crate::rules::{Action, Call, Settings, settings};
use libc::{c_char, c_int, c_long, c_uint, c_void, iovec, mode_t, off_t, size_t, ssize_t};
use std::ffi::CStr;
use std::sync::OnceLock;
use std::time::Duration;

/// A call on a file below the folder, and its rule's action.
struct Site {
    settings: &'static Settings,
    call: Call,
    path: String,
    action: Option<Action>,
}

/// The action of the rules on a call; `None` if the call is on no file below the folder. Waits or ends the process if a rule
/// requires it.
fn site(call: Call, path: impl FnOnce() -> Option<String>) -> Option<Site> {
    let settings = settings()?;
    let path = path().filter(|path| path.split('\t').any(|path| settings.concerns(path)))?;
    let action = settings.meet(call, &path);
    match action {
        Some(Action::Kill) => kernel::kill_self(),
        Some(Action::Delay(millis)) => std::thread::sleep(Duration::from_millis(millis)),
        _ => {}
    }
    Some(Site { settings, call, path, action })
}

impl Site {
    /// Makes the call, unless a rule makes it fail or lie, and records it with `number`.
    fn run(self, number: i64, real: impl FnOnce() -> i64) -> i64 {
        let turn = record::turn(self.settings);
        let result = match self.action {
            Some(Action::Fail(error)) => fail(error),
            Some(Action::Lie) => 0,
            _ => real(),
        };
        keeping_errno(|| {
            let lied = self.action == Some(Action::Lie);
            let result = if lied { -1 } else { result };
            record::add(self.settings, &Entry { call: self.call, result, number, path: &self.path, bytes: &[] });
            drop(turn);
            if result >= 0 {
                self.cut();
            }
        });
        result
    }

    /// Cuts the file to half its length or to nothing, and records it, if a rule requires it.
    fn cut(&self) {
        let Some(Action::Cut { halves }) = self.action else { return };
        let length = kernel::length(&self.path).unwrap_or(0) / 2 * halves as i64;
        kernel::truncate(&self.path, length);
        let call = Call::Truncate;
        record::add(self.settings, &Entry { call, result: 0, number: length, path: &self.path, bytes: &[] });
    }

    /// The number of bytes to read or write: `count`, or half of it under a rule.
    fn allowed(&self, count: usize) -> usize {
        match self.action {
            Some(Action::Short | Action::Tear) => count.div_ceil(2),
            _ => count,
        }
    }

    /// A position in something of `length` bytes: always the same for the same file.
    fn place(&self, length: usize) -> usize {
        let hash = self.path.bytes().fold(7u64, |h, b| (h ^ b as u64).wrapping_mul(0x100_0000_01b3));
        (hash >> 20) as usize % length.max(1)
    }
}

/// Makes a system call with a number as its result, on numbers and pointers, under the rules for its `kind`. `path` is the call's
/// file, and `number` is recorded with it.
unsafe fn simple(
    kind: Call,
    path: impl FnOnce() -> Option<String>,
    number: i64,
    system_call: i64,
    a: [usize; 6],
) -> i64 {
    // SAFETY: the caller passes on its own caller's promise to the kernel.
    let real = || unsafe { call(system_call, a) };
    match site(kind, path) {
        Some(site) => site.run(number, real),
        None => real(),
    }
}

unsafe fn open_at(folder: c_int, name: *const c_char, flags: c_int, mode: mode_t) -> c_int {
    // SAFETY: the caller promises a string.
    let path = || unsafe { path_at(folder, name) };
    let a = [folder as usize, name as usize, flags as usize, mode as usize, 0, 0];
    // SAFETY: as the caller promises.
    unsafe { simple(Call::Open, path, flags as i64, libc::SYS_openat, a) as c_int }
}

/// Reads through `real`, which takes the number of bytes. `first` is their destination; a rule may change one of them.
fn reading(file: c_int, bytes: usize, first: *mut u8, real: impl FnOnce(usize) -> i64) -> ssize_t {
    let Some(site) = site(Call::Read, || path_of(file)) else { return real(bytes) as ssize_t };
    let allowed = site.allowed(bytes);
    let flip = (site.action == Some(Action::Flip)).then(|| site.place(1 << 20));
    let result = site.run(bytes as i64, || real(allowed));
    if let Some(place) = flip.filter(|_| result > 0) {
        // SAFETY: this many bytes were read to the caller's destination.
        unsafe { *first.add(place % result as usize) ^= 0x10 };
    }
    result as ssize_t
}

/// Writes through `real`, which takes the number of bytes. `offset` is their place in the file; `None` is the file's position,
/// queried afterwards.
fn writing(file: c_int, bytes: &[u8], offset: Option<i64>, real: impl FnOnce(usize) -> i64) -> ssize_t {
    let Some(site) = site(Call::Write, || path_of(file)) else { return real(bytes.len()) as ssize_t };
    let turn = record::turn(site.settings);
    let result = match site.action {
        Some(Action::Fail(error)) => fail(error),
        Some(Action::Lie) => return bytes.len() as ssize_t,
        _ => real(site.allowed(bytes.len())),
    };
    keeping_errno(|| {
        let written = &bytes[..result.max(0) as usize];
        let number = offset.unwrap_or_else(|| kernel::position(file) - written.len() as i64);
        record::add(site.settings, &Entry { call: Call::Write, result, number, path: &site.path, bytes: written });
        drop(turn);
        if site.action == Some(Action::Tear) {
            kernel::kill_self();
        }
        site.cut();
    });
    result as ssize_t
}

/// The bytes of a caller's buffer.
unsafe fn buffer<'a>(bytes: *const c_void, count: size_t) -> &'a [u8] {
    if count == 0 {
        return &[];
    }
    // SAFETY: the caller's caller promises the kernel this many bytes.
    unsafe { std::slice::from_raw_parts(bytes.cast(), count) }
}

/// The first non-empty buffer of a list, or an empty one. A read or write of a list is reduced to this buffer, like a short one.
unsafe fn first_part(parts: *const iovec, count: c_int) -> iovec {
    // SAFETY: the caller's caller promises the kernel this many parts.
    let parts = unsafe { std::slice::from_raw_parts(parts, count.max(0) as usize) };
    let empty = iovec { iov_base: std::ptr::null_mut(), iov_len: 0 };
    parts.iter().copied().find(|part| part.iov_len > 0).unwrap_or(empty)
}

unsafe fn map(at: *mut c_void, length: size_t, access: c_int, flags: c_int, file: c_int, offset: off_t) -> *mut c_void {
    let a = [at as usize, length, access as usize, flags as usize, file as usize, offset as usize];
    // Maps of no file are also made in signal handlers, where nothing else is permitted.
    if file < 0 {
        // SAFETY: as the caller promises.
        return unsafe { call(libc::SYS_mmap, a) } as *mut c_void;
    }
    // SAFETY: as the caller promises.
    let real = || unsafe { call(libc::SYS_mmap, a) };
    let Some(site) = site(Call::Map, || path_of(file)) else { return real() as *mut c_void };
    let (action, place) = (site.action, site.place(length));
    let result = site.run(length as i64, real);
    if result > 0 && access == libc::PROT_READ {
        keeping_errno(|| {
            // SAFETY: the map was just made, and is still unknown to the caller.
            unsafe {
                match action {
                    Some(Action::Flip) => kernel::flip_mapped(result as usize, length, file, offset, place),
                    Some(Action::Lose) => kernel::lose_mapped(result as usize, length, place),
                    _ => {}
                }
            }
        });
    }
    result as *mut c_void
}

unsafe fn rename_at(from_dir: c_int, from: *const c_char, to_dir: c_int, to: *const c_char, flags: c_uint) -> c_int {
    // SAFETY: the caller promises strings.
    let path = || unsafe { Some(format!("{}\t{}", path_at(from_dir, from)?, path_at(to_dir, to)?)) };
    let a = [from_dir as usize, from as usize, to_dir as usize, to as usize, flags as usize, 0];
    // SAFETY: as the caller promises.
    unsafe { simple(Call::Rename, path, flags.into(), libc::SYS_renameat2, a) as c_int }
}

unsafe fn stat_at(folder: c_int, name: *const c_char, to: *mut libc::stat, flags: c_int) -> c_int {
    // SAFETY: the caller promises a string.
    let path = || unsafe { path_at(folder, name) };
    let a = [folder as usize, name as usize, to as usize, flags as usize, 0, 0];
    // SAFETY: as the caller promises.
    unsafe { simple(Call::Stat, path, 0, libc::SYS_newfstatat, a) as c_int }
}

unsafe fn unlink_at(folder: c_int, name: *const c_char, flags: c_int) -> c_int {
    // SAFETY: the caller promises a string.
    let path = || unsafe { path_at(folder, name) };
    // SAFETY: as the caller promises.
    unsafe {
        let a = [folder as usize, name as usize, flags as usize, 0, 0, 0];
        simple(Call::Unlink, path, flags as i64, libc::SYS_unlinkat, a) as c_int
    }
}

/// The address of libc's own function, hidden by this library's function of the same name.
fn behind(name: &CStr) -> *mut c_void {
    // SAFETY: the name is a string.
    unsafe { libc::dlsym(libc::RTLD_NEXT, name.as_ptr()) }
}

/// Opens the listing of a folder by libc's own function.
unsafe fn open_listing(name: *const c_char) -> *mut libc::DIR {
    static REAL: OnceLock<usize> = OnceLock::new();
    type Opens = unsafe extern "C" fn(*const c_char) -> *mut libc::DIR;
    let real = *REAL.get_or_init(|| behind(c"opendir") as usize);
    // SAFETY: this is libc's function of this type, and the name is as promised by the caller.
    let real = || unsafe { std::mem::transmute::<usize, Opens>(real)(name) as i64 };
    // SAFETY: the caller promises a string.
    let site = site(Call::List, || unsafe { path_at(libc::AT_FDCWD, name) });
    let result = site.map_or_else(real, |site| site.run(0, real));
    result.max(0) as *mut libc::DIR
}

unsafe fn next_entry(listing: *mut libc::DIR) -> *mut libc::dirent64 {
    static REAL: OnceLock<usize> = OnceLock::new();
    type Reads = unsafe extern "C" fn(*mut libc::DIR) -> *mut libc::dirent64;
    let real = *REAL.get_or_init(|| behind(c"readdir64") as usize);
    // SAFETY: this is libc's function of this type, and the listing is as promised by the caller.
    let real = || unsafe { std::mem::transmute::<usize, Reads>(real)(listing) as i64 };
    // SAFETY: the caller promises an open listing.
    let site = site(Call::List, || path_of(unsafe { libc::dirfd(listing) }));
    let result = site.map_or_else(real, |site| site.run(0, real));
    result.max(0) as *mut libc::dirent64
}

/// Declares replacements for libc's functions, with their bodies. Their arguments are those of libc's own.
macro_rules! instead {
    ($($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty),*) -> $result:ty $body:block)*) => {$(
        $(#[$doc])*
        #[unsafe(no_mangle)]
        unsafe extern "C" fn $name($($argument: $type),*) -> $result {
            // SAFETY: the caller promises libc's function these arguments.
            unsafe { $body }
        }
    )*};
}

instead! {
    // In C these two take the mode only to create a file; otherwise it is here an arbitrary register.
    open(name: *const c_char, flags: c_int, mode: mode_t) -> c_int { open_at(libc::AT_FDCWD, name, flags, mode) }
    open64(name: *const c_char, flags: c_int, mode: mode_t) -> c_int { open_at(libc::AT_FDCWD, name, flags, mode) }
    openat(folder: c_int, name: *const c_char, flags: c_int, mode: mode_t) -> c_int { open_at(folder, name, flags, mode) }
    openat64(folder: c_int, name: *const c_char, flags: c_int, mode: mode_t) -> c_int { open_at(folder, name, flags, mode) }
    close(file: c_int) -> c_int {
        // A close that fails closes the file all the same.
        let real = || call(libc::SYS_close, [file as usize, 0, 0, 0, 0, 0]);
        match site(Call::Close, || path_of(file)) {
            Some(site) => {
                let result = real();
                site.run(0, || result) as c_int
            }
            None => real() as c_int,
        }
    }

    read(file: c_int, to: *mut c_void, count: size_t) -> ssize_t {
        reading(file, count, to.cast(), |n| call(libc::SYS_read, [file as usize, to as usize, n, 0, 0, 0]))
    }
    pread64(file: c_int, to: *mut c_void, count: size_t, offset: off_t) -> ssize_t {
        let real = |n| call(libc::SYS_pread64, [file as usize, to as usize, n, offset as usize, 0, 0]);
        reading(file, count, to.cast(), real)
    }
    pread(file: c_int, to: *mut c_void, count: size_t, offset: off_t) -> ssize_t { pread64(file, to, count, offset) }
    readv(file: c_int, parts: *const iovec, count: c_int) -> ssize_t {
        let first = first_part(parts, count);
        reading(file, first.iov_len, first.iov_base.cast(), |n| {
            call(libc::SYS_read, [file as usize, first.iov_base as usize, n, 0, 0, 0])
        })
    }
    write(file: c_int, from: *const c_void, count: size_t) -> ssize_t {
        writing(file, buffer(from, count), None, |n| call(libc::SYS_write, [file as usize, from as usize, n, 0, 0, 0]))
    }
    pwrite64(file: c_int, from: *const c_void, count: size_t, offset: off_t) -> ssize_t {
        let real = |n| call(libc::SYS_pwrite64, [file as usize, from as usize, n, offset as usize, 0, 0]);
        writing(file, buffer(from, count), Some(offset), real)
    }
    pwrite(file: c_int, from: *const c_void, count: size_t, offset: off_t) -> ssize_t {
        pwrite64(file, from, count, offset)
    }
    writev(file: c_int, parts: *const iovec, count: c_int) -> ssize_t {
        let first = first_part(parts, count);
        write(file, first.iov_base, first.iov_len)
    }

    mmap(at: *mut c_void, length: size_t, access: c_int, flags: c_int, file: c_int, offset: off_t) -> *mut c_void {
        map(at, length, access, flags, file, offset)
    }
    mmap64(at: *mut c_void, length: size_t, access: c_int, flags: c_int, file: c_int, offset: off_t) -> *mut c_void {
        map(at, length, access, flags, file, offset)
    }

    fsync(file: c_int) -> c_int {
        simple(Call::Sync, || path_of(file), 0, libc::SYS_fsync, [file as usize, 0, 0, 0, 0, 0]) as c_int
    }
    fdatasync(file: c_int) -> c_int {
        simple(Call::Sync, || path_of(file), 0, libc::SYS_fdatasync, [file as usize, 0, 0, 0, 0, 0]) as c_int
    }
    /// Distinguished from the others by its number.
    syncfs(file: c_int) -> c_int {
        simple(Call::Sync, || path_of(file), 1, libc::SYS_syncfs, [file as usize, 0, 0, 0, 0, 0]) as c_int
    }

    rename(from: *const c_char, to: *const c_char) -> c_int { rename_at(libc::AT_FDCWD, from, libc::AT_FDCWD, to, 0) }
    renameat(from_dir: c_int, from: *const c_char, to_dir: c_int, to: *const c_char) -> c_int {
        rename_at(from_dir, from, to_dir, to, 0)
    }
    renameat2(from_dir: c_int, from: *const c_char, to_dir: c_int, to: *const c_char, flags: c_uint) -> c_int {
        rename_at(from_dir, from, to_dir, to, flags)
    }
    ftruncate64(file: c_int, length: off_t) -> c_int {
        let a = [file as usize, length as usize, 0, 0, 0, 0];
        simple(Call::Truncate, || path_of(file), length, libc::SYS_ftruncate, a) as c_int
    }
    ftruncate(file: c_int, length: off_t) -> c_int { ftruncate64(file, length) }
    fallocate64(file: c_int, mode: c_int, offset: off_t, length: off_t) -> c_int {
        let a = [file as usize, mode as usize, offset as usize, length as usize, 0, 0];
        simple(Call::Allocate, || path_of(file), length, libc::SYS_fallocate, a) as c_int
    }
    fallocate(file: c_int, mode: c_int, offset: off_t, length: off_t) -> c_int { fallocate64(file, mode, offset, length) }

    unlink(name: *const c_char) -> c_int { unlink_at(libc::AT_FDCWD, name, 0) }
    unlinkat(folder: c_int, name: *const c_char, flags: c_int) -> c_int { unlink_at(folder, name, flags) }
    rmdir(name: *const c_char) -> c_int { unlink_at(libc::AT_FDCWD, name, libc::AT_REMOVEDIR) }
    mkdir(name: *const c_char, mode: mode_t) -> c_int { mkdirat(libc::AT_FDCWD, name, mode) }
    mkdirat(folder: c_int, name: *const c_char, mode: mode_t) -> c_int {
        let a = [folder as usize, name as usize, mode as usize, 0, 0, 0];
        simple(Call::Mkdir, || path_at(folder, name), mode.into(), libc::SYS_mkdirat, a) as c_int
    }
    linkat(from_dir: c_int, from: *const c_char, to_dir: c_int, to: *const c_char, flags: c_int) -> c_int {
        let path = || Some(format!("{}\t{}", path_at(from_dir, from)?, path_at(to_dir, to)?));
        let a = [from_dir as usize, from as usize, to_dir as usize, to as usize, flags as usize, 0];
        // Its own flags would be mistaken for those of an exchange.
        simple(Call::Rename, path, LINK, libc::SYS_linkat, a) as c_int
    }
    link(from: *const c_char, to: *const c_char) -> c_int { linkat(libc::AT_FDCWD, from, libc::AT_FDCWD, to, 0) }

    statx(folder: c_int, name: *const c_char, flags: c_int, mask: c_uint, to: *mut libc::statx) -> c_int {
        let a = [folder as usize, name as usize, flags as usize, mask as usize, to as usize, 0];
        simple(Call::Stat, || path_at(folder, name), 0, libc::SYS_statx, a) as c_int
    }
    stat64(name: *const c_char, to: *mut libc::stat) -> c_int { stat_at(libc::AT_FDCWD, name, to, 0) }
    lstat64(name: *const c_char, to: *mut libc::stat) -> c_int {
        stat_at(libc::AT_FDCWD, name, to, libc::AT_SYMLINK_NOFOLLOW)
    }
    fstat64(file: c_int, to: *mut libc::stat) -> c_int { stat_at(file, c"".as_ptr(), to, libc::AT_EMPTY_PATH) }
    fstatat64(folder: c_int, name: *const c_char, to: *mut libc::stat, flags: c_int) -> c_int {
        stat_at(folder, name, to, flags)
    }
    fchmod(file: c_int, mode: mode_t) -> c_int {
        let a = [file as usize, mode as usize, 0, 0, 0, 0];
        simple(Call::Mode, || path_of(file), mode.into(), libc::SYS_fchmod, a) as c_int
    }

    flock(file: c_int, operation: c_int) -> c_int {
        let a = [file as usize, operation as usize, 0, 0, 0, 0];
        simple(Call::Lock, || path_of(file), operation.into(), libc::SYS_flock, a) as c_int
    }
    fcntl(file: c_int, command: c_int, argument: c_long) -> c_int {
        let a = [file as usize, command as usize, argument as usize, 0, 0, 0];
        if matches!(command, libc::F_SETLK | libc::F_SETLKW | libc::F_OFD_SETLK | libc::F_OFD_SETLKW) {
            return simple(Call::Lock, || path_of(file), command.into(), libc::SYS_fcntl, a) as c_int;
        }
        call(libc::SYS_fcntl, a) as c_int
    }
    fcntl64(file: c_int, command: c_int, argument: c_long) -> c_int { fcntl(file, command, argument) }

    opendir(name: *const c_char) -> *mut libc::DIR { open_listing(name) }
    readdir64(listing: *mut libc::DIR) -> *mut libc::dirent64 { next_entry(listing) }
}

/// The record's number for a link, in place of a rename's flags: a second name for the same file.
const LINK: i64 = -1;
