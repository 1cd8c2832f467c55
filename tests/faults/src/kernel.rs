//! System calls that bypass libc's symbols, which this library replaces; and the paths of descriptors.

use std::ffi::{CStr, CString, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::{Component, Path, PathBuf};

/// Makes a system call with up to six arguments. Returns -1 and sets `errno` on failure.
///
/// # Safety
/// The arguments must be valid for the call.
pub(crate) unsafe fn call(number: i64, a: [usize; 6]) -> i64 {
    // SAFETY: as the caller promises.
    unsafe { libc::syscall(number, a[0], a[1], a[2], a[3], a[4], a[5]) }
}

/// Sets `errno` and returns -1, the result of a failed call.
pub(crate) fn fail(error: i32) -> i64 {
    // SAFETY: the address of this thread's `errno` is always valid.
    unsafe { *libc::__errno_location() = error };
    -1
}

/// Runs `work` and preserves `errno`.
pub(crate) fn keeping_errno<T>(work: impl FnOnce() -> T) -> T {
    // SAFETY: the address of this thread's `errno` is always valid.
    let errno = unsafe { *libc::__errno_location() };
    let result = work();
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno };
    result
}

/// Ends the process as by `kill -9`.
pub(crate) fn kill_self() -> ! {
    // SAFETY: both calls take numbers.
    unsafe {
        libc::kill(libc::getpid(), libc::SIGKILL);
        libc::_exit(137)
    }
}

fn c_string(path: &Path) -> CString {
    CString::new(path.as_os_str().as_bytes()).unwrap_or_default()
}

/// Opens a log for appending, or creates it. Returns its descriptor, or -1 on failure.
pub(crate) fn open_to_append(path: &Path) -> i32 {
    let (path, flags) = (c_string(path), libc::O_WRONLY | libc::O_CREAT | libc::O_APPEND | libc::O_CLOEXEC);
    // SAFETY: the path is a string that outlives the call.
    let file = unsafe {
        call(libc::SYS_openat, [libc::AT_FDCWD as usize, path.as_ptr() as usize, flags as usize, 0o600, 0, 0])
    };
    file as i32
}

/// Writes bytes to a log. Failed writes are lost: tests notice a log too short.
pub(crate) fn write_all(file: i32, mut bytes: &[u8]) {
    while !bytes.is_empty() {
        // SAFETY: the pointer and length are those of a slice.
        let n = unsafe { call(libc::SYS_write, [file as usize, bytes.as_ptr() as usize, bytes.len(), 0, 0, 0]) };
        if n <= 0 {
            return;
        }
        bytes = &bytes[n as usize..];
    }
}

/// Truncates the file at a path to a length in bytes.
pub(crate) fn truncate(path: &str, length: i64) {
    let path = c_string(Path::new(path));
    // SAFETY: the path is a string that outlives the call.
    unsafe { call(libc::SYS_truncate, [path.as_ptr() as usize, length as usize, 0, 0, 0, 0]) };
}

/// Length of the file at a path, in bytes; `None` on failure.
pub(crate) fn length(path: &str) -> Option<i64> {
    let path = c_string(Path::new(path));
    let mut stat = std::mem::MaybeUninit::<libc::stat>::zeroed();
    let to = stat.as_mut_ptr() as usize;
    // SAFETY: the path is a string and `stat` a place for the result; all-zero is a valid one.
    let (code, stat) = unsafe {
        let at = [libc::AT_FDCWD as usize, path.as_ptr() as usize, to, 0, 0, 0];
        (call(libc::SYS_newfstatat, at), stat.assume_init())
    };
    (code == 0).then_some(stat.st_size)
}

/// The position of a descriptor, in bytes; -1 on failure.
pub(crate) fn position(file: i32) -> i64 {
    // SAFETY: the call takes numbers.
    unsafe { call(libc::SYS_lseek, [file as usize, 0, libc::SEEK_CUR as usize, 0, 0, 0]) }
}

