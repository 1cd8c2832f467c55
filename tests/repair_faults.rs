//! Faults under `verify --repair`: exit code 0 means the packed store, byte for byte. Otherwise every file is the damaged one or the packed one, and the
//! next repair ends it.
#![cfg(target_os = "linux")]

use brickyard_tests::fault_cases::{
    Moment, OF_FILES, OF_READING, OF_WRITING, Result, ended, ended_well, ensure, in_two, moments, rules, store_tree,
    write_inputs,
};
use brickyard_tests::faults::{Outcome, Trial};
use brickyard_tests::power_loss::{Tree, read_tree, write_tree};
use brickyard_tests::{Random, tree_difference};
use std::collections::BTreeMap;
use std::path::PathBuf;

const FLAGS: &str = "--shape 20,17,12 --dtype u16 --progress none";

/// Files of all kinds: two of level 0, a coarse one, one of the second pyramid, aprons, side data, documents.
const HARMED: [&str; 8] = [
    "0/c/0/0/0",
    "0/c/0/1/1",
    "1/c/0/0/0",
    "1/.brickyard/max/c/0/0/0",
    "0/.brickyard/aprons/c/0/0/0/0",
    "0/.brickyard/ranges/c/0/0/0/0/0/0",
    "1/.brickyard/shards/c/0/0/0/0/0/0",
    "1/zarr.json",
];

/// A damaged store.
struct Damaged {
    trial: Trial,
    input: Vec<u8>,
    before: Tree,
    damaged: BTreeMap<PathBuf, Vec<u8>>,
    packed: BTreeMap<PathBuf, Vec<u8>>,
    /// The repair without harm.
    run: Outcome,
}

fn repair() -> String {
    format!("verify out.zarr --repair in.raw {FLAGS}")
}

impl Damaged {
    fn new() -> Self {
        let trial = Trial::default();
        let mut random = Random(6);
        let input: Vec<u8> = (0..20 * 17 * 12).flat_map(|_| (random.bits() as u16).to_le_bytes()).collect();
        write_inputs(&trial.sandbox.path(""), [("in.raw", &input[..])]);
        let store = trial.sandbox.path("out.zarr");
        let unharmed = |line: &str| {
            let run = trial.run(line, "");
            assert_eq!(run.code, Some(0), "{}", ended(&run));
            run
        };
        unharmed(&format!("pack in.raw out.zarr {FLAGS} --brick 8 --shard 16 --downsample mean,max --aprons 1 -j 2"));
        let packed = store_tree(&store);
        for (i, name) in HARMED.iter().enumerate() {
            let path = store.join(name);
            let mut bytes = std::fs::read(&path).expect("a file of the store");
            match i % 2 {
                0 => bytes[7] ^= 8,
                _ => bytes.truncate(5),
            }
            std::fs::write(path, bytes).expect("the sandbox is writable");
        }
        let (before, damaged) = (read_tree(&trial.sandbox.path("")), store_tree(&store));
        let run = unharmed(&repair());
        let damaged = Self { trial, input, before, damaged, packed, run };
        damaged.is_packed().expect("the store is repaired");
        damaged
    }

    fn restore_input(&self) {
        write_inputs(&self.trial.sandbox.path(""), [("in.raw", &self.input[..])]);
    }

    fn is_packed(&self) -> Result<()> {
        let difference = tree_difference(&store_tree(&self.trial.sandbox.path("out.zarr")), &self.packed);
        ensure(difference.is_empty(), || format!("the store is another: {difference:?}"))
    }

    /// Whether no file is worse than before.
    fn is_no_worse(&self) -> Result<()> {
        let found = store_tree(&self.trial.sandbox.path("out.zarr"));
        for name in self.damaged.keys().chain(self.packed.keys()) {
            let is_either = [&self.damaged, &self.packed].iter().any(|known| known.get(name) == found.get(name));
            ensure(is_either, || format!("{} is neither as before nor as packed", name.display()))?;
        }
        let others = found
            .keys()
            .find(|name| !self.packed.contains_key(*name) && name.extension().is_none_or(|end| end != "tmp"));
        ensure(others.is_none(), || format!("{others:?} is there, too"))
    }

