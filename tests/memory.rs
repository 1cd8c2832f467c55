//! Budgets from the kernel's view: the anonymous and shared memory of the running command, sampled (`RssAnon` and `RssShmem` in
//! `/proc/PID/status`). Mapped pages of stores and sources belong to the page cache, and can be reclaimed at any time.

use brickyard::store::Store;
use brickyard::volume::Level;
use brickyard_tests::sample::takes_all;
use brickyard_tests::{Random, Sandbox, leave_out, python};
use std::io::Read;
use std::process::{Command, Stdio};
use std::time::Duration;

const MIB: u64 = 1 << 20;

/// Memory of the command outside its budgets: relocated data, a stack and an allocator arena per thread, the picture and the scene.
/// `info` takes 1 MiB in all.
const PROGRAM: u64 = 16 * MIB;

/// Memory of a GPU's driver in this process, outside all budgets: a software one compiles shaders here (LLVM), and keeps its own
/// copies of commands. Measured with llvmpipe: 20 to 40 MiB.
const DRIVER: u64 = 96 * MIB;

/// Runs the command; returns its exit code, standard error and greatest anonymous and shared memory in bytes.
fn measured(sandbox: &Sandbox, line: &str) -> (i32, String, u64) {
    let mut command = sandbox.command();
    command.args(line.split_whitespace());
    measured_program(&mut command)
}

fn measured_program(command: &mut Command) -> (i32, String, u64) {
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().expect("the command starts");
    let mut stderr = child.stderr.take().expect("it is piped");
    let reader = std::thread::spawn(move || {
        let mut text = String::new();
        stderr.read_to_string(&mut text).map(|_| text)
    });
    let mut most = 0;
    let code = loop {
        most = most.max(held_bytes(child.id()).unwrap_or(0));
        if let Some(status) = child.try_wait().expect("a child") {
            break status.code().expect("no signal");
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let stderr = reader.join().expect("no panic").expect("text");
    assert!(most > 0, "it was never seen: {stderr}");
    (code, stderr, most)
}

/// A process's own memory; `None` once it has ended.
fn held_bytes(process: u32) -> Option<u64> {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let kib = |field: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(field))?;
        line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()
    };
    Some((kib("RssAnon:")? + kib("RssShmem:")?) << 10)
}

fn check(sandbox: &Sandbox, line: &str, allowed: u64) {
    let (code, stderr, most) = measured(sandbox, line);
    assert_eq!(code, 0, "{line}: {stderr}");
    eprintln!("{line}: {} of {} MiB", most / MIB, allowed / MIB);
    assert!(most <= allowed, "{line}: {} MiB, and {} MiB are allowed", most / MIB, allowed / MIB);
}

/// 256^3 floats of noise: 64 MiB, which compress little.
fn sandbox() -> Sandbox {
    // On the disk: mapped files in memory count as shared memory.
    let sandbox = Sandbox::within(env!("CARGO_TARGET_TMPDIR"));
    sandbox.run_ok("synth turbulence t.raw --shape 256,256,256 --dtype f32 --progress none");
    sandbox.run_ok("pack t.raw t.zarr --shape 256,256,256 --dtype f32 --brick 32 --shard 128 --progress none");
    sandbox
}

#[test]
fn packing_stays_within_its_memory() {
    let sandbox = sandbox();
    for (i, mib) in [64u64, 96, 256].into_iter().enumerate() {
        // The budget includes the program.
        let line = format!(
            "pack t.raw {i}.zarr --shape 256,256,256 --dtype f32 --brick 32 --shard 128 -j 2 --memory {mib}MiB --progress none"
        );
        check(&sandbox, &line, mib * MIB);
        check(&sandbox, &format!("{} --aprons 1", line.replace(".zarr", "a.zarr")), mib * MIB);
    }
    // The same file as a series, with all shards open until the last step: 37,000 small bricks.
    let series =
        "pack t.raw s.zarr --shape 256,256,16 --times 16 --dtype f32 --brick 8 --shard 64 --shard-time 16 -j 2";
    check(&sandbox, &format!("{series} --memory 48MiB --progress none"), 48 * MIB);
}

#[test]
fn verifying_stays_within_its_memory() {
    let sandbox = sandbox();
    for mib in [40u64, 64, 256] {
        check(&sandbox, &format!("verify t.zarr --memory {mib}MiB --progress none"), mib * MIB);
    }
}

#[test]
fn appending_stays_within_its_memory() {
    let sandbox = Sandbox::within(env!("CARGO_TARGET_TMPDIR"));
    let flags = "--shape 160,160,160 --dtype f32 --brick 32 --shard 64 -j 2 --progress none";
    for seed in 0..3 {
        sandbox.run_ok(&format!(
            "synth turbulence s{seed}.raw --shape 160,160,160 --dtype f32 --seed {seed} --progress none"
        ));
    }
    // An append that counts the values in the existing steps, left uncounted by a pack.
    sandbox.run_ok(&format!("pack s0.raw packed.zarr {flags} --time-step 1"));
    for (store, files) in [("new.zarr", "s0.raw s1.raw s2.raw"), ("packed.zarr", "s1.raw s2.raw")] {
        check(&sandbox, &format!("append {store} {files} {flags} --memory 64MiB"), 64 * MIB);
    }
}

