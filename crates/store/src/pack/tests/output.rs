//! Destinations of packs: several at once on one output, deletions by overwriting, and interrupted overwrites.

use super::*;
use std::sync::Barrier;
use std::time::Duration;

fn source() -> Array<u8> {
    Array::new([70, 40, 75], |p| value(p) as u8)
}

/// Settings that give different stores.
fn variant(i: usize, exists: Exists) -> PackOptions {
    PackOptions { codec: Codec::Zstd(1 + i as i32), exists, threads: 1, ..options(VoxelType::U8) }
}

fn fingerprint_of(store: &Path) -> String {
    Store::open(store).unwrap().info().settings_fingerprint.clone()
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        std::fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Stops a pack after some of its shards.
fn interrupted(store: &Path, options: &PackOptions) {
    let source = source();
    source.fuse.store(30, Ordering::Relaxed);
    pack(&source, store, options, &()).unwrap_err();
}

/// Packs started together, each with its own settings and delay; returns their results in order.
fn together(store: &Path, packs: &[(PackOptions, Duration)]) -> Vec<Result<PackReport, PackError>> {
    let (source, start) = (source(), Barrier::new(packs.len()));
    let one = |(options, delay): &(PackOptions, Duration)| {
        start.wait();
        std::thread::sleep(*delay);
        pack(&source, store, options, &())
    };
    let one = &one;
    std::thread::scope(|scope| {
        let running: Vec<_> = packs.iter().map(|pack| scope.spawn(move || one(pack))).collect();
        running.into_iter().map(|pack| pack.join().unwrap()).collect()
    })
}

fn is_me(error: &PackError) -> bool {
    matches!(error, PackError::Busy { holder: Some(holder), .. } if holder.pid == std::process::id())
}

/// The store is whole, is the last winner's, and stands alone.
fn assert_whole(store: &Path, fingerprints: &[String], what: &str) {
    assert_eq!(crate::verify::verify(store, |_, _| {}).unwrap().problems, [], "{what}");
    assert!(fingerprints.contains(&fingerprint_of(store)), "{what}");
    assert!(!files(store).keys().any(|path| path.to_string_lossy().contains(".brickyard-")), "{what}");
    assert_eq!(names(store.parent().unwrap()), ["s.zarr"], "{what}");
}

#[test]
fn of_packs_that_start_together_one_wins_and_the_others_learn_who() {
    let mut random = 12345u64;
    let mut delay = |most: u64| {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        Duration::from_micros((random >> 33) % most.max(1))
    };
    let settings = |options: &PackOptions| fingerprint(&super::settings(&source(), options));
    for round in 0..12 {
        // From all at once to spread over a pack's time.
        let most = [1, 300, 3000, 30_000][round % 4];
        let dir = tempfile::tempdir().unwrap();
        let store = dir.path().join("s.zarr");
        let mut fresh = |i: usize| (variant(i % 3, Exists::Refuse), delay(most));
        let packs: Vec<_> = (0..8).map(&mut fresh).collect();
        let done = together(&store, &packs);
        let won: Vec<_> = (0..packs.len()).filter(|&i| done[i].is_ok()).collect();
        assert_eq!(won.len(), 1, "round {round}: {done:?}");
        for error in done.iter().filter_map(|done| done.as_ref().err()) {
            assert!(is_me(error) || matches!(error, PackError::Exists { .. }), "round {round}: {error}");
        }
        assert_whole(&store, &[settings(&packs[won[0]].0)], "fresh");

        // Some replace it, one after another or only one of them: every reported success is real.
        let packs: Vec<_> = (0..6).map(|i| (variant(i % 3, Exists::Overwrite), delay(most))).collect();
        let done = together(&store, &packs);
        let won: Vec<_> = (0..packs.len()).filter(|&i| done[i].is_ok()).map(|i| settings(&packs[i].0)).collect();
        assert!(!won.is_empty() && done.iter().all(|done| done.as_ref().err().is_none_or(is_me)), "{done:?}");
        assert_whole(&store, &won, "overwritten");

        // An unfinished one, with packs resuming it, right and wrong, and one starting over.
        std::fs::remove_dir_all(&store).unwrap();
        interrupted(&store, &variant(1, Exists::Refuse));
        let mut packs: Vec<_> = (0..6).map(|i| (variant(i % 3, Exists::Resume), delay(most))).collect();
        packs.extend((round % 2 == 1).then(|| (variant(0, Exists::Overwrite), delay(most))));
        let done = together(&store, &packs);
        let won: Vec<_> = (0..packs.len()).filter(|&i| done[i].is_ok()).map(|i| settings(&packs[i].0)).collect();
        assert!(!won.is_empty(), "round {round}: {done:?}");
        for error in done.iter().filter_map(|done| done.as_ref().err()) {
            assert!(is_me(error) || matches!(error, PackError::Mismatch { .. }), "round {round}: {error}");
        }
        assert_whole(&store, &won, "resumed");
    }
}

/// The same with processes: some are killed, and others continue their work.
#[test]
fn of_processes_that_start_together_one_wins() {
    const CHILD: &str = "BRICKYARD_TEST_PACK";
    if let Ok(task) = std::env::var(CHILD) {
        let mut words = task.splitn(3, ' ');
        let [i, delay] = [0; 2].map(|_| words.next().unwrap().parse::<usize>().unwrap());
        std::thread::sleep(Duration::from_millis(delay as u64));
        let store = Path::new(words.next().unwrap());
        // A killed process leaves a pack that others with its settings can resume.
        let options = variant(i % 2, if i < 4 { Exists::Resume } else { Exists::Overwrite });
        let done = pack(&source(), store, &options, &());
        std::process::exit(match done {
            Ok(_) => 0,
            Err(PackError::Busy { holder: Some(_), .. } | PackError::Mismatch { .. }) => 1,
            Err(error) => panic!("{error}"),
        });
    }
    let name = "pack::tests::output::of_processes_that_start_together_one_wins";
    for round in 0..4 {
        let dir = tempfile::tempdir().unwrap();
        let store = dir.path().join("s.zarr");
        let start = |i: usize| {
            let task = format!("{i} {} {}", i * round * 3, store.display());
            let mut child = std::process::Command::new(std::env::current_exe().unwrap());
            let child = child.args(["--exact", name]).env(CHILD, task).stdout(std::process::Stdio::null());
            child.spawn().unwrap()
        };
        let mut children: Vec<_> = (0..8).map(start).collect();
        if round % 2 == 1 {
            std::thread::sleep(Duration::from_millis(60));
            children[0].kill().unwrap();
        }
        let codes: Vec<_> = children.iter_mut().map(|child| child.wait().unwrap().code()).collect();
        assert!(codes.iter().enumerate().all(|(i, code)| matches!(code, Some(0 | 1)) || i == 0), "{codes:?}");
        assert!(codes.contains(&Some(0)) || round % 2 == 1, "{codes:?}");
        // By now nobody is packing.
        pack(&source(), &store, &variant(0, Exists::Overwrite), &()).unwrap();
        assert_whole(&store, &[fingerprint(&settings(&source(), &variant(0, Exists::Refuse)))], "in the end");
    }
}

#[test]
fn who_packs_is_named_until_it_ends() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    interrupted(&store, &variant(0, Exists::Refuse));
    let disk = Disk::default();
    let held = lock::DirLock::take(&disk, &store).unwrap();
    held.declare(&disk).unwrap();
    for exists in [Exists::Refuse, Exists::Resume, Exists::Overwrite] {
        let error = pack(&source(), &store, &variant(0, exists), &()).unwrap_err();
        let host = rustix::system::uname().nodename().to_string_lossy().into_owned();
        let named = format!("another process packs into it (process {} on {host})", std::process::id());
        assert!(is_me(&error) && error.to_string().contains(&named), "{error}");
    }
    drop(held);
    let refused = pack(&source(), &store, &variant(0, Exists::Refuse), &()).unwrap_err();
    assert!(matches!(refused, PackError::Exists { unfinished: true, .. }), "{refused}");
    // A killed process leaves its name, but not the lock.
    std::fs::write(store.join(crate::layout::LOCK_NAME), "999999999 elsewhere\n").unwrap();
    pack(&source(), &store, &variant(0, Exists::Resume), &()).unwrap();
    assert_eq!(names(dir.path()), ["s.zarr"]);
}

