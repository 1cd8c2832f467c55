//! Stores at addresses, by the command: the same answers as from disk, few requests, and faults that are overcome or told.

use brickyard::probe::probe_voxel;
use brickyard::session::VolumeSource;
use brickyard::store::Store;
use brickyard_server::{Asked, Fault, Link, Server};
use brickyard_tests::Sandbox;
use brickyard_tests::sample::takes_all;
use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A sandbox with a store, `own.zarr`, and a server of its folder.
fn served() -> (Sandbox, Server) {
    let sandbox = Sandbox::in_memory();
    sandbox.run_ok("synth turbulence own.zarr --shape 70,61,50 --brick 16 --shard 64 --quiet");
    let server = Server::start(sandbox.path(".")).expect("a free port");
    (sandbox, server)
}

/// Writes an image of Zarr 2 with two levels of chunks of 16³ by hand, as other programs do.
fn write_foreign(sandbox: &Sandbox, name: &str) {
    let datasets: Vec<_> = [(0, 1.0), (1, 2.0)]
        .map(|(level, scale): (u32, f64)| {
            serde_json::json!({"path": level.to_string(), "coordinateTransformations": [{"type": "scale", "scale": [scale, scale, scale]}]})
        })
        .into();
    let axes = ["z", "y", "x"].map(|name| serde_json::json!({"name": name, "type": "space", "unit": "micrometer"}));
    let attributes = serde_json::json!({"multiscales": [{"version": "0.4", "axes": axes, "datasets": datasets}]});
    std::fs::create_dir_all(sandbox.path(name)).expect("the sandbox is writable");
    sandbox.write(format!("{name}/.zgroup"), r#"{"zarr_format": 2}"#);
    sandbox.write(format!("{name}/.zattrs"), attributes.to_string());
    for level in 0..2u32 {
        let shape = [40u32 >> level, 36 >> level, 44 >> level];
        let document = serde_json::json!({
            "zarr_format": 2, "shape": shape, "chunks": [16, 16, 16], "dtype": "|u1", "compressor": null, "fill_value": 0,
            "order": "C", "filters": null, "dimension_separator": "/"
        });
        std::fs::create_dir_all(sandbox.path(format!("{name}/{level}"))).expect("the sandbox is writable");
        sandbox.write(format!("{name}/{level}/.zarray"), document.to_string());
        for [z, y, x] in chunks(shape.map(|n| n.div_ceil(16))) {
            let value = |[dz, dy, dx]: [u32; 3]| {
                let [z, y, x] = [(16 * z + dz) << level, (16 * y + dy) << level, (16 * x + dx) << level];
                ((z * 5) ^ (y * 3) ^ x) as u8
            };
            let bytes: Vec<u8> = chunks([16; 3]).map(value).collect();
            let folder = sandbox.path(format!("{name}/{level}/{z}/{y}"));
            std::fs::create_dir_all(&folder).expect("the sandbox is writable");
            std::fs::write(folder.join(x.to_string()), bytes).expect("the sandbox is writable");
        }
    }
}

/// All places in a grid, the last axis fastest.
fn chunks([z, y, x]: [u32; 3]) -> impl Iterator<Item = [u32; 3]> {
    (0..z).flat_map(move |z| (0..y).flat_map(move |y| (0..x).map(move |x| [z, y, x])))
}

/// Commands that read a store, with `IN` for it, and the file that they write.
const READS: [(&str, Option<&str>); 8] = [
    ("info IN", None),
    ("info IN --json", None),
    ("probe IN 20,21,22", None),
    ("export IN OUT.npy", Some("npy")),
    ("export IN OUT.nrrd --level 1", Some("nrrd")),
    ("mesh IN OUT.stl --isovalue 100", Some("stl")),
    ("render IN -o OUT.png --size 160x120 --backend cpu", Some("png")),
    ("render IN -o OUT.png --size 90x80 --backend cpu --mode mip --exact", Some("png")),
];

/// Output and file of a command on a store, with its name taken out.
fn answer(sandbox: &Sandbox, (line, ending): (&str, Option<&str>), store: &str, number: &str) -> (String, Vec<u8>) {
    let out = format!("out{number}");
    let stdout = sandbox.run_ok(&line.replace("IN", store).replace("OUT", &out));
    let file = ending.map(|ending| sandbox.read(format!("{out}.{ending}"))).unwrap_or_default();
    // The source is told by its server's tags, or its files' times.
    let told = |line: &&str| !line.contains("\"source\": \"zarr") && !line.contains("settings_fingerprint");
    let stdout: Vec<&str> = stdout.lines().filter(told).collect();
    (stdout.join("\n").replace(store, "IN"), file)
}

#[test]
fn stores_at_addresses_answer_as_those_on_disk() {
    let (sandbox, server) = served();
    write_foreign(&sandbox, "foreign.zarr");
    for (i, store) in ["own.zarr", "foreign.zarr"].into_iter().enumerate() {
        for (k, read) in READS.into_iter().enumerate() {
            let [here, there] = [store.to_owned(), server.url(store)]
                .map(|path| answer(&sandbox, read, &path, &format!("{i}{k}{}", path.len())));
            assert_eq!(here.0, there.0, "{store}: {}", read.0);
            assert!(here.1 == there.1, "{store}: {}", read.0);
        }
    }
    for (line, out) in [("verify IN", ""), ("pack IN copy.zarr --brick 16", "copy.zarr")] {
        sandbox.run_ok(&line.replace("IN", &server.url("own.zarr")));
        assert!(out.is_empty() || sandbox.path(out).is_dir(), "{line}");
    }
    // A file's address is its path.
    let file = format!("file://{}", sandbox.path("own.zarr").display());
    sandbox.run_ok(&format!("info {file}"));
}

/// Bytes of each file that were sent more than once.
fn twice(asked: &[Asked]) -> BTreeMap<&str, u64> {
    let mut sent: BTreeMap<&str, Vec<(u64, u64)>> = BTreeMap::new();
    for asked in asked.iter().filter(|asked| asked.status < 300 && asked.bytes > 0) {
        let start = asked.range.map_or(0, |(start, _)| start);
        sent.entry(&asked.path).or_default().push((start, start + asked.bytes));
    }
    let again = |mut ranges: Vec<(u64, u64)>| {
        ranges.sort_unstable();
        let (mut until, mut again) = (0, 0);
        for (start, end) in ranges {
            again += until.min(end).saturating_sub(start);
            until = until.max(end);
        }
        again
    };
    sent.into_iter().map(|(path, ranges)| (path, again(ranges))).filter(|(_, again)| *again > 0).collect()
}

#[test]
fn few_requests_lead_to_a_picture_and_nothing_is_fetched_twice() {
    let (sandbox, server) = served();
    write_foreign(&sandbox, "foreign.zarr");
    for store in ["own.zarr", "foreign.zarr"] {
        server.take_asked();
        sandbox.run_ok(&format!("render {} -o {store}.png --size 160x120 --backend cpu --exact", server.url(store)));
        let asked = server.take_asked();
        assert!(twice(&asked).is_empty(), "{store}: {:?}", twice(&asked));
    }
}

/// The image of [`write_foreign`] as a group of Zarr 3 with the same chunks, its arrays' documents in the group's alone.
fn gathered_v3(sandbox: &Sandbox, name: &str) -> serde_json::Value {
    let attributes: serde_json::Value =
        serde_json::from_slice(&sandbox.read(format!("{name}/.zattrs"))).expect("it is JSON");
    let array = |level: u32| {
        serde_json::json!({
            "zarr_format": 3, "node_type": "array", "shape": [40u32 >> level, 36 >> level, 44 >> level], "data_type": "uint8",
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [16, 16, 16]}},
            "chunk_key_encoding": {"name": "v2", "configuration": {"separator": "/"}},
            "codecs": [{"name": "bytes"}], "fill_value": 0, "attributes": {}
        })
    };
    let mut image = attributes["multiscales"][0].clone();
    image.as_object_mut().expect("an object").remove("version");
    serde_json::json!({
        "zarr_format": 3, "node_type": "group", "attributes": {"ome": {"version": "0.5", "multiscales": [image]}},
        "consolidated_metadata": {"kind": "inline", "must_understand": false, "metadata": {"0": array(0), "1": array(1)}}
    })
}

