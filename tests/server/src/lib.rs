//! A web server of a folder for tests and measurements, on a port of this machine: whole files and ranges of them, over a link of given latency and
//! rate, with faults on demand, and a record of all requests. A thread for each connection.
//!
//! The link is one for all connections: an answer's bytes pass one after the other at its rate. A new connection and each answer wait for one round trip,
//! as without encryption.

mod request;

use request::Request;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Bytes sent at a time.
const PART_BYTES: usize = 16 << 10;

/// A link between the server and its readers.
#[derive(Clone, Copy, Debug, Default)]
pub struct Link {
    /// Time of a round trip.
    pub round_trip: Duration,
    /// Bytes per second; `None` for as many as the machine gives.
    pub bytes_per_s: Option<f64>,
}

/// A way to answer wrongly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// A status in place of the file.
    Status(u16),
    /// The connection ends before the answer.
    Refused,
    /// The connection ends in the middle of the file's bytes.
    Cut,
    /// Fewer bytes than the range has, all announced.
    Short,
    /// Another range, of the same length, announced as it is.
    OtherRange,
    /// Other bytes, under the announcement of those asked for.
    Flipped,
    /// The whole file in place of a range.
    Whole,
    /// No answer for so long, in milliseconds.
    Stalled(u64),
}

/// A request, as it was answered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// When it came, from the server's start on.
    pub at: Duration,
    /// From the folder on.
    pub path: String,
    /// First byte and length; `None` of whole files.
    pub range: Option<(u64, u64)>,
    /// The answer's status.
    pub status: u16,
    /// Bytes of the file sent.
    pub bytes: u64,
    /// The fault put in, if any.
    pub fault: Option<Fault>,
}

/// The fault for a request, by its number and path.
pub type Faults = dyn Fn(u64, &str) -> Option<Fault> + Send + Sync;

struct Shared {
    folder: PathBuf,
    link: Mutex<Link>,
    faults: Mutex<Option<Arc<Faults>>>,
    asked: Mutex<Vec<Asked>>,
    numbered: Mutex<u64>,
    /// When the link is free again.
    free_at: Mutex<Instant>,
    has_tags: bool,
    started: Instant,
    stops: AtomicBool,
}

/// A running server; it stops when dropped.
pub struct Server {
    shared: Arc<Shared>,
    address: SocketAddr,
}

impl Server {
    /// Serves a folder, over a link as fast as this machine's.
    ///
    /// # Errors
    /// If no port is free.
    pub fn start(folder: impl Into<PathBuf>) -> io::Result<Self> {
        Self::start_at("127.0.0.1:0", folder)
    }

    /// Serves a folder at an address and port.
    ///
    /// # Errors
    /// If the port is taken.
    pub fn start_at(address: &str, folder: impl Into<PathBuf>) -> io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            folder: folder.into(),
            link: Mutex::default(),
            faults: Mutex::default(),
            asked: Mutex::default(),
            numbered: Mutex::default(),
            free_at: Mutex::new(Instant::now()),
            has_tags: true,
            started: Instant::now(),
            stops: AtomicBool::new(false),
        });
        let served = shared.clone();
        thread::spawn(move || {
            for connection in listener.incoming().map_while(Result::ok) {
                if served.stops.load(Ordering::Relaxed) {
                    return;
                }
                let served = served.clone();
                // A reader may go at any time.
                thread::spawn(move || drop(served.serve(connection)));
            }
        });
        Ok(Self { shared, address })
    }

    /// The address of a path in the folder.
    pub fn url(&self, path: &str) -> String {
        format!("http://{}/{path}", self.address)
    }

    /// Changes the link.
    pub fn set_link(&self, link: Link) {
        *lock(&self.shared.link) = link;
    }

    /// Puts faults into coming answers.
    pub fn set_faults(&self, faults: impl Fn(u64, &str) -> Option<Fault> + Send + Sync + 'static) {
        *lock(&self.shared.faults) = Some(Arc::new(faults));
    }

    /// Takes the requests recorded so far.
    pub fn take_asked(&self) -> Vec<Asked> {
        std::mem::take(&mut lock(&self.shared.asked))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.shared.stops.store(true, Ordering::Relaxed);
        // Wakes the listener.
        drop(TcpStream::connect(self.address));
    }
}

/// An answer to be sent.
struct Answer {
    status: u16,
    headers: String,
    body: Vec<u8>,
    /// Bytes announced.
    announced: u64,
}