/// Opening the lock file just before its removal and locking it yields nothing: another file has the name by then.
#[test]
fn the_lock_of_a_file_without_its_name_is_none() {
    let dir = tempfile::tempdir().unwrap();
    let place = dir.path().to_path_buf();
    let held = lock::DirLock::take(&Disk::default(), &place).unwrap();
    let (to_test, next) = std::sync::mpsc::channel();
    let disk = Disk::default();
    let others = move || {
        drop(held);
        let next = lock::DirLock::take(&Disk::default(), &place).unwrap();
        next.declare(&Disk::default()).unwrap();
        to_test.send(next).unwrap();
    };
    disk.trial.waiting.lock().unwrap().push(("the lock file is open", Box::new(others)));
    let error = lock::DirLock::take(&disk, dir.path()).err().expect("the other has it");
    assert!(is_me(&error), "{error}");
    drop(next.recv().unwrap());
    drop(lock::DirLock::take(&disk, dir.path()).unwrap());
    assert_eq!(names(dir.path()), [""; 0]);
}

/// Of packs that lock the place beside a store in succession, the first creates it and the last leaves it.
#[test]
fn the_place_beside_a_store_goes_with_the_last_lock() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    pack(&source(), &store, &variant(0, Exists::Refuse), &()).unwrap();
    let beside = dir.path().join("s.zarr.packing");
    let disk = Disk::default();
    let replaced = store.clone();
    let others = move || {
        std::fs::create_dir(&beside).unwrap();
        std::fs::remove_dir_all(replaced).unwrap();
    };
    disk.trial.waiting.lock().unwrap().push(("it is decided", Box::new(others)));
    pack_on(&disk, &source(), &store, &variant(1, Exists::Overwrite), &()).unwrap();
    assert_eq!(names(dir.path()), ["s.zarr"]);
}

