//! Threads for slow answers to quick questions: only the newest question deserves an answer.

use std::sync::mpsc::{Sender, channel};

/// Starts a thread that answers the newest question whenever it is free. It ends with the last sender.
pub(crate) fn answering<Q: Send + 'static>(mut answer: impl FnMut(Q) + Send + 'static) -> Sender<Q> {
    let (ask, questions) = channel::<Q>();
    std::thread::spawn(move || {
        while let Ok(question) = questions.recv() {
            answer(questions.try_iter().last().unwrap_or(question));
        }
    });
    ask
}
