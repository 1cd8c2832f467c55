//! The transfer tables of a session. Each shown function gets one table, made on resolving a scene with it, or ahead of
//! that on a thread, so drawing does not wait meanwhile: for 16-bit codes, the table and its running integrals take
//! some milliseconds.

use brickyard_volume::{
    Isosurface, KeptSlots, Mode, Scene, SceneLayer, SlotEncoding, TransferFunction, TransferTable, Window,
};
use crossbeam_channel::{Receiver, Sender, unbounded};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// A function and its table for an encoding.
#[derive(Clone)]
struct Made {
    wanted: Wanted,
    table: Arc<TransferTable>,
}

/// The function and the encoding of a table.
#[derive(Clone, PartialEq)]
struct Wanted {
    transfer: TransferFunction,
    encoding: SlotEncoding,
}

/// The kept tables: the last used ones, the latest first, and the last one made ahead.
#[derive(Default)]
struct Kept {
    used: Vec<Made>,
    ahead: Option<Made>,
    /// Number of tables in use at once, and whether they will need running integrals.
    layers: usize,
    has_integrals: bool,
    /// The isosurfaces of those layers, and their mode.
    isosurfaces: Vec<Isosurface>,
    mode: Mode,
    /// The last used encoding; `None` before the first table.
    encoding: Option<SlotEncoding>,
}

/// The transfer tables of one volume's layers.
pub(crate) struct Tables {
    /// The encoding of values, where slots hold codes.
    encoding: SlotEncoding,
    /// Whether the next scene is drawn from the slots of the last one.
    slots_stay: bool,
    kept: Arc<Mutex<Kept>>,
    /// Channel to the thread for tables ahead, from the first request on; the thread ends with the channel.
    wanted: OnceLock<Sender<Wanted>>,
}

/// The transfer tables of one volume's channels. Channels with the same codes share theirs.
pub(crate) struct VolumeTables {
    /// Index in `tables` for each channel.
    of_channel: Vec<usize>,
    tables: Vec<Tables>,
}

impl VolumeTables {
    /// Creates empty tables for channels with these encodings. `slots_stay`: a scene is first drawn from the slots of
    /// the previous one.
    pub(crate) fn new(encodings: impl Iterator<Item = SlotEncoding>, slots_stay: bool) -> Self {
        let (mut of_channel, mut tables): (_, Vec<Tables>) = (Vec::new(), Vec::new());
        for encoding in encodings {
            let known = tables.iter().position(|tables| tables.encoding == encoding);
            of_channel.push(known.unwrap_or_else(|| {
                tables.push(Tables { slots_stay, ..Tables::new(encoding) });
                tables.len() - 1
            }));
        }
        Self { of_channel, tables }
    }

    pub(crate) fn of(&self, channel: u32) -> &Tables {
        &self.tables[self.of_channel[channel as usize]]
    }

    /// Announces the next scene's layers of the volume.
    pub(crate) fn expect<'a>(&self, layers: impl Iterator<Item = &'a SceneLayer> + Clone, scene: &Scene) {
        for (i, tables) in self.tables.iter().enumerate() {
            let is_its_own = |layer: &&SceneLayer| self.of_channel.get(layer.channel as usize) == Some(&i);
            tables.expect(layers.clone().filter(is_its_own), scene);
        }
    }

    /// The tables used by the last scene; all of them before there is one.
    pub(crate) fn in_use(&self) -> impl Iterator<Item = &Tables> {
        let is_any = self.tables.iter().any(Tables::is_in_use);
        self.tables.iter().filter(move |tables| !is_any || tables.is_in_use())
    }
}