/// Between inspection and locking of the output, another pack comes and goes.
#[test]
fn what_was_seen_before_the_lock_is_looked_at_again() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let with_others = |exists, others: Box<dyn FnOnce() + Send>| {
        let disk = Disk::default();
        disk.trial.waiting.lock().unwrap().push(("it is decided", others));
        pack_on(&disk, &source(), &store, &variant(0, exists), &())
    };
    let other = |options: PackOptions| {
        let store = store.clone();
        Box::new(move || drop(pack(&source(), &store, &options, &()).unwrap())) as Box<dyn FnOnce() + Send>
    };
    let theirs = fingerprint(&settings(&source(), &variant(1, Exists::Refuse)));
    // Nothing was there, and now there is a store.
    let error = with_others(Exists::Refuse, other(variant(1, Exists::Refuse))).unwrap_err();
    assert!(matches!(error, PackError::Exists { unfinished: false, .. }), "{error}");
    assert_eq!(fingerprint_of(&store), theirs);
    std::fs::remove_dir_all(&store).unwrap();
    let error = with_others(Exists::Resume, other(variant(1, Exists::Refuse))).unwrap_err();
    assert!(matches!(error, PackError::Mismatch { .. }), "{error}");
    assert_eq!(fingerprint_of(&store), theirs);
    // An unfinished pack was there, and has been finished, or started over.
    std::fs::remove_dir_all(&store).unwrap();
    interrupted(&store, &variant(1, Exists::Refuse));
    let error = with_others(Exists::Resume, other(variant(1, Exists::Resume))).unwrap_err();
    assert!(matches!(error, PackError::Mismatch { .. }), "{error}");
    assert_whole(&store, &[theirs], "theirs");
    // A store was there, and has been replaced or deleted: overwriting succeeds all the same.
    let ours = fingerprint(&settings(&source(), &variant(0, Exists::Refuse)));
    with_others(Exists::Overwrite, other(variant(2, Exists::Overwrite))).unwrap();
    assert_whole(&store, std::slice::from_ref(&ours), "replaced");
    let gone = store.clone();
    with_others(Exists::Overwrite, Box::new(move || std::fs::remove_dir_all(gone).unwrap())).unwrap();
    assert_whole(&store, &[ours], "gone");
}