    fn is_repaired_afterwards(&self) -> Result<()> {
        self.restore_input();
        let again = self.trial.run(&repair(), "");
        ensure(again.code == Some(0), || format!("afterwards: {}", ended(&again)))?;
        self.is_packed()
    }

    fn is_right_or_goes_on(&self, rule: &str) -> Result<()> {
        write_tree(&self.trial.sandbox.path(""), &self.before);
        self.restore_input();
        let outcome = self.trial.run(&repair(), rule);
        ended_well(&outcome, rule)?;
        if outcome.code == Some(0) {
            self.is_packed().map_err(|problem| format!("{problem}; {}", ended(&outcome)))?;
        }
        self.is_no_worse().map_err(|problem| format!("{problem}; {}", ended(&outcome)))?;
        self.is_repaired_afterwards()
    }
}

#[test]
fn a_repair_that_meets_a_fault_is_right_or_goes_on() {
    let rules = |damaged: &Damaged| {
        let of = [("", &OF_WRITING[..]), ("out.zarr", &OF_READING), ("in.raw", &OF_READING), ("in.raw", &OF_FILES)];
        of.into_iter().flat_map(|(part, faults)| rules(faults, &damaged.run, part)).collect()
    };
    in_two(80, Damaged::new, rules, |damaged, rule| damaged.is_right_or_goes_on(rule));
}

#[test]
fn a_repair_that_loses_power_goes_on() {
    let moments = |damaged: &Damaged| moments(&damaged.run, &damaged.before);
    in_two(60, Damaged::new, moments, |damaged, moment: &Moment| {
        write_tree(&damaged.trial.sandbox.path(""), &moment.remains(&damaged.run, &damaged.before));
        if moment.is_end_of(&damaged.run) {
            damaged.is_packed()?;
        }
        damaged.is_no_worse()?;
        damaged.is_repaired_afterwards()
    });
}

/// The command's words and exit codes.
#[test]
fn a_repair_tells_its_files_and_refuses_another_input() {
    let damaged = Damaged::new();
    let store = damaged.trial.sandbox.path("");
    let told = String::from_utf8_lossy(&damaged.run.stdout).into_owned();
    assert!(HARMED.iter().all(|name| told.contains(&format!("out.zarr/{name}: repaired\n"))), "{told}");
    assert!(told.ends_with("are sound\n"), "{told}");
    write_tree(&store, &damaged.before);
    let plain = damaged.trial.run("verify out.zarr --progress none", "");
    assert_eq!(plain.code, Some(5), "{}", ended(&plain));
    let mut other = damaged.input.clone();
    other[100] ^= 1;
    write_inputs(&store, [("in.raw", &other[..])]);
    let refused = damaged.trial.run(&repair(), "");
    assert!(refused.code == Some(3) && refused.stderr.contains("is not made from this source"), "{}", ended(&refused));
    // The document alone follows from the store.
    let mut found = store_tree(&damaged.trial.sandbox.path("out.zarr"));
    found.insert("1/zarr.json".into(), damaged.damaged[&PathBuf::from("1/zarr.json")].clone());
    assert_eq!(tree_difference(&found, &damaged.damaged), [""; 0]);
    damaged.restore_input();
    for (line, words) in [
        ("verify out.zarr --shape 20,17,12", "--repair INPUT, which is missing"),
        ("verify out.zarr --repair", "expected the input"),
        ("verify out.zarr --repair -", "cannot be read again"),
    ] {
        let refused = damaged.trial.run(line, "");
        assert!(refused.code == Some(2) && refused.stderr.contains(words), "{line}: {}", ended(&refused));
    }
    let json = damaged.trial.run(&format!("{} --json", repair()), "");
    let told: serde_json::Value = serde_json::from_slice(&json.stdout).expect("JSON");
    assert!(
        json.code == Some(0) && told["repaired"].as_array().is_some_and(|files| files.len() == HARMED.len() - 1),
        "{told}"
    );
    damaged.is_packed().expect("the store is repaired");
}