impl Shared {
    fn serve(&self, mut connection: TcpStream) -> io::Result<()> {
        connection.set_nodelay(true)?;
        // The handshake.
        thread::sleep(self.round_trip());
        while let Some(request) = Request::read(&mut connection)? {
            if self.stops.load(Ordering::Relaxed) {
                break;
            }
            let number = {
                let mut numbered = lock(&self.numbered);
                *numbered += 1;
                *numbered - 1
            };
            let faults = lock(&self.faults).clone();
            let fault = faults.and_then(|faults| faults(number, &request.path));
            let begun = Instant::now();
            let answer = self.answer(&request, fault)?;
            let body_bytes = if request.is_head { 0 } else { answer.body.len() as u64 };
            lock(&self.asked).push(Asked {
                at: begun - self.started,
                path: request.path.clone(),
                range: request.range_in(&answer),
                status: answer.status,
                bytes: body_bytes,
                fault,
            });
            if fault == Some(Fault::Refused) {
                return connection.shutdown(Shutdown::Both);
            }
            if let Some(Fault::Stalled(milliseconds)) = fault {
                thread::sleep(Duration::from_millis(milliseconds));
            }
            thread::sleep(self.round_trip().saturating_sub(begun.elapsed()));
            let Answer { status, headers, body, announced } = &answer;
            let head =
                format!("HTTP/1.1 {status} \r\ncontent-length: {announced}\r\naccept-ranges: bytes\r\n{headers}\r\n");
            connection.write_all(head.as_bytes())?;
            if request.is_head {
                continue;
            }
            let sent = if fault == Some(Fault::Cut) { &body[..body.len() / 2] } else { body };
            for part in sent.chunks(PART_BYTES) {
                self.pass(part.len());
                connection.write_all(part)?;
            }
            if (sent.len() as u64) < *announced {
                return connection.shutdown(Shutdown::Both);
            }
        }
        Ok(())
    }

    /// The time of a round trip. The link is not locked during it: others travel meanwhile.
    fn round_trip(&self) -> Duration {
        lock(&self.link).round_trip
    }

    /// Waits until bytes have passed the link.
    fn pass(&self, bytes: usize) {
        let Some(rate) = lock(&self.link).bytes_per_s else { return };
        let until = {
            let mut free_at = lock(&self.free_at);
            *free_at = (*free_at).max(Instant::now()) + Duration::from_secs_f64(bytes as f64 / rate);
            *free_at
        };
        thread::sleep(until.saturating_duration_since(Instant::now()));
    }

    fn answer(&self, request: &Request, fault: Option<Fault>) -> io::Result<Answer> {
        let status = |status| Answer { status, headers: String::new(), body: Vec::new(), announced: 0 };
        if let Some(Fault::Status(code)) = fault {
            return Ok(status(code));
        }
        let path = self.folder.join(&request.path);
        let is_inside = !Path::new(&request.path).components().any(|part| part.as_os_str() == "..");
        let Some(mut file) = File::open(&path).ok().filter(|_| is_inside && path.is_file()) else {
            return Ok(status(404));
        };
        let metadata = file.metadata()?;
        let bytes = metadata.len();
        let age = metadata.modified()?.duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let tag = format!("\"{bytes:x}-{:x}\"", age.as_nanos());
        if request.if_match.as_ref().is_some_and(|wanted| *wanted != tag) {
            return Ok(status(412));
        }
        if request.if_none_match.as_ref() == Some(&tag) {
            return Ok(status(304));
        }
        let mut headers = if self.has_tags { format!("etag: {tag}\r\n") } else { String::new() };
        let Some((start, end)) = request.range.filter(|_| fault != Some(Fault::Whole)).map(|range| range.within(bytes))
        else {
            let mut body = Vec::new();
            file.read_to_end(&mut body)?;
            return Ok(damaged(Answer { status: 200, headers, announced: body.len() as u64, body }, fault));
        };
        if start >= bytes {
            headers += &format!("content-range: bytes */{bytes}\r\n");
            return Ok(Answer { headers, ..status(416) });
        }
        let moved = if fault == Some(Fault::OtherRange) { start.saturating_sub(1).max(1) - 1 } else { start };
        let length = end - start;
        let mut body = vec![0; length as usize];
        file.seek(SeekFrom::Start(moved))?;
        file.read_exact(&mut body)?;
        let first = if fault == Some(Fault::OtherRange) { moved } else { start };
        headers += &format!("content-range: bytes {first}-{}/{bytes}\r\n", first + length - 1);
        Ok(damaged(Answer { status: 206, headers, announced: length, body }, fault))
    }
}

/// Damages an answer's bytes.
fn damaged(mut answer: Answer, fault: Option<Fault>) -> Answer {
    match fault {
        Some(Fault::Flipped) => {
            let middle = answer.body.len() / 2;
            answer.body.iter_mut().skip(middle).take(1).for_each(|byte| *byte ^= 0x10);
        }
        Some(Fault::Short) => {
            answer.body.truncate(answer.body.len() / 2);
            answer.announced = answer.body.len() as u64;
        }
        _ => {}
    }
    answer
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