/// The holder of the old store's lock during the exchange releases it, but no longer finds its file; a pack killed as
/// its last step leaves one too.
#[test]
fn the_old_store_goes_with_a_lock_file_that_nobody_holds() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    for cannot_exchange in [false, true] {
        pack(&source(), &store, &variant(0, Exists::Overwrite), &()).unwrap();
        std::fs::write(store.join(crate::layout::LOCK_NAME), "999999999 elsewhere\n").unwrap();
        let (disk, last) = (Trial { cannot_exchange, ..Trial::default() }.disk(), variant(1, Exists::Overwrite));
        pack_on(&disk, &source(), &store, &last, &()).unwrap();
        assert_whole(&store, &[fingerprint(&settings(&source(), &last))], &format!("{cannot_exchange}"));
    }
}

/// Overwrites a store until it has its name and the replaced one is still beside it. The returned function lets the
/// pack continue, and waits for its end.
fn overwritten_but_for_the_old(store: &Path, settings: usize) -> impl FnOnce() + Send + use<> {
    let (store, disk) = (store.to_path_buf(), Disk::default());
    let (to_test, exchanged) = std::sync::mpsc::channel();
    let (go_on, waits) = std::sync::mpsc::channel::<()>();
    let stop = move || {
        to_test.send(()).unwrap();
        waits.recv().unwrap();
    };
    disk.trial.waiting.lock().unwrap().push(("the names are exchanged", Box::new(stop)));
    let pack = move || pack_on(&disk, &source(), &store, &variant(settings, Exists::Overwrite), &()).unwrap();
    let running = std::thread::spawn(pack);
    exchanged.recv().unwrap();
    move || {
        go_on.send(()).unwrap();
        running.join().unwrap();
    }
}

/// While the store and its neighbour are inspected, other packs replace the store in succession. The combined
/// observations were never true at one time: a store, and beside it another one that nobody is about to remove.
#[test]
fn names_that_are_exchanged_while_they_are_looked_at_are_looked_at_again() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    pack(&source(), &store, &variant(1, Exists::Refuse), &()).unwrap();
    let first = overwritten_but_for_the_old(&store, 2);
    let (to_second_look, second) = std::sync::mpsc::channel();
    let path = store.clone();
    let at_first_look = move || {
        first();
        to_second_look.send(overwritten_but_for_the_old(&path, 1)).unwrap();
    };
    let at_second_look = move || second.recv().unwrap()();
    let moment = "one of two names was looked at";
    let disk = Disk::default();
    disk.trial.waiting.lock().unwrap().push((moment, Box::new(at_first_look)));
    disk.trial.waiting.lock().unwrap().push((moment, Box::new(at_second_look)));
    pack_on(&disk, &source(), &store, &variant(0, Exists::Overwrite), &()).unwrap();
    assert!(disk.trial.waiting.lock().unwrap().is_empty());
    assert_whole(&store, &[fingerprint(&settings(&source(), &variant(0, Exists::Refuse)))], "the last one's");
}

