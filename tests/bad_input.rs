//! Bad input, damaged stores, impossible requests: the exit code is as documented, the message names the file, the
//! expected and the found, and no partial result stands under the final name.

use brickyard_tests::{Sandbox, leave_out, read_png, tree, tree_difference};
use std::io::Write;
use std::path::Path;
use std::process::Command;

/// A line of arguments, its exit code, and words of its message.
type Case<'a> = (&'a str, i32, &'a [&'a str]);

const USAGE: i32 = 2;
const BAD_INPUT: i32 = 3;
const INCOMPLETE: i32 = 4;
const VERIFICATION_FAILED: i32 = 5;

/// Runs the cases. None may change or leave a file.
fn check(sandbox: &Sandbox, cases: &[Case]) {
    let before = tree(&sandbox.path(""));
    for (line, code, words) in cases {
        let (found, _, stderr) = sandbox.run(line);
        assert_eq!(found, *code, "brickyard {line}: {stderr}");
        let lower = stderr.to_lowercase();
        for word in *words {
            assert!(lower.contains(&word.to_lowercase()), "brickyard {line}: {word:?} is not in: {stderr}");
        }
        assert!(!lower.contains("panicked") && !lower.contains("backtrace"), "brickyard {line}: {stderr}");
        let changed = tree_difference(&tree(&sandbox.path("")), &before);
        assert!(changed.is_empty(), "brickyard {line} changed {changed:?}");
    }
}

/// A sandbox with `good.zarr`: two time steps of 40x36x50 voxels in bricks of 16 and shards of 32.
fn with_good_store() -> Sandbox {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth flow good.zarr --shape 40,36,50 --steps 2 --brick 16 --shard 32 --progress none");
    sandbox
}

