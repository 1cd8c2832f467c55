use crate::cancellation::Cancellation;
use crate::fault::Fault;
use crate::place::{Place, at, forget_hosts};
use crate::settings::{Settings, configure};
use crate::traffic::traffic;
use brickyard_server::{Fault as Wrong, Link, Server};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

/// A server of one file, `a/b`, of 100,000 bytes.
fn served() -> (tempfile::TempDir, Server, Vec<u8>) {
    let folder = tempfile::tempdir().unwrap();
    let bytes: Vec<u8> = (0..100_000u32).map(|i| (i * 7 + i / 251) as u8).collect();
    std::fs::create_dir(folder.path().join("a")).unwrap();
    std::fs::write(folder.path().join("a/b"), &bytes).unwrap();
    let server = Server::start(folder.path()).unwrap();
    (folder, server, bytes)
}

fn place(server: &Server, path: &str) -> Place {
    at(Path::new(&server.url(path))).unwrap().unwrap()
}

fn fault<T>(read: io::Result<T>) -> Fault {
    let error = read.err().expect("a failure");
    Fault::of(&error).unwrap_or_else(|| panic!("{error}")).clone()
}

#[test]
fn objects_ends_and_ranges_are_read() {
    let (_folder, server, bytes) = served();
    let file = place(&server, "a").join("b");
    let whole = file.whole(1 << 20).unwrap().unwrap();
    assert_eq!((&whole.bytes, whole.version.bytes), (&bytes, 100_000));
    assert_eq!(file.tail(10).unwrap().unwrap().bytes, bytes[99_990..]);
    assert_eq!(file.tail(1 << 20).unwrap().unwrap().bytes, bytes);
    assert!(place(&server, "a/c").whole(10).unwrap().is_none() && place(&server, "a/c").tail(10).unwrap().is_none());
    assert_eq!(fault(file.whole(99_999)), Fault::Large { most_bytes: 99_999 });
    assert_eq!(fault(place(&server, "a/c").range(0..1, None)), Fault::Absent);
    server.take_asked();
    let ranges = [50_000..50_100, 0..10, 5..20, 99_999..100_000, 7..7];
    let read = file.objects.ranges(&file.name, &ranges, Some(&whole.version)).unwrap();
    for (range, read) in ranges.into_iter().zip(read) {
        assert_eq!(read, bytes[range.start as usize..range.end as usize], "{range:?}");
    }
    assert_eq!(server.take_asked().len(), 3, "joined");
}

#[test]
fn passing_faults_are_overcome_and_lasting_ones_told_apart() {
    let (_folder, server, bytes) = served();
    let file = place(&server, "a/b");
    let version = file.whole(1 << 20).unwrap().unwrap().version;
    let passing = [
        Wrong::Status(500),
        Wrong::Status(503),
        Wrong::Status(429),
        Wrong::Refused,
        Wrong::Cut,
        Wrong::Short,
        Wrong::OtherRange,
    ];
    for wrong in passing {
        // Each second request fails.
        server.set_faults(move |number, _| (number % 2 == 0).then_some(wrong));
        for start in [10_000, 20_000, 30_000] {
            let read = file.range(start..start + 5000, Some(&version));
            let read = read.unwrap_or_else(|error| panic!("{wrong:?}: {error}"));
            assert!(read == bytes[start as usize..][..5000], "{wrong:?}");
        }
        if wrong != Wrong::Short && wrong != Wrong::OtherRange {
            assert!(file.whole(1 << 20).unwrap().unwrap().bytes == bytes, "{wrong:?}");
        }
    }
    let lasting = [
        (Wrong::Status(500), "the server fails (500"),
        (Wrong::Status(403), "refused (403)"),
        (Wrong::Status(401), "refused (401)"),
        (Wrong::Status(410), "the server answers 410"),
        (Wrong::Whole, "no ranges"),
        (Wrong::OtherRange, "the server's answer is wrong"),
        (Wrong::Cut, "the connection ended early"),
    ];
    for (wrong, words) in lasting {
        server.set_faults(move |_, _| Some(wrong));
        let message = file.range(10..5000, None).unwrap_err().to_string();
        assert!(message.contains(words), "{wrong:?}: {message}");
    }
}

#[test]
fn changed_objects_and_unreachable_servers_are_told() {
    let (folder, server, _) = served();
    let file = place(&server, "a/b");
    let version = file.whole(1 << 20).unwrap().unwrap().version;
    std::fs::write(folder.path().join("a/b"), [0; 100_000]).unwrap();
    assert_eq!(fault(file.range(0..10, Some(&version))), Fault::Changed);
    std::fs::write(folder.path().join("a/b"), [0; 100]).unwrap();
    assert_eq!(fault(file.range(200..300, None)), Fault::Changed);
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    drop(listener);
    let nobody = at(Path::new(&format!("http://127.0.0.1:{port}/a"))).unwrap().unwrap();
    assert!(matches!(fault(nobody.whole(10)), Fault::Unreachable { .. }));
    let message = place(&server, "a").objects.folders("a").unwrap_err().to_string();
    assert!(message.contains("keeps no list"), "{message}");
    assert!(at(Path::new("a/b")).unwrap().is_none());
    assert!(matches!(fault(at(Path::new("ftp://a/b"))), Fault::Unsupported(_)));
}

