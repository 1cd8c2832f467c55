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

/// A store, and the same edited by a line.
struct Edited {
    trial: Trial,
    line: &'static str,
    /// Files which a stopped edit may leave in the store, and whether an edit that is made may, too.
    left: &'static [&'static str],
    may_stay: bool,
    before: Tree,
    stores: [BTreeMap<PathBuf, Vec<u8>>; 2],
    /// The edit without harm.
    run: Outcome,
}

impl Edited {
    /// Metadata alone.
    fn metadata() -> Self {
        let edited = Self::by(EDIT, &["zarr.json.tmp"], true);
        assert_eq!(tree_difference(&edited.stores[0], &edited.stores[1]).len(), 1, "one document alone is changed");
        edited
    }

    /// An image whose levels are made again for labels.
    fn levels() -> Self {
        let edited = Self::by(LABELS, &[".brickyard-journal", ".brickyard-lock"], false);
        let changed = tree_difference(&edited.stores[0], &edited.stores[1]);
        assert!(changed.len() > 3 && changed.iter().all(|path| !path.starts_with("0")), "{changed:?}");
        edited
    }

    fn by(line: &'static str, left: &'static [&'static str], may_stay: bool) -> Self {
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
        let run = unharmed(line);
        let stores = [packed, store_tree(&store)];
        unharmed("verify out.zarr --progress none");
        Self { trial, line, left, may_stay, before, stores, run }
    }

    fn found(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        store_tree(&self.trial.sandbox.path("out.zarr"))
    }

    /// Whether the store is the edited one; an error if it is neither. Files of a stopped edit may be left.
    fn is_done(&self) -> Result<bool> {
        let mut found = self.found();
        self.left.iter().for_each(|left| drop(found.remove(Path::new(left))));
        let is_done = found == self.stores[1];
        let difference = || format!("the store is neither: {:?}", tree_difference(&found, &self.stores[0]));
        ensure(is_done || found == self.stores[0], difference)?;
        Ok(is_done)
    }

    /// Edits without harm: the store is the edited one, and nothing is left beside it.
    fn is_done_afterwards(&self, was_done: bool) -> Result<()> {
        let again = self.trial.run(self.line, "");
        let expected = if was_done { Some(2) } else { Some(0) };
        ensure(again.code == expected, || format!("afterwards: {}", ended(&again)))?;
        let difference = tree_difference(&self.found(), &self.stores[1]);
        let is_whole = difference.is_empty() || self.may_stay && was_done && self.is_done()?;
        ensure(is_whole, || format!("afterwards the store is another: {difference:?}"))?;
        ensure(!self.trial.sandbox.path("out.zarr.packing").exists(), || "something is left beside it".into())
    }

    /// Whether the store is the edited one, but for one file cut after its last reading.
    fn is_done_but_for_a_cut(&self) -> bool {
        let found = self.found();
        let is_start = |path: &PathBuf| found.get(path).is_some_and(|bytes| self.stores[1][path].starts_with(bytes));
        tree_difference(&found, &self.stores[1]).len() <= 1 && self.stores[1].keys().all(is_start)
    }

    fn is_right_or_repeated(&self, rule: &str) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &self.before);
        let outcome = self.trial.run(self.line, rule);
        ended_well(&outcome, rule)?;
        if rule.contains("halve") || rule.contains("empty") {
            // The fault itself is the damage.
            let is_well = outcome.code != Some(0) || self.is_done_but_for_a_cut();
            return ensure(is_well, || "a damaged store was edited".into());
        }
        let is_done = self.is_done()?;
        match outcome.code {
            Some(0) => ensure(is_done, || "nothing is edited".into())?,
            Some(_) if is_done && self.may_stay => {
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
    in_two(60, Edited::metadata, rules, |edited, rule| edited.is_right_or_repeated(rule));
}

#[test]
fn an_edit_that_loses_power_is_made_or_not() {
    let moments = |edited: &Edited| moments(&edited.run, &edited.before);
    in_two(60, Edited::metadata, moments, |edited, moment| edited.is_right_or_repeated_after(moment));
}

#[test]
fn levels_made_again_under_a_fault_are_the_old_ones_or_the_new() {
    let rules = |edited: &Edited| rules(&OF_WRITING, &edited.run, "");
    in_two(40, Edited::levels, rules, |edited, rule| edited.is_right_or_repeated(rule));
}

#[test]
fn levels_made_again_as_power_fails_are_the_old_ones_or_the_new() {
    let moments = |edited: &Edited| moments(&edited.run, &edited.before);
    in_two(40, Edited::levels, moments, |edited, moment| edited.is_right_or_repeated_after(moment));
}
