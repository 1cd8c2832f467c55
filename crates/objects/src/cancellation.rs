//! Cancelling of requests that nobody waits for any more: those of one thread, made while it works under a [`Cancellation`].
//!
//! Costs a look at a lock whenever a request under it goes on.

use std::cell::RefCell;
use std::future::{Future, poll_fn};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Poll, Waker};

thread_local! {
    static CURRENT: RefCell<Option<Cancellation>> = const { RefCell::new(None) };
}

/// The right to cancel one thread's requests. A clone is the same right; so is equal to it.
#[derive(Clone, Debug, Default)]
pub struct Cancellation {
    state: Arc<Mutex<State>>,
}

#[derive(Debug, Default)]
struct State {
    is_cancelled: bool,
    /// Wakes the thread that waits for a request.
    waker: Option<Waker>,
}

impl PartialEq for Cancellation {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.state, &other.state)
    }
}

impl Cancellation {
    /// Does some work of this thread, whose requests fail with [`Fault::Cancelled`](crate::Fault::Cancelled) from the cancelling on.
    pub fn during<T>(&self, work: impl FnOnce() -> T) -> T {
        /// Sets the former one again, after a panic too.
        struct Former(Option<Cancellation>);
        impl Drop for Former {
            fn drop(&mut self) {
                let former = self.0.take();
                CURRENT.with(|current| *current.borrow_mut() = former);
            }
        }
        let _former = Former(CURRENT.with(|current| current.borrow_mut().replace(self.clone())));
        work()
    }

    /// Cancels the requests under way, and those to come.
    pub fn cancel(&self) {
        let mut state = self.lock();
        state.is_cancelled = true;
        if let Some(waker) = state.waker.take() {
            waker.wake();
        }
    }

    /// Whether it is cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.lock().is_cancelled
    }

    /// The one under which this thread works.
    #[cfg_attr(not(feature = "remote"), expect(dead_code, reason = "without requests nothing is cancelled"))]
    pub(crate) fn current() -> Option<Self> {
        CURRENT.with(|current| current.borrow().clone())
    }

    /// Waits until it is cancelled, in one place at a time.
    #[cfg_attr(not(feature = "remote"), expect(dead_code, reason = "without requests nothing is cancelled"))]
    pub(crate) fn cancelled(&self) -> impl Future<Output = ()> {
        poll_fn(|context| {
            let mut state = self.lock();
            if state.is_cancelled {
                return Poll::Ready(());
            }
            state.waker = Some(context.waker().clone());
            Poll::Pending
        })
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
