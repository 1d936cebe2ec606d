//! Memory that threads borrow and give back, so that nothing is allocated in the training loop.

use std::sync::{Mutex, PoisonError};

/// A stack of idle values; one is made where none is idle.
pub struct Pool<T> {
    idle: Mutex<Vec<T>>,
}

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self { idle: Mutex::new(Vec::new()) }
    }
}

impl<T> Pool<T> {
    /// Runs `work` with a borrowed value.
    pub fn with<R>(&self, make: impl FnOnce() -> T, work: impl FnOnce(&mut T) -> R) -> R {
        let idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let mut value = idle.unwrap_or_else(make);
        let result = work(&mut value);
        self.idle.lock().unwrap_or_else(PoisonError::into_inner).push(value);
        result
    }
}
