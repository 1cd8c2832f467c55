//! Common code of the benchmark programs: a clock for wall and processor time, interleaved repetitions, medians, tables.
//!
//! Machines are rarely quiet. So the cases of a benchmark run in turn, repetition by repetition, and are compared within
//! each repetition; the output is medians. Processor time separates work from waiting and from other programs.

pub mod bare;
pub mod boxes;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Wall and processor time of a piece of work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// From start to end, seconds.
    pub wall_s: f64,
    /// Processor time of all threads of this process, user and system, seconds.
    pub cpu_s: f64,
}

/// Runs `work` once and times it.
pub fn time<R>(work: impl FnOnce() -> R) -> (Timing, R) {
    let (wall, cpu) = (Instant::now(), cpu_seconds());
    let result = work();
    (Timing { wall_s: wall.elapsed().as_secs_f64(), cpu_s: cpu_seconds() - cpu }, result)
}

/// Processor time used so far by this process, in seconds.
fn cpu_seconds() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// The median; for an even number of values, the mean of the two middle ones.
///
/// # Panics
/// If there are no values.
pub fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let n = values.len();
    (values[(n - 1) / 2] + values[n / 2]) / 2.0
}

/// Distributes the numbers below `count`, in order, to `threads` workers, each created by `make` on its own thread.
///
/// # Errors
/// The first failure; later numbers may be left undone.
pub fn in_parallel<W, E>(threads: usize, count: usize, make: impl Fn() -> W + Sync) -> Result<(), E>
where
    W: FnMut(usize) -> Result<(), E>,
    E: Send,
{
    let next = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut work = make();
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count {
                        return;
                    }
                    if let Err(error) = work(i) {
                        next.store(count, Ordering::Relaxed);
                        failure.lock().expect("nobody panics under the lock").get_or_insert(error);
                    }
                }
            });
        }
    });
    failure.into_inner().expect("nobody panics under the lock").map_or(Ok(()), Err)
}

/// Formats a Markdown table.
pub fn markdown(head: &[&str], rows: &[Vec<String>]) -> String {
    let line = |cells: &mut dyn Iterator<Item = &str>| format!("| {} |\n", cells.collect::<Vec<_>>().join(" | "));
    let mut table = line(&mut head.iter().copied());
    table += &line(&mut head.iter().map(|_| "---"));
    rows.iter().for_each(|row| table += &line(&mut row.iter().map(String::as_str)));
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_are_the_middle() {
        assert_eq!(median([3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), 2.5);
    }

    #[test]
    fn every_number_is_worked_on_once_and_failures_come_back() {
        let seen = Mutex::new(vec![0; 1000]);
        let work = || {
            |i: usize| {
                seen.lock().unwrap()[i] += 1;
                Ok::<_, usize>(())
            }
        };
        assert_eq!(in_parallel(3, 1000, work), Ok(()));
        assert!(seen.into_inner().unwrap().iter().all(|&n| n == 1));
        assert_eq!(in_parallel(2, 1000, || |i| if i == 7 { Err(i) } else { Ok(()) }), Err(7));
    }

    #[test]
    fn processor_time_counts_all_threads() {
        let spin = || {
            let start = Instant::now();
            let mut x = 1u64;
            while start.elapsed().as_millis() < 40 {
                (0..1000).for_each(|i| x = std::hint::black_box(x.wrapping_mul(i | 1)));
            }
            Ok::<_, ()>(())
        };
        let (timing, _) = time(|| in_parallel(1, 1, || |_| spin()));
        // On a busy machine the thread may get only a small part of the 40 ms.
        assert!(timing.wall_s >= 0.04 && timing.cpu_s > 0.001, "{timing:?}");
    }

    #[test]
    fn tables_are_markdown() {
        assert_eq!(markdown(&["a", "b"], &[vec!["1".into(), "2".into()]]), "| a | b |\n| --- | --- |\n| 1 | 2 |\n");
    }
}