#[test]
fn overwriting_deletes_only_what_packing_wrote() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let both = |exists| PackOptions { downsample: mean_and_max(), aprons: 1, ..variant(0, exists) };
    pack(&source(), &store, &both(Exists::Refuse), &()).unwrap();
    assert_eq!(ours::find_foreign(&store).unwrap(), None, "all that packing writes is known");
    let expected = files(&store);
    let overwrite = |options: PackOptions| pack(&source(), &store, &options, &()).unwrap_err();

    let foreign = ["labels/zarr.json", "0/notes.txt", "1/c/0/0/notes", "0/c/00", "0/.brickyard/minmax/x", "2/x/y"];
    for name in foreign {
        let path = store.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, "theirs").unwrap();
        let error = overwrite(variant(1, Exists::Overwrite));
        assert!(matches!(&error, PackError::Foreign { found, .. } if path.starts_with(found)), "{name}: {error}");
        assert_eq!(std::fs::read(&path).unwrap(), b"theirs");
        std::fs::remove_file(&path).unwrap();
        let _ = std::fs::remove_dir(path.parent().unwrap());
    }
    // A folder of labels without any is no one's.
    std::fs::create_dir(store.join("labels")).unwrap();
    pack(&source(), &store, &both(Exists::Overwrite), &()).unwrap();
    assert!(!store.join("labels").exists());
    std::os::unix::fs::symlink(dir.path(), store.join("7")).unwrap();
    assert!(matches!(overwrite(variant(1, Exists::Overwrite)), PackError::Foreign { .. }));
    std::fs::remove_file(store.join("7")).unwrap();
    assert_same(&expected, &files(&store), "refused");
    assert_eq!(names(dir.path()), ["s.zarr"]);

    // The same for files added during the pack; the finished result stays beside the store then.
    struct Meddler(std::path::PathBuf);
    impl crate::pack::Progress for Meddler {
        fn advanced(&self, _done: u64, _total: u64) {
            std::fs::write(&self.0, "theirs").unwrap();
        }
    }
    let late = store.join("late.txt");
    let error =
        pack(&source(), &store, &variant(1, Exists::Overwrite), &Meddler(late.clone())).expect_err("there is a file");
    assert!(matches!(&error, PackError::Foreign { found, .. } if *found == late), "{error}");
    std::fs::remove_file(&late).unwrap();
    assert_same(&expected, &files(&store), "refused at the end");
    std::fs::remove_dir_all(dir.path().join("s.zarr.packing")).unwrap();

    // An unfinished pack likewise.
    let unfinished = dir.path().join("u.zarr");
    interrupted(&unfinished, &variant(0, Exists::Refuse));
    std::fs::write(unfinished.join("theirs"), "x").unwrap();
    let error = pack(&source(), &unfinished, &variant(0, Exists::Overwrite), &()).unwrap_err();
    assert!(matches!(error, PackError::Foreign { .. }), "{error}");
    assert!(unfinished.join(JOURNAL_NAME).exists());
    std::fs::remove_dir_all(&unfinished).unwrap();

    // Anything with the name used for replacing a store is left alone: a store, an unfinished pack, a folder, a file.
    let beside = dir.path().join("s.zarr.packing");
    let refused = |what: &str| {
        let before = if beside.is_dir() { files(&beside) } else { Default::default() };
        let error = overwrite(variant(1, Exists::Overwrite));
        assert!(matches!(&error, PackError::InTheWay { path, .. } if *path == beside), "{what}: {error}");
        if beside.is_dir() {
            assert_same(&before, &files(&beside), what);
        }
    };
    pack(&source(), &beside, &variant(0, Exists::Refuse), &()).unwrap();
    refused("a store");
    std::fs::remove_dir_all(&beside).unwrap();
    interrupted(&beside, &variant(0, Exists::Refuse));
    refused("an unfinished pack");
    let difference = pack(&source(), &store, &variant(0, Exists::Resume), &()).unwrap_err();
    assert!(matches!(difference, PackError::Mismatch { .. }), "{difference}");
    std::fs::remove_dir_all(&beside).unwrap();
    std::fs::create_dir(&beside).unwrap();
    std::fs::write(beside.join("x"), "theirs").unwrap();
    refused("a folder");
    std::fs::remove_dir_all(&beside).unwrap();
    std::fs::write(&beside, "theirs").unwrap();
    refused("a file");
    std::fs::remove_file(&beside).unwrap();
    pack(&source(), &store, &variant(1, Exists::Overwrite), &()).unwrap();
    assert_eq!(names(dir.path()), ["s.zarr"]);
}

