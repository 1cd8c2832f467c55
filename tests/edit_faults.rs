//! Faults under `edit`: the store has its former metadata or the new ones, whole, and other files stay as they are. Exit code 0 means the edit is made
//! and lasts.
#![cfg(target_os = "linux")]

use brickyard_tests::fault_cases::{
    Moment, OF_FILES, OF_READING, OF_WRITING, Result, ended, ended_well, ensure, in_two, moments, rules, store_tree,
    write_inputs,
};
use brickyard_tests::faults::{Outcome, Trial};
use brickyard_tests::power_loss::{Tree, read_tree, write_tree};
use brickyard_tests::{Random, tree_difference};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const PACK: &str =
    "pack in.raw out.zarr --shape 20,17,12 --dtype u16 --brick 8 --shard 16 --downsample mean,max --progress none -j 2";
const LABELS: &str = "edit out.zarr --kind labels --progress none -j 2";
const EDIT: &str = "edit out.zarr --spacing 0.5,0.5,2 --unit um --name head --channel-name 0=DAPI";

/// A store, and the same edited.
struct Edited {
    trial: Trial,
    before: Tree,
    stores: [BTreeMap<PathBuf, Vec<u8>>; 2],
    /// The edit without harm.
    run: Outcome,
}

impl Edited {
    fn new() -> Self {
        let trial = Trial::default();
        let mut random = Random(5);
        let voxels: Vec<u8> = (0..20 * 17 * 12).flat_map(|_| (random.bits() as u16).to_le_bytes()).collect();
        write_inputs(&trial.sandbox.path(""), [("in.raw", &voxels[..])]);
        let store = trial.sandbox.path("out.zarr");
        let unharmed = |line: &str| {
            let run = trial.run(line, "");
            assert_eq!(run.code, Some(0), "{}", ended(&run));
            run
        };
        unharmed(PACK);
        let (before, packed) = (read_tree(&trial.sandbox.path("")), store_tree(&store));
        let run = unharmed(EDIT);
        let stores = [packed, store_tree(&store)];
        assert_eq!(tree_difference(&stores[0], &stores[1]).len(), 1, "one document alone is changed");
        unharmed("verify out.zarr --progress none");
        Self { trial, before, stores, run }
    }

    /// Whether the store is the edited one; an error if it is neither. A document under its temporary name may be left.
    fn is_done(&self) -> Result<bool> {
        let mut found = store_tree(&self.trial.sandbox.path("out.zarr"));
        found.remove(Path::new("zarr.json.tmp"));
        let is_done = found == self.stores[1];
        let difference = || format!("the store is neither: {:?}", tree_difference(&found, &self.stores[0]));
        ensure(is_done || found == self.stores[0], difference)?;
        Ok(is_done)
    }

    /// Edits without harm.
    fn is_done_afterwards(&self, was_done: bool) -> Result<()> {
        let again = self.trial.run(EDIT, "");
        let expected = if was_done { Some(2) } else { Some(0) };
        ensure(again.code == expected, || format!("afterwards: {}", ended(&again)))?;
        let difference = tree_difference(&store_tree(&self.trial.sandbox.path("out.zarr")), &self.stores[1]);
        let is_whole = difference.is_empty() || was_done && self.is_done()?;
        ensure(is_whole, || format!("afterwards the store is another: {difference:?}"))
    }

    fn is_right_or_repeated(&self, rule: &str) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &self.before);
        let outcome = self.trial.run(EDIT, rule);
        ended_well(&outcome, rule)?;
        if rule.contains("halve") || rule.contains("empty") {
            // The fault itself is the damage. A file that the edit has read for the last time may be damaged after that.
            let found = store_tree(&self.trial.sandbox.path("out.zarr"));
            let damaged = tree_difference(&found, &self.stores[1]);
            let document = Path::new("zarr.json");
            let is_edited = damaged.len() <= 1 && found.get(document) != self.stores[0].get(document);
            return ensure(outcome.code != Some(0) || is_edited, || "a damaged store was edited".into());
        }
        let is_done = self.is_done()?;
        match outcome.code {
            Some(0) => ensure(is_done, || "nothing is edited".into())?,
            Some(_) if is_done => {
                ensure(outcome.stderr.contains("is edited, but"), || {
                    format!("it says otherwise: {}", ended(&outcome))
                })?;
            }
            _ => {}
        }
        self.is_done_afterwards(is_done)
    }

    fn is_right_or_repeated_after(&self, moment: &Moment) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &moment.remains(&self.run, &self.before));
        let is_done = self.is_done()?;
        ensure(is_done || !moment.is_end_of(&self.run), || "the edit is lost".into())?;
        self.is_done_afterwards(is_done)
    }
}

