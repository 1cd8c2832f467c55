//! Packs killed, out of disk, or resumed with other input: a finished store is always the same.

use brickyard_tests::sample::seed;
use brickyard_tests::{Random, Sandbox, command, leave_out, tree, tree_difference};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Two pyramids of many small shards, and then the aprons: 256 at level 0, 332 in all, and as many of aprons, one after another
/// for some 0.4 s.
const PACK: &str = "pack in.raw out.zarr --shape 256,256,128 --dtype u8 --brick 16 --shard 32 --downsample mean,max \
                    --aprons 1 --progress none -j 2";

/// The file beside the store in a sandbox after a pack.
const INPUT: &str = "in.raw";

/// 8 MiB that compress to about half: waves, with noise in the low bits.
///
/// In memory: a process's leftovers do not depend on the disk, but waiting for one would take most of the time.
fn sandbox_with_input() -> Sandbox {
    let sandbox = Sandbox::in_memory();
    let mut random = Random(7);
    let mut bytes = vec![0u8; 256 * 256 * 128];
    for (i, eight) in bytes.chunks_exact_mut(8).enumerate() {
        let (x, y, z) = (i % 32, i / 32 % 256, i / (32 * 256));
        let wave = (x * 8 + y + z) as u8 & 0xf0;
        eight.copy_from_slice(&(random.bits() & 0x0707_0707_0707_0707).to_le_bytes());
        eight.iter_mut().for_each(|b| *b += wave);
    }
    sandbox.write(INPUT, bytes);
    sandbox
}

fn finished_shards(journal: &Path) -> usize {
    std::fs::read_to_string(journal).map_or(0, |text| text.lines().count().saturating_sub(1))
}

/// Packs anew and kills the process after `shards` finished shards; tries again if it ended before the kill.
fn interrupt(sandbox: &Sandbox, shards: usize) {
    assert!((0..9).any(|_| killed_after(sandbox, shards, Duration::ZERO)), "it finishes before it can be killed");
}

fn remove_store(sandbox: &Sandbox) {
    let store = sandbox.path("out.zarr");
    if store.exists() {
        std::fs::remove_dir_all(store).expect("the sandbox is writable");
    }
}