/// A link's target is replaced, and the link stays; a directory may be named by a dot.
#[test]
fn links_and_dots_name_what_they_lead_to() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("real/s.zarr");
    pack(&source(), &store, &variant(0, Exists::Refuse), &()).unwrap();
    let link = dir.path().join("link");
    std::os::unix::fs::symlink(&store, &link).unwrap();
    for (i, name) in [(1, link.clone()), (2, link.join("")), (0, store.join(".")), (1, store.join("../s.zarr/0/.."))] {
        let expected = fingerprint(&settings(&source(), &variant(i, Exists::Overwrite)));
        pack(&source(), &name, &variant(i, Exists::Overwrite), &()).unwrap();
        assert_eq!(fingerprint_of(&store), expected, "{}", name.display());
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(
            (names(dir.path()), names(&dir.path().join("real"))),
            (vec!["link".into(), "real".into()], vec!["s.zarr".into()])
        );
    }
    std::fs::remove_dir_all(dir.path().join("real")).unwrap();
    let error = pack(&source(), &link, &variant(0, Exists::Refuse), &()).unwrap_err();
    assert!(error.to_string().contains("link"), "{error}");
}

/// An overwrite stopped at any change leaves the old store or the new one, and can be resumed or started over.
#[test]
fn an_overwrite_stopped_at_any_change_leaves_a_whole_store_and_is_finished() {
    let small = || Array::new([12, 12, 20], |p| value(p) as u8 + 1);
    let (old, new) = (variant(0, Exists::Overwrite), variant(1, Exists::Overwrite));
    let (old_files, new_files) = (packed(&small(), &old), packed(&small(), &new));
    for cannot_exchange in [false, true] {
        let overwrite = |fuse: i64| {
            let dir = tempfile::tempdir().unwrap();
            let store = dir.path().join("s.zarr");
            pack(&small(), &store, &old, &()).unwrap();
            let disk = Trial { fuse: Some(AtomicI64::new(fuse)), cannot_exchange, ..Trial::default() }.disk();
            let stopped = pack_on(&disk, &small(), &store, &new, &());
            (dir, store, stopped, disk.trial.log.into_inner().unwrap())
        };
        let (_dir, store, done, log) = overwrite(i64::MAX);
        done.unwrap();
        assert_same(&new_files, &files(&store), "all of it");
        // The exchange of names and its neighbourhood; only some of the other changes.
        let names_change = |what: &str, path: &Path| what == "exchange" || what == "rename_dir" || path == store;
        let exchange = log.iter().position(|(what, path)| names_change(what, path)).unwrap();
        let near = |n: &usize| *n < 4 || n.abs_diff(exchange) < 7 || *n + 4 > log.len() || n.is_multiple_of(11);
        let mut without = 0;
        for n in (0..log.len()).filter(near) {
            let (dir, store, stopped, _) = overwrite(n as i64);
            let what = format!("stopped at change {n} ({:?}), {cannot_exchange}", log[n]);
            assert!(stopped.is_err(), "{what}");
            if store.exists() {
                let mut left = files(&store);
                left.remove(Path::new(JOURNAL_NAME));
                assert_same(if left == old_files { &old_files } else { &new_files }, &left, &what);
            } else {
                // Between two renames.
                without += 1;
                assert_same(&old_files, &files(&dir.path().join("s.zarr.replaced")), &what);
            }
            let disk = Trial { cannot_exchange, ..Trial::default() }.disk();
            // Every other time by starting over.
            let exists = if n % 2 == 0 { Exists::Resume } else { Exists::Overwrite };
            let ended = pack_on(&disk, &small(), &store, &PackOptions { exists, ..new.clone() }, &());
            // If stopped before its start, there is nothing to resume.
            if !matches!(ended, Err(PackError::Mismatch { .. })) {
                ended.unwrap_or_else(|error| panic!("{what}: {error}"));
                assert_same(&new_files, &files(&store), &what);
                assert_eq!(names(dir.path()), ["s.zarr"], "{what}");
            }
        }
        assert_eq!(without, cannot_exchange as u32);
    }
}