#[test]
fn raw_files_that_do_not_fit_their_flags() {
    let sandbox = Sandbox::default();
    sandbox.write("a.raw", vec![1; 24_000]);
    sandbox.write("empty.raw", []);
    sandbox.write("cube.raw", vec![1; 27_000 * 2]);
    check(
        &sandbox,
        &[
            // 20 x 30 x 41 does not fit, but 20 x 30 x 40 would, and so would half the voxels as 16-bit.
            ("pack a.raw o.zarr --shape 20,30,41 --dtype u8", BAD_INPUT, &["a.raw", "24600", "24000", "20,30,40 u8"]),
            (
                "pack a.raw o.zarr --shape 20,30,20 --dtype u8",
                BAD_INPUT,
                &["12000", "24000", "u16 or i16", "2 time steps"],
            ),
            ("pack a.raw o.zarr --shape 20,30,39 --dtype u8", BAD_INPUT, &["23400", "600 too many", "--offset 600"]),
            ("pack cube.raw o.zarr --shape 9,9,9 --dtype f32", BAD_INPUT, &["would fit", "30,30,30 u16"]),
            ("pack empty.raw o.zarr --shape 2,2,2 --dtype u8", BAD_INPUT, &["empty.raw", "8 bytes", "found 0"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --offset 8", BAD_INPUT, &["24008", "24000"]),
            ("pack missing.raw o.zarr --shape 2,2,2 --dtype u8", BAD_INPUT, &["missing.raw", "No such file"]),
            ("pack a.raw o.zarr", USAGE, &["a.raw", "--shape", "--dtype"]),
            ("pack a.raw o.zarr --shape 20,30,40", USAGE, &["--dtype"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u12", USAGE, &["u12", "u8", "f32"]),
            ("pack a.raw o.zarr --shape 20,0,40 --dtype u8", USAGE, &["20,0,40", "zero"]),
            ("pack a.raw o.zarr --shape 20,-3,40 --dtype u8", USAGE, &["20,-3,40", "X,Y,Z"]),
            ("pack a.raw o.zarr --shape 4294967295,4294967295,4294967295 --dtype u8", USAGE, &["overflow"]),
            ("pack a.raw o.zarr --shape 4294967296,1,1 --dtype u8", USAGE, &["4294967295"]),
            // Fits into 2^63 voxels, but not into 2^63 bytes.
            ("pack a.raw o.zarr --shape 4294967295,2147483647,1 --dtype f32", USAGE, &["a.raw"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --axes zyq", USAGE, &["'q'", "t, c, z, y, x"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --axes yx", USAGE, &["'z'", "40"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --times 0", USAGE, &["time steps"]),
            ("pack --order given a.raw a.raw o.zarr --shape 20,30,20 --dtype u8 --times 2", USAGE, &["2 files"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --spacing 1,0,1", USAGE, &["1,0,1", "positive"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --origin 1,nan,1", USAGE, &["1,nan,1", "finite"]),
            (
                "pack a.raw o.zarr --shape 20,30,40 --dtype u8 --kind labels --downsample mode,mean",
                USAGE,
                &["mean of two labels"],
            ),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --nodata abc", USAGE, &["'abc'", "finite number, or none"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --nodata nan", USAGE, &["'nan'", "finite number", "NaN"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --nodata 300", USAGE, &["--nodata 300", "u8", "0 to 255"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --nodata 0.5", USAGE, &["0.5", "whole numbers"]),
            ("pack cube.raw o.zarr --shape 30,30,30 --dtype u16 --nodata -1", USAGE, &["--nodata -1", "0 to 65535"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --brick 60", USAGE, &["60", "power of two"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --brick 0", USAGE, &["power of two"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --shard 100", USAGE, &["100", "multiple"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --shard 16384", USAGE, &["16384", "8192"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --shard-time 0", USAGE, &["--shard-time", "0"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --codec lzma:9", USAGE, &["lzma:9", "zstd"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --memory 12parsecs", USAGE, &["parsecs", "MiB"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --memory 1KiB", USAGE, &["--memory", "at least"]),
            ("pack a.raw o.zarr --shape 20,30,40 --dtype u8 --resume --overwrite", USAGE, &["--resume", "--overwrite"]),
            ("pack a.raw", USAGE, &["STORE"]),
        ],
    );
}

/// A NIfTI-1 header of a volume of these dimensions, with the standard's numbers `datatype` and `bitpix`.
pub(crate) fn nifti_header(dims: &[i16], datatype: i16, bitpix: i16) -> Vec<u8> {
    let mut header = vec![0u8; 352];
    let mut put = |at: usize, bytes: &[u8]| header[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348i32.to_le_bytes());
    put(40, &(dims.len() as i16).to_le_bytes());
    for (i, n) in dims.iter().enumerate() {
        put(42 + 2 * i, &n.to_le_bytes());
    }
    put(70, &datatype.to_le_bytes());
    put(72, &bitpix.to_le_bytes());
    for i in 0..4 {
        put(76 + 4 * i, &1f32.to_le_bytes());
    }
    put(108, &352f32.to_le_bytes());
    put(344, b"n+1\0");
    header
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).expect("writing to memory")
}

#[test]
fn damaged_and_foreign_files() {
    let sandbox = Sandbox::default();
    let voxels: Vec<u8> = (0..20 * 30 * 40u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    let nifti = [nifti_header(&[20, 30, 40], 2, 8), voxels.clone()].concat();
    let gz = gzipped(&nifti);
    let mut flipped = gz.clone();
    flipped[gz.len() / 2] ^= 0x10;
    let npy = |header: &str| {
        let padded = format!("{header:<117}\n");
        [b"\x93NUMPY\x01\x00", &(padded.len() as u16).to_le_bytes()[..], padded.as_bytes(), &voxels].concat()
    };
    let mut tiff_loop = b"II*\0\x08\0\0\0\x01\0\0\x01\x03\0\x01\0\0\0\x04\0\0\0".to_vec();
    tiff_loop.extend_from_slice(&8u32.to_le_bytes()); // The next directory is this one.
    for (name, bytes) in [
        ("short.nii", nifti[..nifti.len() - 100].to_vec()),
        ("header.nii", nifti[..200].to_vec()),
        ("short.nii.gz", gz[..gz.len() / 2].to_vec()),
        ("tail.nii.gz", gz[..gz.len() - 4].to_vec()),
        ("flipped.nii.gz", flipped),
        ("garbage.nii", vec![7; 1000]),
        ("complex.nii", nifti_header(&[20, 30, 40], 2048, 256)),
        ("zero.nii", nifti_header(&[20, 0, 40], 2, 8)),
        ("negative.nii", nifti_header(&[20, -30, 40], 2, 8)),
        ("huge.nii", nifti_header(&[32767; 7], 64, 64)),
        ("short.npy", npy("{'descr': '|u1', 'fortran_order': False, 'shape': (41, 30, 20)}")),
        ("object.npy", npy("{'descr': '|O', 'fortran_order': False, 'shape': (40, 30, 20)}")),
        ("double.npy", npy("{'descr': '<f8', 'fortran_order': False, 'shape': (10, 15, 20)}")),
        ("zero.npy", npy("{'descr': '|u1', 'fortran_order': False, 'shape': (0, 30, 20)}")),
        ("huge.npy", npy("{'descr': '|u1', 'fortran_order': False, 'shape': (4294967295, 4294967295, 4294967295)}")),
        ("four.npy", npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 20, 30, 20)}")),
        ("garbage.npy", b"\x93NUMPY\x01\x00\xff\xff{'descr".to_vec()),
        ("garbage.tif", vec![7; 1000]),
        ("empty.tif", Vec::new()),
        ("loop.tif", tiff_loop),
        ("magic", [&[0; 128][..], b"DICM"].concat()),
        ("garbage.dcm", [&[0; 128][..], b"DICM", &[7; 1000]].concat()),
        ("what.xyz", voxels.clone()),
        ("whole.nii.gz", gz.clone()),
        ("scene.hdr", b"ENVI\nsamples = 7\n".to_vec()),
    ] {
        sandbox.write(name, bytes);
    }
    std::fs::create_dir(sandbox.path("folder")).expect("the sandbox is writable");
    sandbox.write("folder/notes.txt", "no planes");
    check(
        &sandbox,
        &[
            ("pack short.nii o.zarr", BAD_INPUT, &["short.nii", "24352", "24252"]),
            ("pack header.nii o.zarr", BAD_INPUT, &["header.nii", "200"]),
            ("pack short.nii.gz o.zarr", BAD_INPUT, &["short.nii.gz"]),
            ("pack tail.nii.gz o.zarr", BAD_INPUT, &["tail.nii.gz"]),
            ("pack flipped.nii.gz o.zarr", BAD_INPUT, &["flipped.nii.gz"]),
            ("pack garbage.nii o.zarr", BAD_INPUT, &["garbage.nii", "NIfTI"]),
            ("pack complex.nii o.zarr", BAD_INPUT, &["complex.nii", "complex", "not supported", "fslsplit"]),
            ("pack zero.nii o.zarr", BAD_INPUT, &["zero.nii", "0"]),
            ("pack negative.nii o.zarr", BAD_INPUT, &["negative.nii", "-30"]),
            ("pack huge.nii o.zarr", BAD_INPUT, &["huge.nii"]),
            ("pack short.npy o.zarr", BAD_INPUT, &["short.npy", "expected", "found"]),
            ("pack object.npy o.zarr", BAD_INPUT, &["object.npy", "O", "are read"]),
            ("pack double.npy o.zarr", USAGE, &["double.npy", "--allow-lossy"]),
            ("pack zero.npy o.zarr", BAD_INPUT, &["zero.npy", "with 1 channel and 1 time step"]),
            ("pack short.nii.gz folder o.zarr", BAD_INPUT, &["folder", "a folder among other inputs"]),
            ("pack whole.nii.gz o.zarr --scratch missing/folder", 1, &["missing/folder", "--scratch"]),
            ("pack huge.npy o.zarr", BAD_INPUT, &["huge.npy"]),
            ("pack four.npy o.zarr", USAGE, &["four.npy", "--axes"]),
            ("pack garbage.npy o.zarr", BAD_INPUT, &["garbage.npy"]),
            ("pack garbage.tif o.zarr", BAD_INPUT, &["garbage.tif", "TIFF"]),
            ("pack empty.tif o.zarr", BAD_INPUT, &["empty.tif"]),
            ("pack loop.tif o.zarr", BAD_INPUT, &["loop.tif"]),
            ("pack magic o.zarr", BAD_INPUT, &["magic", "TransferSyntaxUID"]),
            ("pack garbage.dcm o.zarr", BAD_INPUT, &["garbage.dcm"]),
            ("pack what.xyz o.zarr", BAD_INPUT, &["what.xyz", "--shape", "DICOM"]),
            ("pack scene.hdr o.zarr", BAD_INPUT, &["scene.hdr", "raw file is missing"]),
            ("pack /dev/null o.zarr", BAD_INPUT, &["/dev/null: a pipe or a device", "write it to a file first"]),
            ("pack folder o.zarr", BAD_INPUT, &["folder"]),
            ("pack missing.nii o.zarr", BAD_INPUT, &["missing.nii", "No such file"]),
        ],
    );
}

#[test]
fn what_is_not_a_finished_store() {
    let sandbox = with_good_store();
    sandbox.write("file.zarr", "a file");
    std::fs::create_dir(sandbox.path("folder")).expect("the sandbox is writable");
    sandbox.copy("good.zarr", "unmarked.zarr");
    std::fs::remove_file(sandbox.path("unmarked.zarr/zarr.json")).expect("it is there");
    sandbox.copy("unmarked.zarr", "unfinished.zarr");
    sandbox.write("unfinished.zarr/.brickyard-journal", "{\"settings\": {}, \"shards\": 8}\n9 00000000 0/c/0/0/0/0\n");
    sandbox.copy("good.zarr", "future.zarr");
    let root = String::from_utf8(sandbox.read("good.zarr/zarr.json")).expect("text");
    sandbox.write("future.zarr/zarr.json", root.replacen("\"version\": 2", "\"version\": 999", 1));
    sandbox.copy("good.zarr", "garbled.zarr");
    sandbox.write("garbled.zarr/zarr.json", &root[..root.len() / 2]);
    sandbox.copy("good.zarr", "reshaped.zarr");
    let level = String::from_utf8(sandbox.read("good.zarr/0/zarr.json")).expect("text");
    sandbox.write("reshaped.zarr/0/zarr.json", level.replacen("50", "4000000000", 1));
    std::fs::create_dir(sandbox.path("foreign.zarr")).expect("the sandbox is writable");
    sandbox.write("foreign.zarr/zarr.json", r#"{"zarr_format": 3, "node_type": "group", "attributes": {}}"#);
    for command in ["info STORE", "verify STORE", "export STORE o.raw", "render STORE -o o.png"] {
        let line = |store: &str| command.replace("STORE", store);
        // Another program's Zarr is read, but not verified.
        let of_foreign = if command.starts_with("verify") { "not supported" } else { "holds no dataset" };
        for (store, code, words) in [
            ("missing.zarr", BAD_INPUT, ["missing.zarr", "No such file"].as_slice()),
            ("file.zarr", BAD_INPUT, &["file.zarr", "not a brick store"]),
            ("folder", BAD_INPUT, &["folder", "not a brick store", "brickyard pack"]),
            ("unmarked.zarr", BAD_INPUT, &["unmarked.zarr", "not a brick store"]),
            ("unfinished.zarr", INCOMPLETE, &["unfinished.zarr", "incomplete", "12 %", "--resume to finish it"]),
            ("future.zarr", BAD_INPUT, &["future.zarr", "999", "not supported", "a later version of brickyard"]),
            ("garbled.zarr", BAD_INPUT, &["garbled.zarr", "zarr.json", "restore the file"]),
            ("reshaped.zarr", BAD_INPUT, &["reshaped.zarr", "expected", "found"]),
            ("foreign.zarr", BAD_INPUT, &["foreign.zarr", of_foreign]),
        ] {
            // Damaged documents have a separate exit code in `verify`.
            let is_damaged = ["garbled.zarr", "reshaped.zarr"].contains(&store) && command.starts_with("verify");
            check(&sandbox, &[(&line(store), if is_damaged { VERIFICATION_FAILED } else { code }, words)]);
            let (_, _, said) = sandbox.run(&line(store));
            assert!(said.matches("--resume").count() <= 1, "told twice: {said}");
        }
    }
}

/// The first stored brick's range in a shard file. The file ends with 16 bytes per entry and a checksum.
fn first_brick(shard: &[u8], entries: usize) -> std::ops::Range<usize> {
    let index = &shard[shard.len() - 4 - 16 * entries..];
    let number = |at: usize| u64::from_le_bytes(index[at..at + 8].try_into().expect("eight bytes"));
    let stored = (0..entries).find(|i| number(16 * i) != u64::MAX).expect("a stored brick");
    let (offset, length) = (number(16 * stored) as usize, number(16 * stored + 8) as usize);
    offset..offset + length
}

/// Opaque for all values: any hole would show the background.
const OPAQUE: &str = r#"{"color": [[0, 0, 0, 1], [200, 1, 1, 0]], "opacity": [[0, 1]], "unit_distance": 0.1}"#;
const VIEW: &str = "--size 160x120 --transfer opaque.json --background 1,0,1 --backend cpu --overwrite";

#[test]
fn a_damaged_brick_is_named_counted_and_drawn_around() {
    let sandbox = Sandbox::default();
    sandbox.write("opaque.json", OPAQUE);
    sandbox.run_ok("synth turbulence good.zarr --shape 80,72,60 --brick 16 --shard 32 --progress none");
    sandbox.run_ok("verify good.zarr --progress none");
    sandbox.run_ok(&format!("render good.zarr -o good.png {VIEW} --level 0"));
    let background = |path: &str| {
        let picture = read_png(&sandbox.path(path));
        picture.rgb.iter().map(|p| *p == [255, 0, 255]).collect::<Vec<bool>>()
    };
    let silhouette = background("good.png");
    assert!(silhouette.contains(&true) && silhouette.contains(&false), "the picture shows body and background");
    // The brick nearest to the default camera, which looks from -y, slightly from above: the shard of the last z.
    let shard = sandbox.read("good.zarr/0/c/1/0/0");
    let brick = first_brick(&shard, 8);
    let places = [("first", brick.start), ("middle", brick.start + brick.len() / 2), ("last", brick.end - 1)];
    for (name, at) in places {
        let store = format!("{name}.zarr");
        sandbox.copy("good.zarr", &store);
        let mut damaged = shard.clone();
        damaged[at] ^= 1;
        sandbox.write(format!("{store}/0/c/1/0/0"), damaged);
        let (code, stdout, stderr) = sandbox.run(&format!("verify {store} --progress none"));
        assert_eq!(code, VERIFICATION_FAILED, "{name}: {stdout}{stderr}");
        assert!(stdout.contains("0/c/1/0/0") && stdout.contains("t0 c0 level 0 brick (0,0,2)"), "{name}: {stdout}");
        assert_eq!(stdout.lines().count(), 1, "one byte is one problem: {stdout}");
        check(
            &sandbox,
            &[
                (&format!("export {store} o.raw"), BAD_INPUT, &["level 0 brick (0,0,2)", "damaged", "checksum"]),
                // Away from the damage everything works; the damaged brick would be missing at a coarser level, too.
                (&format!("info {store}"), 0, &[]),
            ],
        );
        sandbox.run_ok(&format!("export {store} o.raw --roi 16:40,0:30,0:30"));
        sandbox.run_ok(&format!("export {store} o1.raw --level 1"));
        let (code, _, stderr) = sandbox.run(&format!("render {store} -o o.png {VIEW} --level 0 --stats stats.json"));
        assert_eq!(code, 0, "{name}: {stderr}");
        assert!(
            stderr.contains("1 brick could not be read") && stderr.contains("brickyard verify"),
            "{name}: {stderr}"
        );
        let stats: serde_json::Value = serde_json::from_slice(&sandbox.read("stats.json")).expect("JSON");
        assert_eq!(stats["bricks"]["failed"], 1, "{name}");
        let completeness = stats["completeness"].as_f64().expect("a number");
        assert!(completeness > 0.5 && completeness < 1.0, "{name}: {completeness} of the picture as asked for");
        assert!(background("o.png") == silhouette, "{name}: the picture has a hole");
        for left in ["o.raw", "o.raw.json", "o1.raw", "o1.raw.json", "o.png", "stats.json"] {
            std::fs::remove_file(sandbox.path(left)).expect("it was written");
        }
    }
}

#[test]
fn damage_other_than_a_bricks() {
    let sandbox = with_good_store();
    sandbox.write("opaque.json", OPAQUE);
    let shard = sandbox.read("good.zarr/0/c/0/0/0/0");
    let damaged = |name: &str, path: &str, damage: &dyn Fn(&mut Vec<u8>)| {
        sandbox.copy("good.zarr", name);
        let mut bytes = sandbox.read(format!("{name}/{path}"));
        damage(&mut bytes);
        sandbox.write(format!("{name}/{path}"), bytes);
    };
    let first = "0/c/0/0/0/0";
    let index = shard.len() - 40;
    damaged("index.zarr", first, &|b| b[index] ^= 4);
    damaged("short.zarr", first, &|b| b.truncate(b.len() / 2));
    damaged("empty.zarr", first, &|b| b.clear());
    damaged("long.zarr", first, &|b| b.push(0));
    damaged("coarsest.zarr", "2/c/0/0/0/0", &|b| b[9] ^= 4);
    damaged("side.zarr", "0/.brickyard/ranges/c/0/0/0/0/0/0", &|b| b[9] ^= 4);
    damaged("hashes.zarr", "1/.brickyard/hashes/c/0/0/0/0/0/0", &|b| b.truncate(3));
    damaged("shards.zarr", "0/.brickyard/shards/c/0/0/0/0/0/0", &|b| b[9] ^= 4);
    damaged("old.zarr", "zarr.json", &|b| {
        let text = String::from_utf8_lossy(b).replace("\"version\": 2", "\"version\": 1");
        *b = text.into_bytes();
    });
    sandbox.copy("good.zarr", "missing.zarr");
    std::fs::remove_file(sandbox.path(format!("missing.zarr/{first}"))).expect("it is there");
    sandbox.copy("good.zarr", "sideless.zarr");
    std::fs::remove_dir_all(sandbox.path("sideless.zarr/0/.brickyard")).expect("it is there");

    // The rest of a damaged shard is still usable, and the picture has no hole.
    sandbox.run_ok(&format!("render good.zarr -o good.png {VIEW} --level 0"));
    let silhouette = |path: &str| {
        let picture = read_png(&sandbox.path(path));
        picture.rgb.iter().map(|p| *p == [255, 0, 255]).collect::<Vec<bool>>()
    };
    for (name, what) in
        [("index", "index"), ("short", "bytes"), ("empty", "bytes"), ("long", "bytes"), ("missing", "missing shard")]
    {
        let (code, stdout, stderr) = sandbox.run(&format!("verify {name}.zarr --progress none"));
        assert_eq!(code, VERIFICATION_FAILED, "{name}: {stdout}{stderr}");
        assert!(stdout.contains(first) && stdout.to_lowercase().contains(what), "{name}: {what:?} is not in: {stdout}");
        check(
            &sandbox,
            &[
                (&format!("info {name}.zarr"), 0, &[]),
                (&format!("export {name}.zarr o.raw"), BAD_INPUT, &[first, what]),
            ],
        );
        sandbox.run_ok(&format!("export {name}.zarr o.raw --time 1"));
        for left in ["o.raw", "o.raw.json"] {
            std::fs::remove_file(sandbox.path(left)).expect("it was written");
        }
        let (code, _, stderr) = sandbox.run(&format!("render {name}.zarr -o o.png {VIEW} --level 0"));
        assert!(code == 0 && stderr.contains("could not be read"), "{name}: exit {code}: {stderr}");
        assert!(stderr.contains(&format!("{name}.zarr/{first}: ")), "{name}: the file is not named: {stderr}");
        assert!(silhouette("o.png") == silhouette("good.png"), "{name}: the picture has a hole");
        std::fs::remove_file(sandbox.path("o.png")).expect("it was written");
    }
    // Bricks with unknown ranges may show anything, and the picture is the same.
    let (code, _, stderr) = sandbox.run(&format!("render side.zarr -o o.png {VIEW} --level 0"));
    assert!(code == 0 && stderr.contains("side.zarr/0/.brickyard/ranges"), "exit {code}: {stderr}");
    assert!(silhouette("o.png") == silhouette("good.png"));
    std::fs::remove_file(sandbox.path("o.png")).expect("it was written");
    // Without the coarsest level there are no stand-ins; without side data, no store.
    let damaged = "coarsest.zarr/2/c/0/0/0/0";
    check(
        &sandbox,
        &[
            ("render coarsest.zarr -o o.png --level 2", BAD_INPUT, &[damaged, "level 2 brick (0,0,0)"]),
            ("verify coarsest.zarr --progress none", VERIFICATION_FAILED, &["1 of", "is damaged", "level 2"]),
            ("verify side.zarr --progress none", VERIFICATION_FAILED, &["1 problem"]),
            ("verify hashes.zarr --progress none", VERIFICATION_FAILED, &["1 problem"]),
            ("export shards.zarr o.npy", BAD_INPUT, &["shards.zarr/0/.brickyard/shards", "checksum"]),
            ("info old.zarr", BAD_INPUT, &["old.zarr", "format 1", "--overwrite"]),
            ("verify old.zarr", BAD_INPUT, &["old.zarr", "format 1"]),
            ("info sideless.zarr", BAD_INPUT, &["sideless.zarr/0/.brickyard"]),
        ],
    );
}

#[test]
fn outputs_that_exist_are_kept() {
    let sandbox = with_good_store();
    for name in ["o.raw", "o.npy", "o.png", "o_001.png", "stats.json", "file.zarr"] {
        sandbox.write(name, "precious");
    }
    std::fs::create_dir(sandbox.path("folder.zarr")).expect("the sandbox is writable");
    sandbox.write("folder.zarr/thesis.txt", "precious");
    for name in ["folder.raw", "folder.png"] {
        std::fs::create_dir(sandbox.path(name)).expect("the sandbox is writable");
    }
    let precious = tree(&sandbox.path(""));
    let exists = "exists";
    check(
        &sandbox,
        &[
            ("synth ct good.zarr --shape 20,20,20", USAGE, &["good.zarr", exists, "--overwrite"]),
            ("synth ct o.raw --shape 20,20,20", USAGE, &["o.raw", exists, "--overwrite"]),
            ("pack o.raw good.zarr --shape 2,2,2 --dtype u8", USAGE, &["good.zarr", exists, "--overwrite"]),
            ("pack o.raw good.zarr --shape 2,2,2 --dtype u8 --resume", USAGE, &["good.zarr"]),
            // Anything but a store is never replaced, even on request.
            ("pack o.raw folder.zarr --shape 2,2,2 --dtype u8 --overwrite", USAGE, &["folder.zarr", "left alone"]),
            ("pack o.raw file.zarr --shape 2,2,2 --dtype u8 --overwrite", USAGE, &["file.zarr", "left alone"]),
            ("synth ct folder.raw --shape 2,2,2 --overwrite", USAGE, &["folder.raw", "left alone"]),
            ("export good.zarr folder.raw --overwrite", USAGE, &["folder.raw", "left alone"]),
            ("render good.zarr -o folder.png --overwrite", USAGE, &["folder.png", "left alone"]),
            ("export good.zarr o.raw", USAGE, &["o.raw", exists, "--overwrite"]),
            ("export good.zarr o.npy", USAGE, &["o.npy", exists, "--overwrite"]),
            ("render good.zarr -o o.png", USAGE, &["o.png", exists, "--overwrite"]),
            ("render good.zarr -o o.png --compositor reference", USAGE, &["o.png", exists, "--overwrite"]),
            ("render good.zarr -o o.png --orbit 2", USAGE, &["o_001.png", exists, "--overwrite"]),
            ("render good.zarr -o new.png --stats new.png", USAGE, &["new.png", "statistics"]),
            ("render good.zarr -o new.png --stats stats.json", USAGE, &["stats.json", exists, "--overwrite"]),
        ],
    );
    // A failed overwrite keeps the old file.
    check(
        &sandbox,
        &[
            ("pack missing.nii good.zarr --overwrite", BAD_INPUT, &["missing.nii"]),
            ("export good.zarr o.raw --level 9 --overwrite", USAGE, &["level 9"]),
            ("render good.zarr -o o.png --level 9 --overwrite", USAGE, &["level 9"]),
            ("synth ct o.raw --shape 2,2,2 --dtype i32 --overwrite", USAGE, &["i32"]),
        ],
    );
    assert!(tree(&sandbox.path("")) == precious);
    sandbox.run_ok("export good.zarr o.raw --overwrite");
    assert_eq!(sandbox.read("o.raw").len(), 40 * 36 * 50);
    sandbox.run_ok("synth constant good.zarr --shape 20,20,20 --overwrite --progress none");
    assert_eq!(sandbox.json("info good.zarr --json")["levels"][0]["extent"], serde_json::json!([20, 20, 20]));
}

#[test]
fn times_and_steps_that_cannot_be() {
    let sandbox = Sandbox::default();
    ["one", "two"].iter().for_each(|folder| std::fs::create_dir(sandbox.path(folder)).unwrap());
    for name in ["s_1.raw", "s_2.raw", "s_4.raw", "one/a_1.raw", "one/a_01.raw", "two/b.npy", "two/c.nii"] {
        sandbox.write(name, vec![1; 8]);
    }
    sandbox.write("t.raw", vec![1; 24]);
    sandbox.write("good.txt", "0\n1\n5\n");
    sandbox.write("short.txt", "0\n1\n");
    sandbox.write("back.txt", "0\n5\n1\n");
    sandbox.write("words.txt", "0\none\n2\n");
    let raw = |rest: &str| format!("pack {rest} --shape 2,2,2 --dtype u8");
    let timed = |rest: &str| raw(&format!("t.raw o.zarr --times 3 {rest}"));
    check(
        &sandbox,
        &[
            (&timed("--time-step 0"), USAGE, &["--time-step", "positive", "'0'"]),
            (&timed("--time-step -1"), USAGE, &["--time-step", "positive", "'-1'"]),
            (&timed("--time-unit mm"), USAGE, &["--time-unit", "'mm'", "second (s), millisecond (ms)"]),
            (&timed("--time-stamps gone.txt"), BAD_INPUT, &["gone.txt", "No such file"]),
            (&timed("--time-stamps short.txt"), USAGE, &["short.txt", "--time-stamps", "2 numbers", "3 time steps"]),
            (&timed("--time-stamps back.txt"), BAD_INPUT, &["back.txt", "ascending", "1 of step 2 after 5 of step 1"]),
            (&timed("--time-stamps words.txt"), BAD_INPUT, &["words.txt", "line 2", "'one'"]),
            (&timed("--time-stamps good.txt --time-step 1"), USAGE, &["--time-stamps", "--time-step"]),
            (&raw("s_*.raw o.zarr"), USAGE, &["without 3", "--order natural"]),
            (&raw("s_%d.raw o.zarr"), USAGE, &["without 3", "--order natural"]),
            (&raw("x_*.raw o.zarr"), USAGE, &["x_*.raw", "no file matches", "s_1.raw"]),
            (&raw("s_%4d.raw o.zarr"), USAGE, &["%4d", "expected %d"]),
            (&raw("one o.zarr"), USAGE, &["a_01.raw and a_1.raw have the same number"]),
            (&raw("s_1.raw s_2.raw s_1.raw o.zarr"), USAGE, &["s_1.raw", "named twice", "--order given"]),
            ("pack two o.zarr", USAGE, &["two", "1 .npy and 1 NIfTI files"]),
        ],
    );
}

#[test]
fn requests_that_a_store_cannot_meet() {
    let sandbox = with_good_store();
    sandbox.write("no-eyes.json", r#"{"stereo": {"layout": "anaglyph", "eye_separation": 0}}"#);
    sandbox.write("behind.json", r#"{"stereo": {"layout": "anaglyph", "convergence": -4}}"#);
    check(
        &sandbox,
        &[
            ("export good.zarr o.raw --level 3", USAGE, &["level 3", "2"]),
            ("view good.zarr --stats no/such/s.json", USAGE, &["no/such/s.json", "there is no folder"]),
            ("export good.zarr o.raw --time 2", USAGE, &["time", "2"]),
            ("export good.zarr o.raw --time 0:3", USAGE, &["--time 0:3", "2 time steps"]),
            ("export good.zarr o.raw --time 1:1", USAGE, &["1:1", "holds no step"]),
            ("export good.zarr o.raw --time last", USAGE, &["last", "10:200:5"]),
            ("probe good.zarr 1,1,1 --time 2", USAGE, &["--time 2", "2 time steps"]),
            ("probe good.zarr 1,1,1 --time 1:9", USAGE, &["--time 1:9", "2 time steps"]),
            ("probe good.zarr 1,1,1 --time 0:2:0", USAGE, &["stride of 0"]),
            (
                "probe good.zarr 1,1,1 --time all --plot no/such/o.svg",
                USAGE,
                &["no/such/o.svg: there is no folder no/such"],
            ),
            (
                "render good.zarr -o o.png --stats no/such/s.json",
                USAGE,
                &["no/such/s.json: there is no folder no/such"],
            ),
            ("render good.zarr -o o.png -j 100000", USAGE, &["threads from 1 to 1024"]),
            ("probe good.zarr 1,1,99 --time all", USAGE, &["1,1,99", "outside of the volume"]),
            ("export good.zarr o.raw --channel 1", USAGE, &["no channel '1'", "the store's channels are 0"]),
            ("export good.zarr o.raw --roi 0:41,0:36,0:50", USAGE, &["40"]),
            ("export good.zarr o.raw --roi 5:5,0:36,0:50", USAGE, &["empty"]),
            ("export good.zarr o.raw --roi 0:5,0:5", USAGE, &["x0:x1,y0:y1,z0:z1"]),
            ("export good.zarr o.jpeg", USAGE, &["o.jpeg", ".raw", ".npy"]),
            ("export good.zarr no/such/o.raw", USAGE, &["no/such/o.raw", "no folder no/such"]),
            ("render good.zarr", USAGE, &["--output"]),
            ("render good.zarr -o o.png --level 3", USAGE, &["level 3", "3"]),
            ("render good.zarr -o o.png --level fine", USAGE, &["fine", "auto"]),
            ("render good.zarr -o o.png --time 2", USAGE, &["--time 2", "2 time steps"]),
            ("render good.zarr -o o.png --time 0:3", USAGE, &["--time 0:3", "2 time steps"]),
            ("bench good.zarr --time 0:2", USAGE, &["--time 0:2", "one time step"]),
            ("bench good.zarr --scenario play --rate 0", USAGE, &["--rate", "0"]),
            (
                "bench good.zarr --scenario play --stats no/such/s.json --steps 1 --no-drawing",
                USAGE,
                &["no/such/s.json"],
            ),
            ("render good.zarr -o o.png --channel 1", USAGE, &["no channel '1'", "the store's channels are 0"]),
            (
                "render good.zarr -o o.png --channel 1 --transfer gray",
                USAGE,
                &["no channel '1'", "the store's channels are 0"],
            ),
            (
                "render good.zarr -o o.png --channel 1 --compositor reference",
                USAGE,
                &["no channel '1'", "the store's channels are 0"],
            ),
            ("render good.zarr -o o.png --backend cpu --compositor sorted", USAGE, &["raycast", "--backend gpu"]),
            ("render good.zarr -o o.png --backend cpu --compositor compute", USAGE, &["compute", "raycast"]),
            ("render good.zarr -o o.png -j 0", USAGE, &["--threads", "from 1 to 1024"]),
            ("render good.zarr -o o.png --size 0x5", USAGE, &["0x5", "16384"]),
            ("render good.zarr -o o.png --size 100000x5", USAGE, &["100000x5", "16384"]),
            ("render good.zarr -o o.png --size large", USAGE, &["large", "WxH"]),
            ("render good.zarr -o o.jpg", USAGE, &["o.jpg", "PNG", ".png"]),
            ("render good.zarr -o o.png --slice z=120%", USAGE, &["z=120%", "0% to 100%"]),
            ("render good.zarr -o o.png --fov 200", USAGE, &["200", "180"]),
            ("render good.zarr -o o.png --fov 30 --ortho 4", USAGE, &["--fov", "--ortho"]),
            ("render good.zarr -o o.png --stereo toe-in", USAGE, &["toe-in", "side-by-side"]),
            (
                "render good.zarr -o o.png --stereo anaglyph --eye-separation 3",
                USAGE,
                &["--eye-separation", "--scene", r#"{"stereo": {"layout": "anaglyph", "eye_separation": 3}}"#],
            ),
            ("render good.zarr -o o.png --convergence 3", USAGE, &["--scene", r#""convergence": 3"#]),
            ("render good.zarr -o o.png --scene no-eyes.json", USAGE, &["eye_separation is 0", "positive"]),
            ("render good.zarr -o o.png --scene behind.json", USAGE, &["convergence is -4", "positive"]),
            (
                "render good.zarr -o o.png --stereo side-by-side --size 63x48",
                USAGE,
                &["side-by-side", "width", "63x48"],
            ),
            ("render good.zarr -o o.png --stereo top-bottom --size 64x47", USAGE, &["top-bottom", "height", "64x47"]),
            ("render good.zarr -o o.png --ortho -1", USAGE, &["-1"]),
            ("render good.zarr -o o.png --eye 1,1,1 --target 1,1,1", USAGE, &["eye", "direction"]),
            ("render good.zarr -o o.png --eye 1,1,9 --target 1,1,1 --up 0,0,1", USAGE, &["up"]),
            ("render good.zarr -o o.png --step 0", USAGE, &["'0': expected 0.005 to 16 voxels"]),
            ("render good.zarr -o o.png --pixel-error nan", USAGE, &["positive"]),
            ("render good.zarr -o o.png --background 0,0,2", USAGE, &["0..1"]),
            ("render good.zarr -o o.png --mode xray", USAGE, &["xray", "minip"]),
            ("render good.zarr -o o.png --transfer sepia", USAGE, &["'sepia': not a file", "viridis", "ct-angio"]),
            ("render good.zarr -o o.png --transfer Magmar", USAGE, &["did you mean 'magma'?"]),
            ("render good.zarr -o o.png --transfer missing.vp", USAGE, &["'missing.vp': not a file"]),
            ("render good.zarr -o o.png --gpu-memory banana", USAGE, &["banana"]),
            ("render good.zarr -o o.png --orbit 0", USAGE, &["--orbit 0"]),
            ("render good.zarr -o o.png --orbit 4000000000", USAGE, &["--orbit 4000000000", "1000000"]),
            ("render good.zarr -o o.png --orbit 2 --path p.json", USAGE, &["--orbit", "--path"]),
            ("render good.zarr -o o.png --frames 5", USAGE, &["--frames", "--path"]),
            ("render good.zarr -o o.png --rate 5", USAGE, &["--rate", "--output"]),
            ("render good.zarr", USAGE, &["--output"]),
            ("render good.zarr -o o.png --movie o.gif", USAGE, &["--movie", "--output"]),
            ("render good.zarr --movie o.webm --time all", USAGE, &["o.webm", ".gif, .y4m or .mp4"]),
            ("render good.zarr --movie o --time all", USAGE, &["o: expected", ".gif, .y4m or .mp4"]),
            (
                "render good.zarr --movie no/such/o.gif --time all",
                USAGE,
                &["no/such/o.gif: there is no folder no/such"],
            ),
            (
                "render good.zarr --movie no/such/o.mp4 --time all",
                USAGE,
                &["no/such/o.mp4: there is no folder no/such"],
            ),
            ("render good.zarr --movie good.zarr --time all", USAGE, &["good.zarr", "is a folder"]),
            ("render good.zarr --movie o.gif", USAGE, &["o.gif", "one picture", "--time all"]),
            ("render good.zarr --movie o.gif --time 1:2", USAGE, &["o.gif", "one picture", "--time all"]),
            ("render good.zarr --movie o.gif --time 0:3", USAGE, &["--time 0:3", "2 time steps"]),
            ("render good.zarr --movie o.gif --time all --rate 0", USAGE, &["--rate", "'0'", "0.01 to 1000"]),
            ("render good.zarr --movie o.gif --time all --rate fast", USAGE, &["--rate", "'fast'", "29.97"]),
            ("render good.zarr --movie o.gif --time all --rate 60", USAGE, &["o.gif", "at most 50", "60", ".y4m"]),
            ("render good.zarr --movie o.gif --time all --stats o.gif", USAGE, &["o.gif", "hold the statistics"]),
            // One file by two spellings of its path.
            ("render good.zarr -o o.png --stats ./o.png", USAGE, &["o.png", "hold the statistics"]),
            ("render good.zarr -o o.png --stats good.zarr/../o.png", USAGE, &["o.png", "hold the statistics"]),
            ("render good.zarr -o o.png --max-wait 0", USAGE, &["positive"]),
            ("render good.zarr -o no/such/o.png", USAGE, &["no/such/o.png", "no folder no/such"]),
            ("render good.zarr -o o.png --frobnicate", USAGE, &["--frobnicate"]),
            ("synth ct o.zarr --shape 20,20", USAGE, &["X,Y,Z"]),
            ("synth ct o.zarr --shape 20,20,20 --dtype i32", USAGE, &["i32", "u8"]),
            ("synth ct o.zarr --shape 20,20,20 --steps 0", USAGE, &["steps"]),
            ("synth ct o.tiff --shape 20,20,20", USAGE, &["o.tiff", ".raw", ".zarr"]),
            ("synth potato o.zarr --shape 20,20,20", USAGE, &["potato", "turbulence"]),
            ("frobnicate", USAGE, &["frobnicate"]),
        ],
    );
}

/// Numbers that allow no right picture are refused, from any source and for any renderer.
#[test]
fn numbers_beyond_all_bounds() {
    let sandbox = with_good_store();
    let far = r#"{"eye": [2e9, 0, 0], "target": [20, 20, 20], "up": [0, 0, 1], "projection": {"perspective": {"fov_y_deg": 30}}}"#;
    sandbox.write("far.json", format!(r#"{{"camera": {far}}}"#));
    sandbox.write("wide.json", r#"{"stereo": {"layout": "anaglyph", "eye_separation": 1e30}}"#);
    sandbox.write("deep.json", r#"{"stereo": {"layout": "anaglyph", "convergence": 1e30}}"#);
    sandbox.write("path.json", format!("[{far}]"));
    sandbox.write("step.json", r#"{"step": 1e-30}"#);
    sandbox.write("far.txt", "1 0 0 1e30  0 1 0 0  0 0 1 0");
    sandbox.write("large.txt", "1e30 0 0 0  0 1e30 0 0  0 0 1e30 0");
    let eye: &[&str] = &["eye is 2e9 voxels away", "at most 100000", "nearer"];
    let step: &[&str] = &["1e-30", "expected 0.005 to 16 voxels", "1 takes a sample"];
    let refused = [
        ("--step 1e-30", step),
        ("--step 1e30", &["'1e30'", "0.005 to 16"]),
        ("--scene step.json", step),
        ("--scene far.json", eye),
        ("--path path.json", eye),
        ("--eye 2e9,0,0", eye),
        ("--eye 2e9,0,0 --ortho 40", eye),
        ("--fov 1e-6", &["field of view of 1e-6", "from 0.001 to less than 180"]),
        ("--ortho 1e-9", &["1e-9 voxels high", "at least 0.001"]),
        ("--scene wide.json", &["voxels away"]),
        ("--scene deep.json", &["voxels away"]),
        ("--volume 0:matrix=far.txt", &["layer 0", "1e30 of its voxels away"]),
        ("--volume 0:matrix=large.txt", &["layer 0", "a voxel is 1e30 world units large"]),
    ];
    for way in ["--backend cpu", "--backend gpu", "--backend gpu --exact", "--compositor reference"] {
        let lines: Vec<String> =
            refused.iter().map(|(flags, _)| format!("render good.zarr -o o.png {way} {flags}")).collect();
        let cases: Vec<_> = lines.iter().zip(&refused).map(|(line, (_, words))| (&line[..], USAGE, *words)).collect();
        check(&sandbox, &cases);
    }
    check(&sandbox, &[("view good.zarr --eye 2e9,0,0", USAGE, eye), ("view good.zarr --scene step.json", USAGE, step)]);
}

/// A picture past its time limit is abandoned by every renderer, without leftovers.
#[test]
fn what_takes_too_long_to_draw() {
    let sandbox = with_good_store();
    let slow = "--step 0.005 --aa 16 --transfer gray --max-wait 0.3 --size 1024x1024";
    let ways = [
        "good.zarr --backend cpu",
        "good.zarr --backend cpu --mode mip",
        "good.zarr good.zarr --backend cpu",
        "good.zarr --backend cpu --exact",
        "good.zarr --backend gpu",
        "good.zarr --backend gpu --compositor compute",
        "good.zarr --backend gpu --compositor sorted",
        "good.zarr --backend gpu --compositor raycast --exact",
        "good.zarr --backend gpu --exact",
        "good.zarr good.zarr --backend gpu",
        "good.zarr --compositor reference",
    ];
    let outputs = ["-o o.png", "--orbit 3 --movie o.gif"];
    let lines = ways.iter().enumerate().map(|(i, way)| format!("render {way} {slow} {}", outputs[i % 2]));
    let lines: Vec<String> = lines.collect();
    let words: &[&str] = &["the picture is not", " s", "--max-wait"];
    check(&sandbox, &lines.iter().map(|line| (&line[..], 1, words)).collect::<Vec<_>>());
}

/// llvmpipe ends rays after a number of loop rounds: a warning reports rays in need of more. The CPU has no such
/// limit.
#[test]
fn rays_that_a_software_gpu_may_leave_unfinished_are_told() {
    let sandbox = Sandbox::in_memory();
    sandbox.run_ok("synth turbulence long.zarr --shape 512,8,8 --dtype f32 --progress none");
    let sobel = "--lighting phong --gradient sobel";
    for (flags, is_told) in [
        ("--backend gpu --mode average --step 0.1", false),
        ("--backend gpu --mode average --step 0.005", true),
        ("--backend cpu --mode average --step 0.005", false),
        (&format!("--backend gpu {sobel} --step 1"), false),
        (&format!("--backend gpu {sobel} --step 0.1"), true),
    ] {
        let line = format!("render long.zarr -o o.png --overwrite --size 16x16 --level 0 --view=+x --aa 1 {flags}");
        let (code, stdout, stderr) = sandbox.run(&line);
        assert_eq!(code, 0, "{flags}: {stderr}");
        let is_llvmpipe = (stdout + &stderr).contains("llvmpipe (");
        let has_told = stderr.contains("warning: llvmpipe ends rays after 65,535 rounds");
        assert_eq!(has_told, is_told && is_llvmpipe, "{flags}: {stderr}");
    }
}

#[test]
fn bad_scenes_and_transfer_functions() {
    let sandbox = with_good_store();
    let transfer = |color: &str, opacity: &str| format!(r#"{{"color": {color}, "opacity": {opacity}}}"#);
    let by_gradient = |list: &str| format!(r#"{{"color": [[0, 1, 1, 1]], "opacity": [[0, 1]], {list}}}"#);
    let region = |shape: &str, value: &str| {
        let look = r#""gradient": [0, 5], "color": [1, 0, 0], "opacity": 0.5"#;
        format!(r#""regions": [{{"shape": "{shape}", "value": {value}, {look}}}]"#)
    };
    let camera = |up: &str, time: &str| {
        let projection = r#""projection": {"perspective": {"fov_y_deg": 30}}"#;
        format!(r#"{{"eye": [0, -90, 0], "target": [0, 0, 0], "up": [{up}], {projection}{time}}}"#)
    };
    for (name, text) in [
        ("text.json", "not JSON".to_string()),
        ("empty.json", transfer("[]", "[[0, 1]]")),
        ("order.json", transfer("[[5, 0, 0, 0], [4, 1, 1, 1]]", "[[0, 1]]")),
        ("range.json", transfer("[[0, 0, 0, 0]]", "[[0, 1.5]]")),
        ("short.json", transfer("[[0, 0, 0]]", "[[0, 1]]")),
        ("nan.json", transfer("[[0, 0, 0, 0]]", "[[0, 0],\n[NaN, 1]]")),
        (
            "maps.json",
            r#"[{"Name": "Cold", "RGBPoints": [0,0,0,0]}, {"Name": "Odd", "RGBPoints": [0,0,0]}]"#.to_string(),
        ),
        ("map.json", r#"{"Name": "Hot", "RGBPoints": [0, 0, 0, 0, 1, 2, 0, 0]}"#.to_string()),
        ("property.json", r#"{"volumeProperties": [{"components": []}]}"#.to_string()),
        ("property.vp", "1\n1\n0.9\n0.1\n0.2\n10\n4 0 0 255 1\n4 0 1 255 1\n7 0 0 0 0 9 1 1\n".to_string()),
        ("unit.json", r#"{"color": [[0,0,0,0]], "opacity": [[0,1]], "unit_distance": 0}"#.to_string()),
        ("field.json", r#"{"stpe": 2}"#.to_string()),
        ("scene.json", r#"{"time": 7}"#.to_string()),
        ("surface.json", r#"{"layers": [{"isosurfaces": [{"value": 7}]}], "mode": "mip"}"#.to_string()),
        ("slice.json", r#"{"mode": "mip", "slice": {"point": [0, 0, 0], "normal": [0, 0, 0]}}"#.to_string()),
        (
            "slab.json",
            r#"{"mode": "mip", "slice": {"point": [0, 0, 0], "normal": [0, 0, 1], "thickness": -1}}"#.to_string(),
        ),
        ("mode.json", r#"{"slice": {"point": [0, 0, 0], "normal": [0, 0, 1]}}"#.to_string()),
        ("plane.json", r#"{"clip_planes": [{"point": [0, 0, 0]}]}"#.to_string()),
        ("function.json", r#"{"layers": [{"transfer": {"color": [], "opacity": []}}]}"#.to_string()),
        ("flat.json", by_gradient(r#""gradient_opacity": []"#)),
        ("steep.json", by_gradient(r#""gradient_opacity": [[9, 0], [5, 1]]"#)),
        ("negative.json", by_gradient(r#""gradient_opacity": [[-9, 0], [5, 1]]"#)),
        ("infinite.json", by_gradient(r#""gradient_opacity": [[0, 0], [Infinity, 1]]"#)),
        ("huge.json", by_gradient(r#""gradient_opacity": [[0, 0], [1e999, 1]]"#)),
        ("factor.json", by_gradient(r#""gradient_opacity": [[0, 0], [5, 1.5]]"#)),
        ("shape.json", by_gradient(&region("circle", "[1, 2]"))),
        ("back.json", by_gradient(&region("rectangle", "[2, 1]"))),
        ("by-gradient.json", by_gradient(&region("rectangle", "[1, 2]"))),
        ("cameras.json", r#"[{"eye": [0, 0, 0]}]"#.to_string()),
        ("none.json", "[]".to_string()),
        ("late.json", format!("[{}, {}]", camera("0, 0, 1", ""), camera("0, 0, 1", r#", "time": 2"#))),
        ("timed.json", format!("[{}, {}]", camera("0, 0, 1", ""), camera("0, 0, 1", r#", "time": 1"#))),
        ("half.json", format!("[{}]", camera("0, 0, 1", r#", "time": 0.5"#))),
        ("up.json", format!("[{}, {}]", camera("0, 0, 1", ""), camera("0, 9, 0", ""))),
        (
            "flat.path.json",
            format!(
                "[{}, {}]",
                camera("0, 0, 1", ""),
                camera("0, 0, 1", "").replace("perspective", "orthographic").replace("fov_y_deg", "height")
            ),
        ),
    ] {
        sandbox.write(name, text);
    }
    sandbox.write("binary.json", [0xff, 0xfe, 0x00, 0x80]);
    sandbox.write("no-layers.json", r#"{"layers": []}"#);
    let render = |flags: &str| format!("render good.zarr -o o.png {flags}");
    check(
        &sandbox,
        &[
            (&render("--transfer text.json"), BAD_INPUT, &["text.json", "not a transfer function"]),
            (&render("--transfer binary.json"), BAD_INPUT, &["binary.json"]),
            (&render("--transfer empty.json"), BAD_INPUT, &["empty.json", "'color' has no points"]),
            (&render("--transfer order.json"), BAD_INPUT, &["order.json", "'color' point 1", "sort"]),
            (&render("--transfer range.json"), BAD_INPUT, &["range.json", "'opacity' point 0", "0..1"]),
            (&render("--transfer short.json"), BAD_INPUT, &["short.json", "length 4"]),
            (&render("--transfer nan.json"), BAD_INPUT, &["nan.json: line 2, column 2: found NaN, expected a finite"]),
            (&render("--transfer maps.json#Odd"), BAD_INPUT, &["maps.json: ", "'Odd'", "3 numbers", "multiple of 4"]),
            (&render("--transfer maps.json#cold"), BAD_INPUT, &["maps.json: ", "did you mean 'Cold'?", "Cold, Odd"]),
            (&render("--transfer order.json#Hot"), BAD_INPUT, &["order.json: ", "'Hot'", "no names"]),
            (&render("--transfer map.json"), BAD_INPUT, &["map.json: 'RGBPoints' point 1", "2.0", "0..1"]),
            (
                &render("--transfer property.json"),
                BAD_INPUT,
                &["property.json: ", "3D Slicer", "'components' is empty"],
            ),
            (&render("--transfer property.vp"), BAD_INPUT, &["property.vp: ", "colours (line 9)", "7 numbers", "of 4"]),
            (&render("--transfer unit.json"), BAD_INPUT, &["unit.json", "unit_distance", "positive"]),
            (&render("--transfer flat.json"), BAD_INPUT, &["flat.json", "'gradient_opacity' has no points"]),
            (&render("--transfer steep.json"), BAD_INPUT, &["steep.json", "'gradient_opacity' point 1", "sort"]),
            (&render("--transfer negative.json"), BAD_INPUT, &["negative.json", "magnitude -9 is negative"]),
            (&render("--transfer infinite.json"), BAD_INPUT, &["infinite.json", "found Infinity", "finite"]),
            (&render("--transfer huge.json"), BAD_INPUT, &["huge.json", "out of range"]),
            (&render("--transfer factor.json"), BAD_INPUT, &["factor.json", "'gradient_opacity' point 1", "0..1"]),
            (&render("--transfer shape.json"), BAD_INPUT, &["shape.json", "circle", "rectangle", "triangle"]),
            (&render("--transfer back.json"), BAD_INPUT, &["back.json", "'regions' point 0", "'value' ends at 1"]),
            (&render("--gradient-opacity 9:0,5:1"), USAGE, &["--gradient-opacity", "9:0,5:1", "sort"]),
            (&render("--gradient-opacity=-9:0"), USAGE, &["-9", "negative"]),
            (&render("--gradient-opacity nan:0"), USAGE, &["nan:0", "finite"]),
            (&render("--gradient-opacity 5"), USAGE, &["'5'", "MAGNITUDE:FACTOR"]),
            (&render("--gradient-opacity 5:1 --method plvs"), USAGE, &["Plvs", "method udvr, lvs, cvs or asm"]),
            (&render("--transfer by-gradient.json --method pdvr"), USAGE, &["Pdvr", "value and gradient", "asm"]),
            (&render("good.zarr --expr a --gradient-opacity 5:1"), USAGE, &["--gradient-opacity", "expression"]),
            (&render("good.zarr --expr a --transfer by-gradient.json"), USAGE, &["value and gradient", "expression"]),
            (&render("good.zarr --expr a --mode mip"), USAGE, &["expression", "mode dvr", "Mip"]),
            (&render("--scene missing.json"), BAD_INPUT, &["missing.json", "No such file"]),
            (&render("--scene text.json"), BAD_INPUT, &["text.json", "not a scene"]),
            (&render("--scene field.json"), BAD_INPUT, &["field.json", "stpe"]),
            (&render("--scene scene.json"), USAGE, &["time step 7"]),
            (&render("--mode isosurface"), USAGE, &["--isovalue", "the values of good are from 0"]),
            (&render("--mode mip --isovalue 7"), USAGE, &["isovalue 7", "mode isosurface"]),
            (&render("--mode isosurface --isovalue nan"), USAGE, &["isovalue", "finite"]),
            (&render("--mode isosurface --isovalue bone"), USAGE, &["--isovalue", "bone"]),
            (&render("--scene surface.json"), USAGE, &["layer 0: the isovalue 7", "mode isosurface"]),
            (&render("--isovalue 7,opacity=2"), USAGE, &["at 7", "opacity of 2", "0 to 1"]),
            (&render("--isovalue 7,colour=1:0:0"), USAGE, &["colour=1:0:0", "color=R:G:B"]),
            (&render("--isovalue 7,color=1:0"), USAGE, &["1,0", "R,G,B"]),
            (&render("--isovalue 7 --isovalue 7,opacity=0.5"), USAGE, &["two isosurfaces", "7"]),
            (&render(&"--isovalue 7 ".repeat(9)), USAGE, &["9 isosurfaces", "at most 8"]),
            (&render("--clip-plane 0,0,0:0,0,0"), USAGE, &["--clip-plane", "0,0,0:0,0,0", "normal that is not zero"]),
            (&render("--clip-plane 0,0,0:1,nan,0"), USAGE, &["0,0,0:1,nan,0", "finite"]),
            (&render("--clip-plane 0,0,0"), USAGE, &["X,Y,Z:NX,NY,NZ"]),
            (&render(&"--clip-plane 1,2,3:1,0,0 ".repeat(7)), USAGE, &["7 clip planes", "at most 6"]),
            (&render("--slice w=3"), USAGE, &["w=3", "x, y, z, i, j, k"]),
            (&render("--slice axail=3"), USAGE, &["did you mean 'axial'?"]),
            (&render("--slice axial=3"), USAGE, &["--slice axial", "lies in a patient", "z=50% or k=INDEX"]),
            (&render("--scene no-layers.json --slice k=3"), USAGE, &["--slice", "voxels of the first layer"]),
            (&render("--slice k=900"), USAGE, &["--slice k=900", "expected 0 to "]),
            (&render("--view lefft"), USAGE, &["no view 'lefft', did you mean 'left'?"]),
            (&render("--view anterior"), USAGE, &["--view anterior", "lies in a patient", "+x, -y"]),
            (&render("--slice 3"), USAGE, &["'3'", "z=VALUE"]),
            (&render("--slice z=3 --mode dvr"), USAGE, &["mode dvr", "average, mip or minip"]),
            (&render("--slice z=3 --thickness 0"), USAGE, &["--thickness", "positive"]),
            (&render("--thickness 3"), USAGE, &["--thickness", "--slice"]),
            (&render("--scene slice.json"), USAGE, &["normal [0, 0, 0]", "not zero"]),
            (&render("--scene slab.json"), USAGE, &["thickness is -1"]),
            (&render("--scene mode.json"), USAGE, &["mode dvr", "average"]),
            (&render("--scene plane.json"), BAD_INPUT, &["plane.json", "normal"]),
            (&render("--scene function.json"), USAGE, &["transfer function", "'color' has no points"]),
            (&render("--path cameras.json"), BAD_INPUT, &["cameras.json", "target"]),
            (&render("--path none.json"), BAD_INPUT, &["none.json", "empty"]),
            (&render("--path missing.json"), BAD_INPUT, &["missing.json", "No such file"]),
            (&render("--path late.json"), USAGE, &["late.json: camera 1 has time 2", "2 time steps"]),
            (&render("--path half.json"), BAD_INPUT, &["half.json", "0.5", "u32"]),
            (&render("--path timed.json --time all"), USAGE, &["--time all", "timed.json", "camera 1 has time 1"]),
            (&render("--path up.json"), USAGE, &["up.json: camera 1 cannot be used", "up vector"]),
            (&render("--path flat.path.json --frames 9"), USAGE, &["camera 0 cannot be interpolated", "orthographic"]),
            (&render("--path timed.json --frames 0"), USAGE, &["--frames 0", "1000000"]),
        ],
    );
}

#[test]
fn meshes_that_cannot_be_shown() {
    let sandbox = with_good_store();
    let corners = |z: &str| format!("v 0 0 {z}\nv 9 0 0\nv 0 9 0\n");
    sandbox.write("good.obj", corners("0") + "f 1 2 3\n");
    sandbox.write("index.obj", corners("0") + "f 1 2 4\n");
    sandbox.write("nan.obj", corners("nan") + "f 1 2 3\n");
    sandbox.write("points.obj", corners("0"));
    sandbox.write("empty.stl", []);
    sandbox.write("cut.stl", [vec![0; 80], vec![9, 0, 0, 0], vec![0; 120]].concat());
    let ply = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 ";
    sandbox.write("index.ply", format!("{ply}7\n"));
    sandbox.write("cut.ply", &ply[..ply.len() - "0 1 0\n3 0 1 ".len()]);
    sandbox.write("no.gltf", "{}");
    sandbox.write("cut.glb", b"glTF\x02\0\0\0");
    sandbox.write("mesh.vtk", "# vtk DataFile");
    sandbox.write("scene.json", r#"{"meshes": [{"path": "there/a.stl"}]}"#);
    sandbox.write("looks.json", r#"{"meshes": [{"path": "good.obj", "opacity": 1.5}]}"#);
    sandbox.write("words.json", r#"{"meshes": [{"path": "good.obj", "colour": [1, 0, 0]}]}"#);
    let render = |flags: &str| format!("render good.zarr -o o.png --size 8x8 --backend cpu {flags}");
    let mesh = |file: &str| render(&format!("--mesh {file}"));
    check(
        &sandbox,
        &[
            (&mesh("index.obj"), BAD_INPUT, &["index.obj", "out of bounds"]),
            (&mesh("nan.obj"), BAD_INPUT, &["nan.obj", "position of vertex 0", "NaN", "finite"]),
            (&mesh("points.obj"), BAD_INPUT, &["points.obj", "no triangle", "at least one"]),
            (&mesh("empty.stl"), BAD_INPUT, &["empty.stl", "0 bytes", "84"]),
            (&mesh("cut.stl"), BAD_INPUT, &["cut.stl", "9 triangles", "534 bytes", "204", "cut short"]),
            (&mesh("index.ply"), BAD_INPUT, &["index.ply", "triangle 0 names vertex 7", "3, numbered from 0"]),
            (&mesh("cut.ply"), BAD_INPUT, &["cut.ply", "end of file"]),
            (&mesh("no.gltf"), BAD_INPUT, &["no.gltf", "expected a glTF file"]),
            (&mesh("cut.glb"), BAD_INPUT, &["cut.glb", "expected a glTF file"]),
            (&mesh("mesh.vtk"), BAD_INPUT, &["mesh.vtk", "'.vtk'", ".stl, .ply, .obj, .gltf or .glb"]),
            (&mesh("missing.stl"), BAD_INPUT, &["missing.stl", "No such file"]),
            (&render("--scene scene.json"), BAD_INPUT, &["there/a.stl", "No such file"]),
            (&render("--scene looks.json"), USAGE, &["good.obj", "opacity is 1.5", "0 to 1"]),
            (&render("--scene words.json"), BAD_INPUT, &["words.json", "colour", "opacity"]),
            (&mesh("good.obj,opacity=1.5"), USAGE, &["opacity=1.5", "0..1"]),
            (&mesh("good.obj,color=1:2:3"), USAGE, &["color=1:2:3", "R:G:B"]),
            (&mesh("good.obj,opacity=0.5 --mode mip"), USAGE, &["good.obj", "opacity 0.5", "dvr or isosurface"]),
            (&mesh("good.obj,opacity=0.5 --slice z=5"), USAGE, &["good.obj", "projection"]),
        ],
    );
    for flags in ["", ",opacity=0.5", ",color=1:0:0,unlit --mode mip", ",opacity=0 --mode minip"] {
        sandbox.run_ok(&format!("{} --overwrite", mesh(&format!("good.obj{flags}"))));
    }
}

#[test]
fn what_is_not_finite_is_packed_counted_and_left_out() {
    let sandbox = Sandbox::default();
    let special = |i: u32| match i % 50 {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 | 3 => f32::NEG_INFINITY,
        _ => (i % 7) as f32 - 3.0,
    };
    let voxels: Vec<u8> = (0..20 * 30 * 40).flat_map(|i| special(i).to_le_bytes()).collect();
    sandbox.write("a.raw", &voxels);
    let line = "a.raw --shape 20,30,40 --dtype f32 --brick 16 --progress none";
    let (code, _, said) = sandbox.run(&format!("pack {line} o.zarr"));
    assert!(code == 0 && said.contains("1920 voxels without a number"), "exit {code}: {said}");
    sandbox.run_ok(&format!("append s.zarr {line}"));
    let (code, _, said) = sandbox.run("append s.zarr a.raw --shape 20,30,40 --dtype f32 --progress none");
    assert!(code == 0 && said.contains("1920 voxels without a number"), "exit {code}: {said}");
    sandbox.run_ok("verify o.zarr --progress none");
    let info = sandbox.json("info o.zarr --json");
    let channel = &info["store"]["channels"][0];
    for (name, count) in [("nan", 480), ("pos_inf", 480), ("neg_inf", 960), ("count", 24_000 - 1920)] {
        assert_eq!(channel[name], count, "{name}");
    }
    assert_eq!(channel["range"], serde_json::json!([-3.0, 3.0]));
    assert!(sandbox.run_ok("info o.zarr").contains("1920 not finite"));
    sandbox.run_ok("export o.zarr b.raw");
    assert!(sandbox.read("b.raw") == voxels, "every bit of every NaN is kept");
    sandbox.run_ok("render o.zarr -o o.png --size 64x48 --backend cpu");
    // A volume of only NaN is valid, too.
    sandbox.write("nan.raw", f32::NAN.to_le_bytes().repeat(1000));
    sandbox.run_ok("pack nan.raw nan.zarr --shape 10,10,10 --dtype f32 --progress none");
    sandbox.run_ok("render nan.zarr -o nan.png --size 64x48 --backend cpu --background 0,1,0");
    assert!(read_png(&sandbox.path("nan.png")).rgb.iter().all(|p| *p == [0, 255, 0]), "NaN is transparent");
}

#[test]
fn any_name_will_do() {
    let sandbox = Sandbox::default();
    let name = |end: &str| format!("ein Gerät, größer – 体积 '1'{end}");
    sandbox.write(name(".raw"), vec![9; 1000]);
    let run = |arguments: &[&str]| {
        let output = sandbox.command().args(arguments).output().expect("the command starts");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    };
    let store = name(".zarr");
    run(&["pack", &name(".raw"), &store, "--shape", "10,10,10", "--dtype", "u8"]);
    run(&["info", &store]);
    run(&["verify", &store]);
    run(&["export", &store, &name(".npy")]);
    run(&["render", &store, "-o", &name(".png"), "--stats", &name(".json"), "--size", "20x20", "--backend", "cpu"]);
    assert!(sandbox.read(name(".npy")).ends_with(&[9; 1000]));
    let output = sandbox.command().args(["export", &store, &name(".xyz")]).output().expect("the command starts");
    assert!(String::from_utf8_lossy(&output.stderr).contains(&name(".xyz")), "names are printed as they are");
}

/// The command without root's unlimited rights; `None` (with a message) if unavailable.
fn unprivileged(sandbox: &Sandbox) -> Option<impl Fn(&str) -> (i32, String) + '_> {
    use std::os::unix::fs::{MetadataExt, PermissionsExt};
    let readable = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(sandbox.path(""), readable).expect("our own folder");
    let is_root = std::fs::metadata(sandbox.path("")).expect("our own folder").uid() == 0;
    // The command may be in a folder only root can read.
    let program = sandbox.path("brickyard");
    std::fs::copy(sandbox.command().get_program(), &program).expect("the sandbox is writable");
    let run = move |line: &str| {
        let mut command = match is_root {
            true => Command::new("setpriv"),
            false => Command::new(&program),
        };
        if is_root {
            command.args(["--reuid=65534", "--regid=65534", "--clear-groups", "--"]).arg(&program);
        }
        let output = command.args(line.split(' ')).current_dir(sandbox.path("")).output();
        let output = output.unwrap_or_else(|error| panic!("setpriv (of util-linux): {error}"));
        (output.status.code().unwrap_or(-1), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    if run("--version").0 != 0 {
        leave_out("permissions", run("--version").1);
        return None;
    }
    Some(run)
}

fn chmod(path: &Path, mode: u32) {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("our own file");
}

#[test]
fn missing_permissions() {
    let sandbox = with_good_store();
    sandbox.write("secret.raw", vec![1; 1000]);
    sandbox.write("open.raw", vec![1; 1000]);
    sandbox.copy("good.zarr", "secret.zarr");
    sandbox.copy("good.zarr", "shard.zarr");
    sandbox.copy("good.zarr", "document.zarr");
    std::fs::create_dir(sandbox.path("locked")).expect("the sandbox is writable");
    let Some(run) = unprivileged(&sandbox) else { return };
    chmod(&sandbox.path("secret.raw"), 0);
    chmod(&sandbox.path("secret.zarr/zarr.json"), 0);
    chmod(&sandbox.path("shard.zarr/0/c/0/0/0/0"), 0);
    chmod(&sandbox.path("document.zarr/0/zarr.json"), 0);
    chmod(&sandbox.path("locked"), 0o555);
    for (line, code, path) in [
        // An unreadable file has no fault of its own.
        ("pack secret.raw locked/o.zarr --shape 10,10,10 --dtype u8", 1, "secret.raw"),
        ("pack open.raw locked/o.zarr --shape 10,10,10 --dtype u8", 1, "locked/o.zarr"),
        ("synth ct locked/o.zarr --shape 10,10,10", 1, "locked/o.zarr"),
        ("synth ct locked/o.raw --shape 10,10,10", 1, "locked"),
        ("export good.zarr locked/o.raw", 1, "locked/o.raw"),
        ("render good.zarr -o locked/o.png --size 8x8 --backend cpu", 1, "locked/o.png"),
        ("info secret.zarr", 1, "secret.zarr/zarr.json"),
        ("verify secret.zarr", 1, "secret.zarr/zarr.json"),
        ("export shard.zarr locked/o.raw", 1, "locked/o.raw"),
        ("verify shard.zarr", 1, "shard.zarr/0/c/0/0/0/0"),
        ("verify document.zarr", 1, "document.zarr/0/zarr.json"),
    ] {
        let (found, stderr) = run(line);
        assert!(found == code && stderr.contains(path), "brickyard {line}: exit {found}: {stderr}");
        assert!(stderr.contains("ermission denied"), "brickyard {line}: {stderr}");
    }
    assert_eq!(std::fs::read_dir(sandbox.path("locked")).expect("our own folder").count(), 0, "nothing was left");
    chmod(&sandbox.path("locked"), 0o755);
}

/// A caller still gets the exit code after closing standard error.
#[test]
fn an_error_that_nobody_hears_keeps_its_exit_code() {
    let sandbox = Sandbox::default();
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let status = sandbox.command().args(["info", "nothing.zarr"]).stderr(writer).status().expect("the command starts");
    assert_eq!(status.code(), Some(BAD_INPUT));
}