/// Every reader on 4 GiB, written by other programs; and every export of 1024^3 voxels, and meshes. With every case of the lists alone, for it takes
/// most of an hour.
#[test]
fn large_files_are_read_and_written_within_the_memory() {
    let Some(python) = python().filter(|_| takes_all()) else { return };
    for script in ["large_inputs.py", "large_outputs.py"] {
        // On the disk: mapped files in memory count as shared memory.
        let sandbox = Sandbox::within(env!("CARGO_TARGET_TMPDIR"));
        let mut command = Command::new(&python);
        command.arg(format!("{}/../tools/{script}", env!("CARGO_MANIFEST_DIR")));
        command.arg("--brickyard").arg(sandbox.command().get_program());
        let done = command.arg("--out").arg(sandbox.path("large")).status().expect("Python starts");
        assert!(done.success(), "{script}: see the table above");
    }
}

/// Environment variable that makes [`a_reader_follows`] the measured process.
const FOLLOWS: &str = "BRICKYARD_TESTS_FOLLOW_STEPS";

/// Appends steps of 64^3 u16, half a MiB each.
const APPEND: &str = "append f.zarr f.raw --shape 64,64,64 --dtype u16 --brick 16 --progress none";

/// The process measured by [`following_takes_no_more_with_each_step`], which follows a store and reads each step; does nothing by
/// itself.
#[test]
fn a_reader_follows() {
    let Some(steps) = std::env::var_os(FOLLOWS) else { return };
    let steps: u32 = steps.to_str().and_then(|steps| steps.parse().ok()).expect("a number");
    let mut store = Store::open("f.zarr").expect("a store");
    let whole = store.pyramid().level(Level(0)).extent.full_box();
    let expected = std::fs::read("f.raw").expect("a step");
    let mut voxels = vec![0; expected.len()];
    for step in 1..steps {
        let appended = brickyard_tests::command().args(APPEND.split(' ')).status().expect("the command starts");
        assert!(appended.success());
        store = store.newer().expect("a store").expect("a step more");
        store.read_box(step, 0, Level(0), whole, &mut voxels).expect("a whole step");
        assert!(store.times() == step + 1 && voxels == expected);
    }
}

#[test]
fn following_takes_no_more_with_each_step() {
    let sandbox = Sandbox::within(env!("CARGO_TARGET_TMPDIR"));
    let mut random = Random(5);
    sandbox.write("f.raw", (0..64 * 64 * 64).flat_map(|_| (random.bits() as u16).to_le_bytes()).collect::<Vec<u8>>());
    sandbox.run_ok(APPEND);
    let mut command = Command::new(std::env::current_exe().expect("this program has a path"));
    command.args(["memory::a_reader_follows", "--exact"]).env(FOLLOWS, "40").current_dir(sandbox.path(""));
    let (code, stderr, most) = measured_program(&mut command);
    // All steps would be 20 MiB; the program is a test's.
    assert!(code == 0 && most <= PROGRAM, "{} MiB: {stderr}", most / MIB);
}

#[test]
fn exporting_stays_within_its_memory() {
    let sandbox = sandbox();
    for mib in [24u64, 64] {
        check(&sandbox, &format!("export t.zarr o.raw --overwrite --memory {mib}MiB --progress none"), mib * MIB);
    }
    assert!(sandbox.read("o.raw") == sandbox.read("t.raw"));
    for name in ["o.nii.gz", "o.tif", "o.nrrd"] {
        check(&sandbox, &format!("export t.zarr {name} --memory 24MiB --progress none"), 24 * MIB);
    }
    // A row of its bricks is 64 MiB.
    let wide = "--shape 262144,16,8 --dtype f32 --brick 8 --shard 1024 --progress none";
    sandbox.write("wide.raw", vec![7; 262_144 * 16 * 8 * 4]);
    sandbox.run_ok(&format!("pack wide.raw wide.zarr {wide}"));
    check(&sandbox, "export wide.zarr o.raw --overwrite --memory 32MiB --progress none", 32 * MIB);
    assert!(sandbox.read("o.raw") == sandbox.read("wide.raw"));
    let (code, _, stderr) = sandbox.run("export t.zarr p.raw --memory 1MiB --progress none");
    assert!(
        code == 2 && stderr.contains("--memory 1 MiB is too little") && !sandbox.path("p.raw").exists(),
        "{stderr}"
    );
}

#[test]
fn opening_and_probing_take_little() {
    let sandbox = sandbox();
    check(&sandbox, "info t.zarr", PROGRAM);
    check(&sandbox, "probe t.zarr 100,100,100 --voxel", PROGRAM);
}

#[test]
fn rendering_stays_within_its_budgets() {
    let sandbox = sandbox();
    for (gpu_mib, host_mib, samples) in [(8u64, 16u64, 1), (32, 32, 4), (128, 64, 1)] {
        let budgets = format!("--gpu-memory {gpu_mib}MiB --host-memory {host_mib}MiB -j 2 --aa {samples}");
        let line = format!("render t.zarr -o o.png --overwrite --size 300x200 --orbit 3 {budgets}");
        let budget = (gpu_mib + host_mib) * MIB;
        check(&sandbox, &format!("{line} --backend cpu"), budget + PROGRAM);
        for compositor in ["raycast", "sorted"] {
            let line = format!("{line} --backend gpu --compositor {compositor}");
            let (code, _, stderr) = sandbox.run(&line);
            if code == 1 && stderr.contains("--backend cpu") {
                leave_out("gpu", stderr);
                continue;
            }
            check(&sandbox, &line, budget + PROGRAM + DRIVER);
        }
    }
}