/// The order in which a store becomes durable: the journal's name; a shard's bytes and name; all names, the root
/// document, the store's parent folder; the exchange, the old store's removal; the journal's. Both with the file system
/// synced as one, and with files synced one by one.
#[test]
fn what_lasts_lasts_before_what_tells_of_it() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("new/folder/s.zarr");
    let changes = |options: &PackOptions, syncs_each: bool| {
        let disk = Trial { syncs_each, ..Trial::default() }.disk();
        pack_on(&disk, &source(), &store, options, &()).unwrap();
        let name = |path: &Path| path.strip_prefix(dir.path()).unwrap().to_string_lossy().into_owned();
        disk.trial
            .log
            .into_inner()
            .unwrap()
            .iter()
            .map(|(what, path)| format!("{what} {}", name(path)))
            .collect::<Vec<_>>()
    };
    // The last occurrence of the one precedes the first of the other.
    let check = |log: &[String], before: &str, after: &str| {
        let last = log.iter().rposition(|change| change == before).unwrap_or_else(|| panic!("{before} in {log:#?}"));
        let first = log.iter().position(|change| change == after).unwrap_or_else(|| panic!("{after} in {log:#?}"));
        assert!(last < first, "{before} before {after}: {log:#?}");
    };
    let at = "new/folder/s.zarr";
    let log = changes(&variant(0, Exists::Refuse), false);
    let root = format!("rename {at}/zarr.json");
    // All names but the root's come before the last sync of the whole, and this before the root's.
    let last_sync = log.iter().rposition(|change| *change == format!("sync_all {at}")).unwrap();
    let place_of_root = log.iter().position(|change| *change == root).unwrap();
    let is_name = |change: &String| change.starts_with("rename") && *change != root;
    let last_name = log.iter().rposition(is_name).unwrap();
    assert!(last_name < last_sync && last_sync < place_of_root, "{log:#?}");
    check(&log, &format!("sync {at}/zarr.json.tmp"), &root);
    // Whatever the number of files: those of the pack, and one for each level's aprons.
    let syncs = log.iter().filter(|change| change.contains("sync")).count();
    assert!(syncs < 20, "{syncs}: {log:#?}");
    std::fs::remove_dir_all(dir.path().join("new")).unwrap();

    let log = changes(&variant(0, Exists::Refuse), true);
    let begun = log.iter().position(|change| change.contains("/c/")).unwrap();
    for made in ["", "new", "new/folder"] {
        assert!(log[..begun].contains(&format!("sync_dir {made}")), "{made}: {log:#?}");
    }
    let journal = format!("{at}/{JOURNAL_NAME}");
    let named = log.iter().position(|change| *change == format!("rename {journal}")).unwrap();
    assert!(log[named..begun].contains(&format!("sync_dir {at}")), "{log:#?}");
    let shards: Vec<&String> =
        log.iter().filter(|change| change.starts_with("rename") && change.contains("/c/")).collect();
    assert!(shards.len() > 10);
    for shard in shards {
        let shard = shard.trim_start_matches("rename ");
        check(&log, &format!("sync {shard}.tmp"), &format!("rename {shard}"));
        let folder = Path::new(shard).parent().unwrap().display();
        check(&log, &format!("rename {shard}"), &format!("sync_dir {folder}"));
        check(&log, &format!("sync_dir {folder}"), &format!("rename {at}/zarr.json"));
    }
    check(&log, &format!("sync {at}/zarr.json.tmp"), &format!("rename {at}/zarr.json"));
    check(&log, &format!("rename {at}/zarr.json"), &format!("remove_file {journal}"));
    let tail: Vec<&str> = log.iter().rev().take(4).rev().map(String::as_str).collect();
    let (synced, parent) = (format!("sync_dir {at}"), "sync_dir new/folder".to_string());
    assert_eq!(tail, [&synced, &parent, &format!("remove_file {journal}"), &synced]);

    let log = changes(&variant(1, Exists::Overwrite), true);
    let exchange = log.iter().position(|change| change.starts_with("exchange")).unwrap();
    let (before, tail) = log.split_at(exchange);
    assert_eq!(
        before[before.len() - 2..],
        [format!("rename {at}.packing/zarr.json"), format!("sync_dir {at}.packing")]
    );
    assert_eq!(tail[1], parent);
    let place = |change: String| tail.iter().position(|found| *found == change).unwrap();
    assert!(place(format!("remove_file {at}.packing/zarr.json")) > 1);
    // Nor does the old store come back once the journal is gone.
    let last_sync = tail.iter().rposition(|change| *change == parent).unwrap();
    assert!(place(format!("remove_dir {at}.packing")) < last_sync);
    check(tail, &parent, &format!("remove_file {journal}"));
    check(tail, &format!("remove_file {at}.packing/zarr.json"), &format!("remove_file {at}.packing/0/zarr.json"));
    check(tail, &format!("remove_dir {at}.packing"), &format!("remove_file {journal}"));
}