/// The target of a link in `/proc/self`; `None` if it cannot be read.
fn own_link(name: &str) -> Option<PathBuf> {
    let link = CString::new(format!("/proc/self/{name}")).ok()?;
    let mut bytes = vec![0; libc::PATH_MAX as usize];
    // SAFETY: the link is a string; the buffer's pointer and length are its own.
    let n = unsafe {
        let (to, size) = (bytes.as_mut_ptr() as usize, bytes.len());
        call(libc::SYS_readlinkat, [libc::AT_FDCWD as usize, link.as_ptr() as usize, to, size, 0, 0])
    };
    bytes.truncate(usize::try_from(n).ok()?);
    Some(OsString::from_vec(bytes).into())
}

/// The current path of an open file. A file without a name has a path ending in ` (deleted)`; `None` if it cannot be
/// read.
pub(crate) fn path_of(file: i32) -> Option<String> {
    let path = keeping_errno(|| own_link(&format!("fd/{file}")))?;
    path.into_os_string().into_string().ok()
}

/// The path of a name below a folder's descriptor (`AT_FDCWD` for the current folder), with `.` and `..` resolved as
/// text. An empty name gives the descriptor's own path. `None` if it cannot be found or is not UTF-8.
///
/// # Safety
/// The name is null or a string.
pub(crate) unsafe fn path_at(folder: i32, name: *const libc::c_char) -> Option<String> {
    let name: &[u8] = if name.is_null() {
        b""
    } else {
        // SAFETY: the caller promises a string.
        unsafe { CStr::from_ptr(name) }.to_bytes()
    };
    let name = Path::new(std::ffi::OsStr::from_bytes(name));
    // A name below an open folder, in another form.
    let mut below = name.strip_prefix("/proc/self/fd").unwrap_or(Path::new("")).components();
    let opened = below.next().and_then(|number| number.as_os_str().to_str()?.parse().ok());
    let (folder, name) = opened.map_or((folder, name), |folder| (folder, below.as_path()));
    let mut path = match (name.is_absolute(), folder) {
        (true, _) => PathBuf::new(),
        (_, libc::AT_FDCWD) => keeping_errno(|| own_link("cwd"))?,
        _ => path_of(folder)?.into(),
    };
    for component in name.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir => drop(path.pop()),
            other => path.push(other),
        }
    }
    path.into_os_string().into_string().ok()
}

/// Changes the byte at `place` of a file's map. The map becomes private, so that the file is unchanged.
///
/// # Safety
/// The map was just made, of a file with `length` readable bytes, and is unknown to others. `place` is less than
/// `length`.
pub(crate) unsafe fn flip_mapped(map: usize, length: usize, file: i32, offset: i64, place: usize) {
    let flags = (libc::MAP_PRIVATE | libc::MAP_FIXED) as usize;
    let access = (libc::PROT_READ | libc::PROT_WRITE) as usize;
    // SAFETY: the range is ours to remap, by the caller's promise; the byte lies in it and in the file.
    unsafe {
        if call(libc::SYS_mmap, [map, length, access, flags, file as usize, offset as usize]) == map as i64 {
            *(map as *mut u8).add(place) ^= 0x10;
            call(libc::SYS_mprotect, [map, length, libc::PROT_READ as usize, 0, 0, 0]);
        }
    }
}

/// Puts an unreadable page (SIGBUS) into a file's map, at the byte `place`.
///
/// # Safety
/// The map was just made, `length` bytes long and not empty, and is unknown to others.
pub(crate) unsafe fn lose_mapped(map: usize, length: usize, place: usize) {
    const PAGE: usize = 4096;
    let flags = (libc::MAP_SHARED | libc::MAP_FIXED) as usize;
    // SAFETY: an empty file is mapped over a page of the range, which is ours by the caller's promise.
    unsafe {
        let empty = call(libc::SYS_memfd_create, [c"lost".as_ptr() as usize, 0, 0, 0, 0, 0]);
        let page = map + (place.min(length - 1) & !(PAGE - 1));
        call(libc::SYS_mmap, [page, PAGE, libc::PROT_READ as usize, flags, empty as usize, 0]);
        call(libc::SYS_close, [empty as usize, 0, 0, 0, 0, 0]);
    }
}
