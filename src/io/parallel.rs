//! Parallel work on files, with errors that depend on no order of threads.

use crate::error::Result;
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Results of `work`, in order, or the error of the first item that has one. Items after it may be left out.
pub(crate) fn try_map<I: IndexedParallelIterator, R: Send>(
    items: I,
    work: impl Fn(I::Item) -> Result<R> + Sync,
) -> Result<Vec<R>> {
    let failed = AtomicUsize::new(usize::MAX);
    let results = items.enumerate().map(|(index, item)| {
        let is_needed = index < failed.load(Ordering::Relaxed);
        let result = is_needed.then(|| work(item));
        if let Some(Err(_)) = result {
            failed.fetch_min(index, Ordering::Relaxed);
        }
        result
    });
    let results: Vec<Option<Result<R>>> = results.collect();
    results.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;

    #[test]
    fn the_first_error_is_reported_and_order_kept() {
        let fail_from = |first: usize| {
            move |item: usize| match item < first {
                true => Ok(item),
                false => Err(Error::Unsupported { what: item.to_string() }),
            }
        };
        assert_eq!(
            try_map((0..100).into_par_iter(), fail_from(100)).unwrap(),
            (0..100).collect::<Vec<_>>()
        );
        for _ in 0..100 {
            let error = try_map((0..100).into_par_iter(), fail_from(37)).unwrap_err();
            assert!(error.to_string().ends_with("37"), "{error}");
        }
    }
}
