//! Work off Python's lock: on this process's own threads, and stopped by Ctrl-C.

use mirror_core::Cancel;
use pyo3::marker::Ungil;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// How often signals are looked at while the core works.
const POLL: Duration = Duration::from_millis(40);
/// Batches of fewer rows are done in a hundredth of a second, before a thread that looks at signals would pay.
const SHORT: usize = 256;

/// The threads, and the process that they belong to: a forked child has the memory of its parent's threads, and would
/// wait for them forever.
static POOL: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// This process's threads; none where the system gives none, and then one thread works. Called with Python's lock held, so
/// that no fork of Python's comes in between.
fn pool() -> Option<Arc<ThreadPool>> {
    let mut held = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((of, pool)) = held.as_ref()
        && *of == process
    {
        return Some(Arc::clone(pool));
    }
    let pool = Arc::new(ThreadPoolBuilder::new().build().ok()?);
    if let Some(of_parent) = held.replace((process, Arc::clone(&pool))) {
        // Dropping it would speak to threads that are not there.
        core::mem::forget(of_parent);
    }
    Some(pool)
}

/// Runs the core's work while Python goes on.
pub trait Work {
    /// As `Python::detach`, on the threads of this process: work that may share itself out must not use another pool.
    fn work<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(self, work: F) -> T;
    /// As [`Work::work`]; a signal whose Python handler raises (Ctrl-C) cancels the token, and its exception is what comes back.
    fn work_until<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(
        self,
        cancel: &Cancel,
        work: F,
    ) -> PyResult<T>;
    /// As [`Work::work_until`], for a batch of so many rows of microseconds each: a short one is not looked after.
    fn work_on<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(
        self,
        rows: usize,
        cancel: &Cancel,
        work: F,
    ) -> PyResult<T>;
}

impl Work for Python<'_> {
    fn work<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(self, work: F) -> T {
        match pool() {
            Some(pool) => self.detach(|| pool.install(work)),
            None => self.detach(work),
        }
    }

    fn work_until<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(
        self,
        cancel: &Cancel,
        work: F,
    ) -> PyResult<T> {
        let pool = pool();
        self.detach(|| {
            std::thread::scope(|scope| {
                let (done, told) = channel::<()>();
                let worker = scope.spawn(move || {
                    let result = match &pool {
                        Some(pool) => pool.install(work),
                        None => work(),
                    };
                    // Dropped at the end, and on a panic too: the loop below ends with it.
                    drop(done);
                    result
                });
                let mut raised = None;
                while told.recv_timeout(POLL) == Err(RecvTimeoutError::Timeout) {
                    if raised.is_none()
                        && let Err(error) = Python::attach(|py| py.check_signals())
                    {
                        cancel.cancel();
                        raised = Some(error);
                    }
                }
                let result = worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                raised.map_or(Ok(result), Err)
            })
        })
    }

    fn work_on<T: Send + Ungil, F: FnOnce() -> T + Send + Ungil>(
        self,
        rows: usize,
        cancel: &Cancel,
        work: F,
    ) -> PyResult<T> {
        if rows < SHORT { Ok(self.work(work)) } else { self.work_until(cancel, work) }
    }
}