/// A place whose objects are kept in a folder.
fn kept_place(server: &Server, folder: &Path, path: &str) -> Place {
    let cache_folder = Some(folder.to_owned());
    configure(Settings { cache_folder, ..Settings::default() });
    // Hosts are known anew, as by another process.
    forget_hosts();
    place(server, path)
}

#[test]
fn kept_objects_are_confirmed_and_changed_ones_fetched() {
    let (folder, server, bytes) = served();
    let kept = tempfile::tempdir().unwrap();
    let mut statuses = Vec::new();
    let mut read = |expected: &[u8]| {
        let file = kept_place(&server, kept.path(), "a/b");
        let whole = file.whole(1 << 20).unwrap().unwrap();
        assert!(whole.bytes == expected);
        assert!(file.tail(100).unwrap().unwrap().bytes == expected[expected.len() - 100..]);
        let ranges = file.objects.ranges(&file.name, &[10..20, 500..900], Some(&whole.version)).unwrap();
        assert!(ranges == [&expected[10..20], &expected[500..900]]);
        assert!(file.join("c").whole(10).unwrap().is_none(), "never there");
        statuses.push(server.take_asked().iter().map(|asked| asked.status).collect::<Vec<_>>());
    };
    read(&bytes);
    read(&bytes);
    std::fs::write(folder.path().join("a/b"), &bytes[..50_000]).unwrap();
    read(&bytes[..50_000]);
    // Without a server all is as it was.
    server.set_faults(|_, _| Some(Wrong::Refused));
    read(&bytes[..50_000]);
    assert_eq!(statuses[..3], [vec![200, 206, 206, 206, 404], vec![304, 304, 404], vec![200, 206, 206, 206, 404]]);
    assert!(traffic().unconfirmed >= 2);
    let file = kept_place(&server, kept.path(), "a/b");
    server.set_faults(|_, _| Some(Wrong::Status(403)));
    assert!(matches!(fault(file.whole(1 << 20)), Fault::Forbidden { .. }), "no right to see it any more");
    server.set_faults(|_, _| Some(Wrong::Refused));
    assert!(file.whole(1 << 20).is_err(), "forgotten");
}

#[test]
fn refused_objects_are_absent_where_absent_ones_are_refused() {
    let (folder, server, _) = served();
    let files = folder.path().to_owned();
    let is_there = move |path: &str| files.join(path).is_file();
    server.set_faults(move |_, path| (!is_there(path)).then_some(Wrong::Status(403)));
    let forbidden = |path: &str| {
        matches!(
            place(&server, path).whole(1 << 20).map_err(|e| Fault::of(&e).cloned()),
            Err(Some(Fault::Forbidden { .. }))
        )
    };
    assert!(forbidden("a/c"), "nothing was given yet");
    place(&server, "a/b").whole(1 << 20).unwrap();
    assert!(place(&server, "a/c").whole(10).unwrap().is_none());
    // All is refused: a right has ended.
    server.set_faults(|_, _| Some(Wrong::Status(403)));
    assert!(forbidden("a/c") && forbidden("a/b"));
    // An object that is as it was kept is given, too.
    let files = folder.path().to_owned();
    server.set_faults(move |_, path| (!files.join(path).is_file()).then_some(Wrong::Status(403)));
    let kept = tempfile::tempdir().unwrap();
    for _ in 0..2 {
        kept_place(&server, kept.path(), "a/b").whole(1 << 20).unwrap();
        assert!(place(&server, "a/c").whole(10).unwrap().is_none());
    }
    // Elsewhere absent objects are told.
    let (_folder, server, _) = served();
    server.set_faults(|_, path| (path == "a/c").then_some(Wrong::Status(403)));
    place(&server, "a/b").whole(1 << 20).unwrap();
    assert!(matches!(fault(place(&server, "a/c").whole(10)), Fault::Forbidden { .. }));
}

#[test]
fn a_link_has_its_latency_and_rate() {
    let (_folder, server, bytes) = served();
    let file = place(&server, "a/b");
    server.set_link(Link { round_trip: Duration::from_millis(50), bytes_per_s: Some(1e6) });
    let begun = Instant::now();
    assert!(file.whole(1 << 20).unwrap().unwrap().bytes == bytes);
    // Two round trips, and a tenth of a second of bytes.
    assert!(begun.elapsed() >= Duration::from_millis(195), "{:?}", begun.elapsed());
}

#[test]
fn requests_that_nobody_waits_for_are_ended() {
    let (_folder, server, bytes) = served();
    let file = place(&server, "a/b");
    file.whole(1 << 20).unwrap();
    server.set_faults(|_, _| Some(Wrong::Stalled(5000)));
    let (cancellation, before, begun) = (Cancellation::default(), traffic().cancelled, Instant::now());
    std::thread::scope(|scope| {
        let reads = scope.spawn(|| cancellation.during(|| file.range(0..10, None)));
        std::thread::sleep(Duration::from_millis(100));
        assert!(!reads.is_finished());
        cancellation.cancel();
        assert_eq!(fault(reads.join().unwrap()), Fault::Cancelled);
    });
    assert!(begun.elapsed() < Duration::from_secs(4) && traffic().cancelled > before);
    // From then on none is begun under it; others are, on this thread too.
    server.set_faults(|_, _| None);
    assert_eq!(fault(cancellation.during(|| file.range(0..10, None))), Fault::Cancelled);
    assert!(file.range(0..10, None).unwrap() == bytes[..10]);
}