#[test]
fn one_document_tells_of_all_others() {
    let (sandbox, server) = served();
    sandbox.run_ok(&format!("info {}", server.url("own.zarr")));
    let asked = server.take_asked();
    let found = asked.iter().filter(|asked| asked.status == 200 && asked.path.ends_with(".json"));
    let mut documents: Vec<&str> = found.map(|asked| &*asked.path).collect();
    documents.sort_unstable();
    assert_eq!(documents, ["own.zarr/0/zarr.json", "own.zarr/zarr.json"]);
    // Another program's, gathered as by zarr-python: its arrays' own are not needed.
    write_foreign(&sandbox, "foreign.zarr");
    let reads = [READS[0], READS[2], READS[3], READS[6]];
    let here = reads.map(|read| answer(&sandbox, read, "foreign.zarr", "here"));
    let mut gathered = serde_json::Map::new();
    for name in [".zgroup", ".zattrs", "0/.zarray", "1/.zarray"] {
        let document = serde_json::from_slice(&sandbox.read(format!("foreign.zarr/{name}"))).expect("it is JSON");
        gathered.insert(name.into(), document);
    }
    let of_v2 = serde_json::json!({"zarr_consolidated_format": 1, "metadata": &gathered});
    let of_v3 = gathered_v3(&sandbox, "foreign.zarr");
    sandbox.write("foreign.zarr/.zmetadata", of_v2.to_string());
    for level in 0..2 {
        std::fs::remove_file(sandbox.path(format!("foreign.zarr/{level}/.zarray"))).expect("it was there");
    }
    let address = server.url("foreign.zarr");
    for (version, write) in [(2, None), (3, Some(&of_v3))] {
        if let Some(document) = write {
            sandbox.write("foreign.zarr/zarr.json", document.to_string());
            // Older than the document, and not looked at beside it.
            sandbox.write("foreign.zarr/.zmetadata", of_v2.to_string().replace("16", "8"));
        }
        for (read, here) in reads.into_iter().zip(&here) {
            let there = answer(&sandbox, read, &address, &format!("there{version}"));
            assert!(there.1 == here.1, "{version}: {}", read.0);
            assert!(version == 3 || there.0 == here.0, "{}: {}", read.0, there.0);
        }
    }
    // Images in a group are found by it, though the server keeps no list of folders.
    let of_all = ["a", "b"]
        .into_iter()
        .flat_map(|image| gathered.iter().map(move |(path, document)| (format!("{image}/{path}"), document)));
    let of_all: serde_json::Map<_, _> = of_all.map(|(path, document)| (path, document.clone())).collect();
    std::fs::create_dir(sandbox.path("both.zarr")).expect("the sandbox is writable");
    sandbox.write("both.zarr/.zgroup", r#"{"zarr_format": 2}"#);
    sandbox.write("both.zarr/.zmetadata", serde_json::json!({"metadata": of_all}).to_string());
    for image in ["a", "b"] {
        for (path, bytes) in brickyard_tests::tree(&sandbox.path("foreign.zarr")) {
            let copy = sandbox.path("both.zarr").join(image).join(path);
            std::fs::create_dir_all(copy.parent().expect("a folder")).expect("the sandbox is writable");
            sandbox.write(copy, bytes);
        }
    }
    let (code, _, stderr) = sandbox.run(&format!("info {}", server.url("both.zarr")));
    assert!(code == 2 && stderr.contains("a (40 x 36 x 44, u8), b (40 x 36 x 44, u8)"), "{code}: {stderr}");
    assert!(answer(&sandbox, READS[3], &server.url("both.zarr::b"), "b").1 == here[2].1);
    // Its state is that of all documents it tells: another image there is not taken for the packed one.
    let pack = format!("pack {} copy.zarr --brick 16 --quiet", server.url("both.zarr::b"));
    sandbox.run_ok(&pack);
    sandbox.run_ok(&format!("{pack} --resume"));
    sandbox.write("both.zarr/.zmetadata", serde_json::json!({"metadata": of_all, "other": 1}).to_string());
    let (code, _, stderr) = sandbox.run(&format!("{pack} --resume"));
    assert!(code == 2 && stderr.contains("resume"), "{code}: {stderr}");
    // Groups below the root of Zarr 3 have an empty map of their own, which tells nothing; thousands are no burden.
    let array = &of_v3["consolidated_metadata"]["metadata"]["0"];
    let empty = serde_json::json!({"kind": "inline", "must_understand": false, "metadata": {}});
    let group =
        serde_json::json!({"zarr_format": 3, "node_type": "group", "attributes": {}, "consolidated_metadata": empty});
    let mut nodes: serde_json::Map<_, _> = (0..8000).map(|i| (format!("g{i}"), group.clone())).collect();
    nodes.extend([("x".into(), group.clone()), ("x/0".into(), array.clone())]);
    let root = serde_json::json!({"zarr_format": 3, "node_type": "group", "attributes": {}, "consolidated_metadata": {"kind": "inline", "metadata": nodes}});
    std::fs::create_dir(sandbox.path("many.zarr")).expect("the sandbox is writable");
    sandbox.write("many.zarr/zarr.json", root.to_string());
    server.take_asked();
    let found = sandbox.run_ok(&format!("info {}", server.url("many.zarr")));
    assert!(found.contains("44 × 36 × 40") || found.contains("44 x 36 x 40"), "{found}");
    assert!(server.take_asked().len() < 100);
    let (code, _, stderr) = sandbox.run(&format!("info {}", server.url("many.zarr::x")));
    assert!(code == 3 && stderr.contains("keeps no list"), "{code}: {stderr}");
    // A damaged one is as good as none.
    sandbox.write("foreign.zarr/zarr.json", "{");
    let (code, _, stderr) = sandbox.run(&format!("info {address}"));
    assert!(code == 3 && stderr.contains("zarr.json"), "{stderr}");
}

#[test]
fn documents_that_contradict_the_root_are_found_by_verify() {
    for name in ["1/zarr.json", "0/.brickyard/ranges/zarr.json", "2/.brickyard/shards/zarr.json"] {
        let (sandbox, server) = served();
        let path = format!("own.zarr/{name}");
        let text = String::from_utf8(sandbox.read(&path)).expect("it is text");
        sandbox.write(&path, text.replace("\"crc32c\"", "\"adler32\""));
        let (code, _, stderr) = sandbox.run("info own.zarr");
        assert!(code == 3 && stderr.contains(name), "{name}: {stderr}");
        // The store at an address is read by its root document.
        sandbox.run_ok(&format!("probe {} 20,21,22", server.url("own.zarr")));
        let (code, stdout, stderr) = sandbox.run(&format!("verify {}", server.url("own.zarr")));
        assert!(code == 5 && format!("{stdout}{stderr}").contains(name), "{name}: {code}: {stdout}{stderr}");
    }
}

/// Renders a store at an address with a cache folder, `cache`; returns the picture and the messages.
fn render_kept(sandbox: &Sandbox, address: &str, more: &[&str]) -> (Vec<u8>, String) {
    let line = format!("render {address} -o kept.png --size 160x120 --backend cpu --exact --overwrite");
    let mut command = sandbox.command();
    command.env("BRICKYARD_CACHE", sandbox.path("cache")).args(line.split(' ')).args(more);
    let output = command.output().expect("it can be started");
    let messages = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{messages}");
    (sandbox.read("kept.png"), messages)
}

/// The cache folder by `cache info`.
fn cache_info(sandbox: &Sandbox) -> serde_json::Value {
    let mut command = sandbox.command();
    let output = command.env("BRICKYARD_CACHE", sandbox.path("cache")).args(["cache", "info", "--json"]).output();
    serde_json::from_slice(&output.expect("it can be started").stdout).expect("JSON")
}

#[test]
fn objects_are_kept_over_sessions_and_confirmed() {
    let (sandbox, server) = served();
    write_foreign(&sandbox, "foreign.zarr");
    for store in ["own.zarr", "foreign.zarr"] {
        let (picture, _) = render_kept(&sandbox, &server.url(store), &[]);
        assert!(server.take_asked().iter().any(|asked| asked.bytes > 0));
        let (again, messages) = render_kept(&sandbox, &server.url(store), &[]);
        assert!(again == picture && !messages.contains("reached"), "{messages}");
        let asked = server.take_asked();
        assert!(!asked.is_empty() && asked.iter().all(|asked| asked.bytes == 0), "{store}: {asked:?}");
        // Without a network all is there, with a word of it.
        server.set_faults(|_, _| Some(Fault::Refused));
        let (offline, messages) = render_kept(&sandbox, &server.url(store), &[]);
        assert!(offline == picture && messages.contains("a server could not be reached"), "{messages}");
        server.set_faults(|_, _| None);
        // A changed byte is found, and its part fetched again.
        for (i, (path, mut bytes)) in brickyard_tests::tree(&sandbox.path("cache/objects")).into_iter().enumerate() {
            let middle = if i % 2 == 0 { bytes.len() / 2 } else { bytes.len() - 1 - i % 8 };
            bytes[middle] ^= 1 << (i % 8);
            sandbox.write(sandbox.path("cache/objects").join(path), bytes);
        }
        assert!(render_kept(&sandbox, &server.url(store), &[]).0 == picture, "{store}");
        server.take_asked();
    }
    let info = cache_info(&sandbox);
    assert!(info["objects"].as_u64() > Some(10) && info["objects_bytes"].as_u64() > Some(10_000), "{info}");
    sandbox.command().env("BRICKYARD_CACHE", sandbox.path("cache")).args(["cache", "clear"]).output().expect("it runs");
    assert_eq!(cache_info(&sandbox)["objects"], 0);
    render_kept(&sandbox, &server.url("own.zarr"), &["--cache", "0"]);
    assert_eq!(cache_info(&sandbox)["objects"], 0);
}

#[test]
fn a_store_opened_before_comes_in_one_round_trip() {
    let (sandbox, server) = served();
    let (picture, _) = render_kept(&sandbox, &server.url("own.zarr"), &[]);
    server.take_asked();
    server.set_faults(|_, path| (path == "own.zarr/zarr.json").then_some(Fault::Stalled(3000)));
    assert!(render_kept(&sandbox, &server.url("own.zarr"), &[]).0 == picture);
    let asked = server.take_asked();
    let root = asked.iter().find(|asked| asked.path == "own.zarr/zarr.json").expect("it is confirmed");
    // All that a first picture needs is confirmed beside the root document, not after it.
    let beside = asked.iter().filter(|asked| asked.path.contains("/c/") && asked.at < root.at + Duration::from_secs(2));
    assert!(beside.count() > 4, "{asked:?}");
    // A changed store is read as it is now, though the kept one tells of other files.
    server.set_faults(|_, _| None);
    sandbox.run_ok("synth spheres own.zarr --shape 30,61,90 --brick 16 --shard 32 --quiet --overwrite");
    sandbox.run_ok("render own.zarr -o new.png --size 160x120 --backend cpu --exact");
    assert!(render_kept(&sandbox, &server.url("own.zarr"), &[]).0 == sandbox.read("new.png"));
}

#[test]
fn changes_on_the_server_are_seen_through_the_cache() {
    let (sandbox, server) = served();
    write_foreign(&sandbox, "foreign.zarr");
    for (store, other) in [
        ("own.zarr", "synth spheres own.zarr --shape 70,61,50 --brick 16 --shard 64 --quiet --overwrite"),
        ("foreign.zarr", ""),
    ] {
        let (before, _) = render_kept(&sandbox, &server.url(store), &[]);
        if other.is_empty() {
            for (path, mut bytes) in brickyard_tests::tree(&sandbox.path("foreign.zarr")) {
                if !path.to_string_lossy().contains(".z") {
                    bytes.reverse();
                    sandbox.write(sandbox.path("foreign.zarr").join(path), bytes);
                }
            }
        } else {
            sandbox.run_ok(other);
        }
        let (after, _) = render_kept(&sandbox, &server.url(store), &[]);
        sandbox.run_ok(&format!("render {store} -o new.png --size 160x120 --backend cpu --exact --overwrite"));
        assert!(after != before && after == sandbox.read("new.png"), "{store}");
    }
}

#[test]
fn processes_share_a_cache_and_killed_ones_leave_it_whole() {
    let (sandbox, server) = served();
    sandbox.run_ok("render own.zarr -o here.png --size 160x120 --backend cpu --exact");
    let start = |number: usize| {
        let line = format!(
            "render {} -o far{number}.png --size 160x120 --backend cpu --exact --overwrite",
            server.url("own.zarr")
        );
        let mut command = sandbox.command();
        command.env("BRICKYARD_CACHE", sandbox.path("cache")).args(line.split(' ')).spawn().expect("it can be started")
    };
    // Each is killed a little later than the one before.
    server.set_link(Link { round_trip: Duration::from_millis(2), bytes_per_s: None });
    for number in 0..6 {
        let mut killed = start(number);
        while server.take_asked().len() < number * 3 && killed.try_wait().is_ok_and(|ended| ended.is_none()) {
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(killed.kill());
        drop(killed.wait());
    }
    let running: Vec<_> = (0..8).map(start).collect();
    for (number, mut process) in running.into_iter().enumerate() {
        assert!(process.wait().expect("it is ours").success());
        assert!(sandbox.read(format!("far{number}.png")) == sandbox.read("here.png"), "{number}");
    }
    let (picture, _) = render_kept(&sandbox, &server.url("own.zarr"), &[]);
    assert!(picture == sandbox.read("here.png"));
}

#[test]
fn faults_of_a_server_are_overcome() {
    let (sandbox, server) = served();
    write_foreign(&sandbox, "foreign.zarr");
    for store in ["own.zarr", "foreign.zarr"] {
        sandbox.run_ok(&format!("render {store} -o {store}.png --size 160x120 --backend cpu --exact"));
        let faults = [
            Fault::Status(500),
            Fault::Status(503),
            Fault::Refused,
            Fault::Cut,
            Fault::Short,
            Fault::OtherRange,
            Fault::Flipped,
            Fault::Stalled(300),
        ];
        // One in six, all kinds in turn; documents have no checksum on the way.
        server.set_faults(move |number, path| {
            let fault = faults[(number / 6) as usize % faults.len()];
            let is_document = path.ends_with(".json")
                || path.contains("/.z")
                || fault == Fault::Flipped && path.starts_with("foreign");
            (number % 6 == 4 && !(is_document && fault == Fault::Flipped)).then_some(fault)
        });
        sandbox.run_ok(&format!(
            "render {} -o far.png --size 160x120 --backend cpu --exact --overwrite",
            server.url(store)
        ));
        assert!(sandbox.read("far.png") == sandbox.read(format!("{store}.png")), "{store}");
        server.set_faults(|_, _| None);
    }
}

#[test]
fn faults_that_last_are_told_apart() {
    let (sandbox, server) = served();
    sandbox.write("text.zarr", "no folder");
    let gone = Server::start(sandbox.path(".")).map(|server| server.url("own.zarr")).expect("a free port");
    for (address, code, words) in [
        (server.url("absent.zarr"), 3, "not a brick store"),
        (server.url("text.zarr"), 3, "not a brick store"),
        (gone, 1, "cannot be reached"),
        (server.url("own.zarr?a=b"), 3, "'?'"),
        ("ftp://example.org/own.zarr".into(), 3, "are not read"),
    ] {
        let (found, _, stderr) = sandbox.run(&format!("info {address}"));
        assert!(found == code && stderr.contains(words), "{address}: {found}: {stderr}");
    }
    for (status, code, words) in [(403, 1, "access is refused"), (500, 1, "the server fails (500"), (418, 3, "418")] {
        server.set_faults(move |_, _| Some(Fault::Status(status)));
        let (found, _, stderr) = sandbox.run(&format!("info {}", server.url("own.zarr")));
        assert!(found == code && stderr.contains(words), "{status}: {found}: {stderr}");
    }
}

#[test]
fn appended_steps_appear_at_an_address_whole() {
    let (sandbox, server) = served();
    let value = |time: u8, [z, y, x]: [u32; 3]| ((z * 5) ^ (y * 3) ^ x) as u8 ^ (time * 40);
    let append = |time: u8| {
        let voxels: Vec<u8> = chunks([30, 20, 40]).map(|place| value(time, place)).collect();
        sandbox.write(format!("{time}.raw"), voxels);
        sandbox.run_ok(&format!("append flow.zarr {time}.raw --shape 40,20,30 --dtype u8 --quiet"));
    };
    append(0);
    let mut store = Store::open(server.url("flow.zarr")).expect("a store");
    for time in 1..3u8 {
        append(time);
        let begun = Instant::now();
        // The root document is taken as it was for some seconds.
        store = loop {
            match store.newer().expect("a store that grows") {
                Some(newer) => break newer,
                None => assert!(begun.elapsed() < Duration::from_secs(30), "step {time}"),
            }
            std::thread::sleep(Duration::from_millis(200));
        };
        let volume = VolumeSource::of_store(&Arc::new(Store::open(server.url("flow.zarr")).expect("a store")));
        for step in 0..=time {
            for [z, y, x] in [[0, 0, 0], [29, 19, 39], [17, 3, 25]] {
                let probe = probe_voxel(&volume, step.into(), [x, y, z]).expect("a voxel");
                assert_eq!(probe.values, [f64::from(value(step, [z, y, x]))], "{step}: {x}, {y}, {z}");
            }
        }
    }
    assert_eq!(store.times(), 3);
}

#[test]
fn buckets_answer_as_disks() {
    if !takes_all() {
        return;
    }
    let sandbox = Sandbox::in_memory();
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let mut python = Command::new(format!("{root}/target/moto/bin/python"));
    python.arg(format!("{root}/tests/python/s3_buckets.py")).arg(sandbox.command().get_program());
    let output = python.arg(sandbox.path(".")).output().expect("made by `tools/setup buckets`");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn nothing_is_written_at_an_address() {
    let (sandbox, server) = served();
    let before = server.url("own.zarr");
    sandbox.write("a.raw", [0; 8]);
    for line in [
        "edit AT --name x",
        "append AT a.raw --shape 2,2,2 --dtype u8",
        "upgrade AT --ngff 0.6",
        "index AT",
        "verify AT --repair a.raw --shape 2,2,2 --dtype u8",
        "pack a.raw AT --shape 2,2,2 --dtype u8",
        "export own.zarr AT.npy",
        "mesh own.zarr AT.stl --isovalue 100",
        "render own.zarr -o AT.png",
        "synth turbulence AT --shape 8,8,8",
    ] {
        let (code, _, stderr) = sandbox.run(&line.replace("AT", &before));
        assert!([2, 3].contains(&code) && stderr.contains("never written"), "{line}: {code}: {stderr}");
        assert!(!sandbox.path("http:").exists(), "{line}");
    }
}