/// Each setting that determines a store's bytes is compared before a pack is resumed.
#[test]
fn every_setting_is_compared_on_resume() {
    let dir = tempfile::tempdir().unwrap();
    let store = dir.path().join("s.zarr");
    let first = variant(0, Exists::Refuse);
    interrupted(&store, &first);
    let keys = settings(&source(), &first);
    let head = journal::Head::of(&store).unwrap();
    for (key, value) in keys.as_object().unwrap() {
        let mut changed = head.clone();
        changed.settings[key] = if value == &json!(77) { json!(78) } else { json!(77) };
        drop(journal::Journal::create(&Disk::default(), &store, changed).unwrap());
        let error = pack(&source(), &store, &variant(0, Exists::Resume), &()).unwrap_err().to_string();
        assert!(error.contains("cannot be resumed") && error.contains(&format!("{key} was")), "{key}: {error}");
    }
    // The program's view of its input and options is part of them.
    let differs = |change: &dyn Fn(&mut Array<u8>, &mut PackOptions), key: &str| {
        let (mut source, mut options) = (source(), first.clone());
        change(&mut source, &mut options);
        let found = settings(&source, &options);
        let changed: Vec<&String> = keys.as_object().unwrap().keys().filter(|k| keys[*k] != found[*k]).collect();
        assert_eq!(changed, [key]);
    };
    differs(&|_, o| o.kind = Kind::Labels, "kind");
    differs(
        &|s, _| {
            s.info.orientation =
                Orientation::new([[2.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]).ok()
        },
        "orientation",
    );
    differs(&|s, _| s.info.geometry.origin.x = 1.0, "geometry");
    differs(&|s, _| s.info.geometry.unit = Some("m".into()), "geometry");
    differs(&|s, _| s.info.identity = "other".into(), "source");
    differs(&|s, _| s.info.times = 2, "times");
    differs(&|s, _| s.info.channels = 2, "channels");
    differs(&|s, _| s.info.voxel_type = VoxelType::I8, "voxel_type");
    differs(&|s, _| s.info.extent.x = 71, "extent");
    differs(&|_, o| o.edge = 32, "brick");
    differs(&|_, o| o.shard_edge = 64, "shard");
    differs(&|_, o| o.codec = Codec::None, "codec");
    differs(&|_, o| o.downsample = Downsample::Max.into(), "downsample");
    differs(&|_, o| o.aprons = 1, "aprons");
    differs(&|s, _| s.info.calibrated = true, "spacing_given");
}