/// The names in the sandbox outside the store.
fn beside_the_store(sandbox: &Sandbox) -> Vec<String> {
    let entries = std::fs::read_dir(sandbox.path("")).expect("the sandbox can be listed");
    let mut names: Vec<_> = entries.map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Packs anew and kills the process `delay` after `shards` finished shards; `false` if it had ended by then.
fn killed_after(sandbox: &Sandbox, shards: usize, delay: Duration) -> bool {
    remove_store(sandbox);
    let mut child = sandbox.command().args(PACK.split(' ')).stderr(Stdio::null()).spawn().expect("the command starts");
    let journal = sandbox.path("out.zarr/.brickyard-journal");
    while finished_shards(&journal) < shards && child.try_wait().expect("a child").is_none() {
        std::thread::sleep(Duration::from_micros(200));
    }
    std::thread::sleep(delay);
    child.kill().expect("a child");
    !child.wait().expect("a child").success()
}

/// Moments depend on finished shards, not on a clock: load on the machine stretches the time between any two.
#[test]
fn killed_at_any_moment_and_resumed_the_store_is_the_uninterrupted_one() {
    let sandbox = sandbox_with_input();
    let whole_pack = || {
        remove_store(&sandbox);
        sandbox.run_ok(PACK);
        tree(&sandbox.path("out.zarr"))
    };
    let expected = whole_pack();
    let shards = expected.keys().filter(|path| path.to_string_lossy().contains("/c/")).count();
    assert!(shards >= 200, "a pack with many shards");
    assert_eq!(tree_difference(&whole_pack(), &expected), [""; 0], "packing twice");

    let mut random = Random(seed());
    let (mut midway, mut furthest) = (0, 0);
    // One moment in each part of the pack, at a random place.
    const MOMENTS: u32 = 20;
    for moment in 0..MOMENTS {
        let mut after = ((f64::from(moment) + random.unit()) / f64::from(MOMENTS) * shards as f64) as usize;
        while !killed_after(&sandbox, after, Duration::from_micros(random.bits() % 1500)) {
            after -= after.div_ceil(50);
        }
        let finished = finished_shards(&sandbox.path("out.zarr/.brickyard-journal"));
        furthest = furthest.max(finished);
        if sandbox.path("out.zarr/.brickyard-journal").exists() && !sandbox.path("out.zarr/zarr.json").exists() {
            midway += (finished > 0) as u32;
            let (code, _, stderr) = sandbox.run("info out.zarr");
            let says = stderr.contains("incomplete") && stderr.contains('%') && stderr.contains("--resume");
            assert!(code == 4 && says, "moment {moment}: exit {code}: {stderr}");
        }
        let (code, _, stderr) = sandbox.run(&format!("{PACK} --resume"));
        assert_eq!(code, 0, "moment {moment}, {finished} shards finished: {stderr}");
        let difference = tree_difference(&tree(&sandbox.path("out.zarr")), &expected);
        assert_eq!(difference, [""; 0], "moment {moment}, {finished} shards finished");
        assert_eq!(beside_the_store(&sandbox), [INPUT, "out.zarr"], "moment {moment}");
    }
    assert!(midway >= MOMENTS * 4 / 5, "only {midway} of {MOMENTS} packs were killed with some shards finished");
    assert!(furthest >= shards * 3 / 4, "no pack was killed after more than {furthest} of {shards} shards");
}

#[test]
fn a_pack_resumes_only_what_it_was() {
    let sandbox = sandbox_with_input();
    interrupt(&sandbox, 3);
    // A killed pack's lock file goes with the next holder of the lock.
    let packed = || {
        let mut files = tree(&sandbox.path("out.zarr"));
        files.remove(Path::new(".brickyard-lock"));
        files
    };
    let unfinished = packed();
    let refused = |arguments: &str, code: i32, says: &[&str]| {
        let (found, _, stderr) = sandbox.run(arguments);
        assert_eq!(found, code, "brickyard {arguments}: {stderr}");
        for word in says {
            assert!(stderr.contains(word), "brickyard {arguments}: {word:?} is not in: {stderr}");
        }
        assert_eq!(tree_difference(&packed(), &unfinished), [""; 0], "brickyard {arguments}");
    };
    refused(PACK, 2, &["out.zarr", "exists", "--resume", "--overwrite"]);
    refused(&PACK.replace("--brick 16", "--brick 8 --resume"), 2, &["out.zarr", "brick was 16, now 8", "--overwrite"]);
    refused(&PACK.replace("--shard 32", "--shard 64 --resume"), 2, &["shard was 32, now 64"]);
    refused(&format!("{PACK} --codec zstd:3 --resume"), 2, &["codec was \"zstd:1\", now \"zstd:3\""]);
    refused(&PACK.replace("--aprons 1", "--aprons 2 --resume"), 2, &["aprons was 1, now 2"]);
    refused(&PACK.replace("mean,max", "max --resume"), 2, &["downsample was \"mean,max\", now \"max\""]);
    refused(&format!("{PACK} --spacing 1,1,2 --resume"), 2, &["geometry was", "spacing"]);
    refused(&PACK.replace("256,256,128", "256,128,256 --resume"), 2, &["extent was [256,256,128], now [256,128,256]"]);
    // Settings without effect on the result may change: threads and memory.
    let bytes = sandbox.read(INPUT);
    std::thread::sleep(Duration::from_millis(20)); // The file system's clock may tick in 10 ms.
    sandbox.write(INPUT, bytes);
    refused(&format!("{PACK} --resume"), 2, &["source was", "in.raw"]);
    sandbox.run_ok(&format!("{PACK} --overwrite"));
    sandbox.run_ok("verify out.zarr --progress none");
}

/// Of packs started together, each with its own settings, one wins; the others name it.
#[test]
fn of_packs_that_start_together_one_wins() {
    let sandbox = sandbox_with_input();
    for round in 0..3u64 {
        remove_store(&sandbox);
        let start = |i: u64| {
            std::thread::sleep(Duration::from_millis(i * round * 7));
            let pack = format!("{PACK} --codec zstd:{}", 1 + i % 3);
            let mut command = sandbox.command();
            command
                .args(pack.split(' '))
                .stdout(Stdio::null())
                .stderr(Stdio::piped())
                .spawn()
                .expect("the command starts")
        };
        let children: Vec<_> = (0..10).map(start).collect();
        let pids: Vec<_> = children.iter().map(|child| format!("(process {} on ", child.id())).collect();
        let ended: Vec<_> = children.into_iter().map(|child| child.wait_with_output().expect("a child")).collect();
        let won: Vec<_> = (0..ended.len()).filter(|&i| ended[i].status.success()).collect();
        let said = |i: usize| String::from_utf8_lossy(&ended[i].stderr).into_owned();
        assert_eq!(won.len(), 1, "round {round}: {:#?}", (0..ended.len()).map(said).collect::<Vec<_>>());
        for i in (0..ended.len()).filter(|i| *i != won[0]) {
            let is_told = match ended[i].status.code() {
                Some(1) => said(i).contains(&pids[won[0]]),
                // The winner had ended.
                Some(2) => said(i).contains("exists already"),
                _ => false,
            };
            assert!(is_told, "round {round}: {:?}: {}", ended[i].status, said(i));
        }
        sandbox.run_ok("verify out.zarr --progress none");
        let (_, stdout, _) = sandbox.run("info out.zarr --json");
        assert!(stdout.contains(&format!("zstd:{}", 1 + won[0] % 3)), "round {round}: {stdout}");
        assert_eq!(beside_the_store(&sandbox), [INPUT, "out.zarr"]);
    }
}

#[test]
fn threads_and_memory_may_change_between_runs() {
    let sandbox = sandbox_with_input();
    sandbox.run_ok(PACK);
    let expected = tree(&sandbox.path("out.zarr"));
    remove_store(&sandbox);
    interrupt(&sandbox, 5);
    sandbox.run_ok(&PACK.replace("-j 2", "-j 3 --memory 64MiB --resume"));
    assert_eq!(tree_difference(&tree(&sandbox.path("out.zarr")), &expected), [""; 0]);
}

/// Runs a script in its own mount namespace with the right to mount; `false` (with a message) if that is not allowed.
fn run_where_mounting_is_allowed(sandbox: &Sandbox, script: &str) -> bool {
    sandbox.write("script.sh", format!("mount -t tmpfs none disk || exit 77\numount disk\nset -e\n{script}"));
    std::fs::create_dir(sandbox.path("disk")).expect("the sandbox is writable");
    // As root, else as the root of a user namespace.
    for flags in [["--mount"].as_slice(), &["--user", "--map-root-user", "--mount"]] {
        let mut command = Command::new("unshare");
        command.args(flags).args(["sh", "script.sh"]).current_dir(sandbox.path(""));
        let Ok(output) = command.env("brickyard", sandbox.command().get_program()).output() else { break };
        let stderr = String::from_utf8_lossy(&output.stderr);
        match output.status.code() {
            Some(0) => return true,
            Some(1 | 77) => eprintln!("unshare {flags:?}: {stderr}"),
            code => panic!("the script ended with {code:?}: {stderr}"),
        }
    }
    leave_out("mount", "a full disk cannot be tried");
    false
}

/// A pack on a disk too full because of another file, then again after its removal: `first` and `second` are the two runs'
/// messages and exit codes, `info` the output in between, `out.zarr` the finished store.
const FULL_DISK: &str = r#"
rm -rf out.zarr
mount -t tmpfs -o size=$size none disk
head -c $filler /dev/zero >disk/filler
run() { name=$1; shift; code=0; "$brickyard" "$@" 2>$name || code=$?; echo "exit $code" >>$name; }
run first $pack
run info info disk/out.zarr
rm disk/filler
run second $pack --resume
cp -r disk/out.zarr out.zarr
ls -A disk >left
umount disk
"#;

#[test]
fn a_full_disk_ends_with_exit_4_and_resumes_after_space_is_made() {
    let sandbox = sandbox_with_input();
    sandbox.run_ok(PACK);
    let expected = tree(&sandbox.path("out.zarr"));
    let pages: usize = expected.values().map(|bytes| bytes.len().div_ceil(4096)).sum();
    let pack = PACK.replace("out.zarr", "disk/out.zarr");
    // Before the first shard, midway, and with only the last few files missing.
    for free_pages in [16, pages / 2, pages - 2] {
        let _ = std::fs::remove_dir(sandbox.path("disk"));
        let (size, filler) = (2 * pages * 4096, (2 * pages - free_pages) * 4096);
        let sizes = format!("size={size}\nfiller={filler}\npack='{pack}'\n");
        if !run_where_mounting_is_allowed(&sandbox, &(sizes + FULL_DISK)) {
            return;
        }
        let said = |name: &str| String::from_utf8_lossy(&sandbox.read(name)).into_owned();
        for (name, words) in [
            ("first", ["exit 4", "disk/out.zarr", "No space left", "--resume"].as_slice()),
            ("info", &["exit 4", "incomplete", "%", "--resume"]),
            ("second", &["exit 0"]),
        ] {
            let text = said(name);
            assert!(
                words.iter().all(|w| text.contains(w)),
                "{free_pages} pages free, {name}: expected {words:?} in: {text}"
            );
        }
        assert_eq!(said("left"), "out.zarr\n");
        assert_eq!(tree_difference(&tree(&sandbox.path("out.zarr")), &expected), [""; 0], "{free_pages} pages free");
    }
}

#[test]
fn a_limit_of_file_sizes_ends_with_exit_4_and_resumes_without_it() {
    let sandbox = sandbox_with_input();
    sandbox.run_ok(PACK);
    let expected = tree(&sandbox.path("out.zarr"));
    remove_store(&sandbox);
    let line = format!("ulimit -f 8; exec '{}' {PACK}", command().get_program().to_string_lossy());
    let ended = Command::new("bash").args(["-c", &line]).current_dir(sandbox.path("")).output();
    let ended = ended.expect("bash runs");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(4), "{said}");
    assert!(["File too large", "`ulimit -f`", "--resume"].iter().all(|words| said.contains(words)), "{said}");
    sandbox.run_ok(&format!("{PACK} --resume"));
    assert_eq!(tree_difference(&tree(&sandbox.path("out.zarr")), &expected), [""; 0]);
    // Before anything is packed, and in an appended step.
    remove_store(&sandbox);
    sandbox.write("s.raw", vec![7; 64 * 64 * 64]);
    let raw = "--shape 64,64,64 --dtype u8 --brick 16 --shard 16 --progress none";
    sandbox.run_ok(&format!("append s.zarr s.raw {raw}"));
    sandbox
        .write("s.raw", (0..64 * 64 * 64u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect::<Vec<u8>>());
    for (limit, line) in
        [(0, PACK.to_owned()), (2, "append s.zarr s.raw --shape 64,64,64 --dtype u8 --progress none".into())]
    {
        let line = format!("ulimit -f {limit}; exec '{}' {line}", command().get_program().to_string_lossy());
        let ended = Command::new("bash").args(["-c", &line]).current_dir(sandbox.path("")).output().expect("bash runs");
        let said = String::from_utf8_lossy(&ended.stderr);
        assert!(ended.status.code() == Some(4) && said.contains("`ulimit -f`"), "{line}: {:?}: {said}", ended.status);
    }
}
