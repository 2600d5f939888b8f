//! A token by which a computation is stopped from outside: long loops look at it.
//!
//! ```
//! use mirror_core::Cancel;
//!
//! let token = Cancel::new();
//! assert!(token.check().is_ok());
//! token.clone().cancel();
//! assert!(token.check().is_err());
//! ```

use crate::error::{Error, Result};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Whether a computation must stop. Clones are the same token; a check costs about a nanosecond.
///
/// The default one is never cancelled. Loops call [`Cancel::check`] where they can return an error, at least every
/// few milliseconds, and [`Cancel::is_cancelled`] where they can only stop early: the code that reads their result
/// calls `check` first.
#[derive(Debug, Clone, Default)]
pub struct Cancel(Option<Arc<State>>);

#[derive(Debug, Default)]
struct State {
    asked: AtomicBool,
    deadline: Option<Instant>,
}

/// Whether both are the same token; two that are never cancelled are.
impl PartialEq for Cancel {
    fn eq(&self, other: &Self) -> bool {
        match (&self.0, &other.0) {
            (Some(one), Some(two)) => Arc::ptr_eq(one, two),
            (None, None) => true,
            _ => false,
        }
    }
}

impl Cancel {
    /// A token that is not cancelled until [`Cancel::cancel`] is called.
    #[must_use]
    pub fn new() -> Self {
        Self(Some(Arc::default()))
    }

    /// A token that also cancels itself after a time.
    #[must_use]
    pub fn after(time: Duration) -> Self {
        Self(Some(Arc::new(State {
            asked: AtomicBool::new(false),
            deadline: Instant::now().checked_add(time),
        })))
    }

    /// Requests all computations with a clone to stop; no effect on a token that is never cancelled.
    pub fn cancel(&self) {
        if let Some(state) = &self.0 {
            state.asked.store(true, Ordering::Relaxed);
        }
    }

    /// Whether it was cancelled, or its time is over.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.0.as_ref().is_some_and(|state| {
            state.asked.load(Ordering::Relaxed) || state.deadline.is_some_and(|end| Instant::now() >= end)
        })
    }

    /// An error where it was cancelled.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    pub fn check(&self) -> Result<()> {
        if self.is_cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clone_is_the_same_token() {
        let token = Cancel::new();
        let other = token.clone();
        assert_eq!(other.check(), Ok(()));
        std::thread::spawn(move || token.cancel()).join().ok();
        assert_eq!(other.check(), Err(Error::Cancelled));
    }

    #[test]
    fn the_default_is_never_cancelled() {
        let token = Cancel::default();
        token.cancel();
        assert!(!token.is_cancelled());
    }

    #[test]
    fn a_deadline_cancels() {
        assert!(Cancel::after(Duration::ZERO).is_cancelled());
        assert!(!Cancel::after(Duration::from_secs(3600)).is_cancelled());
        // A time outside the clock's range is no deadline.
        assert!(!Cancel::after(Duration::MAX).is_cancelled());
    }
}