fn lock(kept: &Mutex<Kept>) -> MutexGuard<'_, Kept> {
    kept.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Tables {
    pub(crate) fn new(encoding: SlotEncoding) -> Self {
        Self { encoding, slots_stay: false, kept: Default::default(), wanted: OnceLock::new() }
    }

    /// [`VolumeTables::expect`] for these tables.
    pub(crate) fn expect<'a>(&self, layers: impl Iterator<Item = &'a SceneLayer> + Clone, scene: &Scene) {
        let mut kept = lock(&self.kept);
        (kept.layers, kept.mode) = (layers.clone().count(), scene.mode);
        kept.has_integrals = scene.sampling.method.is_pre_integrated();
        kept.isosurfaces = layers.flat_map(|layer| &layer.isosurfaces).copied().collect();
    }

    /// Returns a function with its future encoding, if the next scene is otherwise like the last one.
    fn foreseen(&self, transfer: &TransferFunction) -> Wanted {
        let kept = lock(&self.kept);
        let slots = match kept.encoding {
            Some(encoding) if self.slots_stay => KeptSlots::fixed(encoding.floats),
            encoding => KeptSlots::replaceable(encoding.and_then(|encoding| encoding.floats)),
        };
        let encoding = self.encoding.for_window(Window::new(transfer, &kept.isosurfaces, kept.mode), slots);
        Wanted { transfer: transfer.clone(), encoding }
    }

    fn is_in_use(&self) -> bool {
        lock(&self.kept).layers > 0
    }

    /// Returns a transfer function's table for an encoding: a recently used one, one made ahead, or a new one.
    pub(crate) fn table(&self, transfer: &TransferFunction, encoding: &SlotEncoding) -> Arc<TransferTable> {
        let is_it = |made: &&Made| made.wanted.transfer == *transfer && made.wanted.encoding == *encoding;
        let found = {
            let kept = lock(&self.kept);
            kept.used.iter().chain(&kept.ahead).find(is_it).cloned()
        };
        let made = found.unwrap_or_else(|| make(Wanted { transfer: transfer.clone(), encoding: *encoding }, false));
        let (table, kept) = (made.table.clone(), &mut *lock(&self.kept));
        kept.encoding = Some(*encoding);
        kept.used.retain(|other| other.wanted != made.wanted);
        kept.used.insert(0, made);
        kept.used.truncate(kept.layers.max(1));
        table
    }

    /// Makes a transfer function's table on another thread. Of several waiting functions, only the newest gets a table.
    /// If no thread can be started, nothing is made ahead.
    pub(crate) fn prepare(&self, transfer: &TransferFunction) {
        if !self.is_prepared(transfer) {
            let wanted = self.wanted.get_or_init(|| self.start());
            // Without a thread nobody receives it.
            let _ = wanted.send(self.foreseen(transfer));
        }
    }

    pub(crate) fn is_prepared(&self, transfer: &TransferFunction) -> bool {
        let wanted = self.foreseen(transfer);
        let kept = lock(&self.kept);
        kept.used.iter().chain(&kept.ahead).any(|made| made.wanted == wanted)
    }

    fn start(&self) -> Sender<Wanted> {
        let (send, receive) = unbounded();
        let kept = self.kept.clone();
        let run = move || make_ahead(&receive, &kept);
        if let Err(error) = std::thread::Builder::new().name("tables".into()).spawn(run) {
            tracing::warn!("no thread for transfer tables: {error}");
        }
        send
    }
}

fn make(wanted: Wanted, has_integrals: bool) -> Made {
    let table = TransferTable::new(&wanted.transfer, &wanted.encoding);
    if has_integrals {
        table.integrals();
    }
    Made { wanted, table: Arc::new(table) }
}

fn make_ahead(wanted: &Receiver<Wanted>, kept: &Mutex<Kept>) {
    while let Ok(first) = wanted.recv() {
        let newest = wanted.try_iter().last().unwrap_or(first);
        let has_integrals = lock(kept).has_integrals;
        let made = make(newest, has_integrals);
        lock(kept).ahead = Some(made);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Method, Sampling, VoxelType};
    use std::time::{Duration, Instant};

    fn function(alpha: f64) -> TransferFunction {
        TransferFunction { opacity: vec![[0.0, 0.0], [200.0, alpha]], ..TransferFunction::default() }
    }

    fn wait(tables: &Tables, transfer: &TransferFunction) {
        let begun = Instant::now();
        while !tables.is_prepared(transfer) {
            assert!(begun.elapsed() < Duration::from_secs(60), "a table takes milliseconds");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn tables_made_ahead_are_those_made_at_once_and_are_made_once() {
        let encoding = SlotEncoding::new(VoxelType::I16, (-100.0, 300.0), false);
        let tables = Tables::new(encoding);
        let layers = [SceneLayer::default(), SceneLayer::default()];
        let sampling = Sampling { method: Method::Plvs, ..Sampling::default() };
        tables.expect(layers.iter(), &Scene { sampling, ..Scene::default() });
        let encoding = |transfer: &TransferFunction| {
            encoding.for_window(Window::new(transfer, &[], Mode::default()), KeptSlots::default())
        };
        let table = |transfer: &TransferFunction| tables.table(transfer, &encoding(transfer));
        let [now, next] = [0.3, 0.6].map(function);
        let other = table(&function(0.1));
        let first = table(&now);
        assert!(Arc::ptr_eq(&other, &table(&function(0.1))), "each layer's stays");
        assert!(Arc::ptr_eq(&first, &table(&now)), "made once");
        assert!(!tables.is_prepared(&next));
        tables.prepare(&next);
        wait(&tables, &next);
        assert!(tables.is_prepared(&now), "what is shown meanwhile stays");
        let ahead = table(&next);
        assert!(Arc::ptr_eq(&ahead, &table(&next)));
        assert_eq!(*ahead, TransferTable::new(&next, &encoding(&next)));
        assert_ne!(*ahead, *first);
    }

    #[test]
    fn of_many_edits_the_newest_is_made() {
        let tables = Tables::new(SlotEncoding::new(VoxelType::U16, (0.0, 300.0), false));
        let edits: Vec<_> = (1..200).map(|i| function(i as f64 / 400.0)).collect();
        edits.iter().for_each(|edit| tables.prepare(edit));
        wait(&tables, &edits[198]);
    }
}