#[test]
fn an_edit_that_meets_a_fault_is_made_or_not() {
    let rules = |edited: &Edited| {
        let of = [("", &OF_WRITING[..]), ("out.zarr", &OF_READING), ("out.zarr/", &OF_FILES)];
        of.into_iter().flat_map(|(part, faults)| rules(faults, &edited.run, part)).collect()
    };
    in_two(60, Edited::new, rules, |edited, rule| edited.is_right_or_repeated(rule));
}

#[test]
fn an_edit_that_loses_power_is_made_or_not() {
    let moments = |edited: &Edited| moments(&edited.run, &edited.before);
    in_two(60, Edited::new, moments, |edited, moment| edited.is_right_or_repeated_after(moment));
}

/// An image before its levels are made again for labels, and the edited store.
struct Levels {
    trial: Trial,
    before: Tree,
    stores: [BTreeMap<PathBuf, Vec<u8>>; 2],
    run: Outcome,
}

impl Levels {
    fn new() -> Self {
        let Edited { trial, before, stores: [packed, _], .. } = Edited::new();
        write_tree(&trial.sandbox.path(""), &before);
        let run = trial.run(LABELS, "");
        assert_eq!(run.code, Some(0), "{}", ended(&run));
        let stores = [packed, store_tree(&trial.sandbox.path("out.zarr"))];
        let changed = tree_difference(&stores[0], &stores[1]);
        assert!(changed.len() > 3 && changed.iter().all(|path| !path.starts_with("0")), "{changed:?}");
        assert_eq!(trial.run("verify out.zarr --progress none", "").code, Some(0));
        Self { trial, before, stores, run }
    }

    /// Whether the store is the edited one; an error if it is neither.
    fn is_done(&self) -> Result<bool> {
        let mut found = store_tree(&self.trial.sandbox.path("out.zarr"));
        for left in [".brickyard-journal", ".brickyard-lock"] {
            found.remove(Path::new(left));
        }
        let is_done = found == self.stores[1];
        let difference = || format!("the store is neither: {:?}", tree_difference(&found, &self.stores[0]));
        ensure(is_done || found == self.stores[0], difference)?;
        Ok(is_done)
    }

    /// Edits without harm: the store is the edited one, and nothing is left beside it.
    fn is_done_afterwards(&self, was_done: bool) -> Result<()> {
        let again = self.trial.run(LABELS, "");
        let expected = if was_done { Some(2) } else { Some(0) };
        ensure(again.code == expected, || format!("afterwards: {}", ended(&again)))?;
        let difference = tree_difference(&store_tree(&self.trial.sandbox.path("out.zarr")), &self.stores[1]);
        ensure(difference.is_empty(), || format!("afterwards the store is another: {difference:?}"))?;
        ensure(!self.trial.sandbox.path("out.zarr.packing").exists(), || "something is left beside it".into())
    }

    fn is_right_or_repeated(&self, rule: &str) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &self.before);
        let outcome = self.trial.run(LABELS, rule);
        ended_well(&outcome, rule)?;
        let is_done = self.is_done()?;
        ensure(is_done || outcome.code != Some(0), || "nothing is edited".into())?;
        self.is_done_afterwards(is_done)
    }

    fn is_right_or_repeated_after(&self, moment: &Moment) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &moment.remains(&self.run, &self.before));
        let is_done = self.is_done()?;
        ensure(is_done || !moment.is_end_of(&self.run), || "the edit is lost".into())?;
        self.is_done_afterwards(is_done)
    }
}

#[test]
fn levels_made_again_under_a_fault_are_the_old_ones_or_the_new() {
    let rules = |levels: &Levels| rules(&OF_WRITING, &levels.run, "");
    in_two(40, Levels::new, rules, |levels, rule| levels.is_right_or_repeated(rule));
}

#[test]
fn levels_made_again_as_power_fails_are_the_old_ones_or_the_new() {
    let moments = |levels: &Levels| moments(&levels.run, &levels.before);
    in_two(40, Levels::new, moments, |levels, moment| levels.is_right_or_repeated_after(moment));
}
