//! Work on many files, done on all cores: a batch at a time, its results taken in the files' order. Costs the results of one batch.

/// Items of a batch, whose results are held until they are taken.
const BATCH: usize = 64;

/// Most threads: some wait for a network file system.
pub(crate) const MOST_THREADS: usize = 8;

/// Does `work` for each item on all cores, but at most `most_threads`, and hands each result to `take`, up to its first error.
pub(crate) fn each<T: Sync, R: Send, E>(
    items: &[T],
    most_threads: usize,
    work: impl Fn(&T) -> R + Sync,
    mut take: impl FnMut(&T, R) -> Result<(), E>,
) -> Result<(), E> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(most_threads).max(1);
    if threads == 1 {
        return items.iter().try_for_each(|item| take(item, work(item)));
    }
    let work = &work;
    for batch in items.chunks(BATCH) {
        let mut results: Vec<Option<R>> = batch.iter().map(|_| None).collect();
        let share = batch.len().div_ceil(threads);
        std::thread::scope(|scope| {
            for (items, results) in batch.chunks(share).zip(results.chunks_mut(share)) {
                scope.spawn(move || items.iter().zip(results).for_each(|(item, result)| *result = Some(work(item))));
            }
        });
        batch.iter().zip(results.into_iter().flatten()).try_for_each(|(item, result)| take(item, result))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_up_to_an_error() {
        let items: Vec<u32> = (0..1000).collect();
        for last in [0, 1, 63, 64, 65, 999, 1000] {
            let mut taken = Vec::new();
            let outcome = each(
                &items,
                MOST_THREADS,
                |n| n * 2,
                |n, twice| {
                    if *n == last {
                        return Err(*n);
                    }
                    taken.push(twice);
                    Ok(())
                },
            );
            assert_eq!(outcome.err(), Some(last).filter(|n| *n < 1000));
            assert!(taken.iter().copied().eq((0..last).map(|n| n * 2)), "{last}");
        }
        assert_eq!(each(&[0; 0], 0, |n| *n, |_, _| Err(())), Ok(()));
    }
}
