//! Memory that threads borrow and give back, so that the large arrays of a step are allocated once.

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_made_only_while_none_is_idle() {
        let pool = Pool::default();
        let mut made = 0;
        // Two at once, then one again: the third borrows what the others gave back.
        let outer = pool.with(|| 1, |a| pool.with(|| 2, |b| [*a, *b]));
        assert_eq!(outer, [1, 2]);
        pool.with(
            || {
                made += 1;
                3
            },
            |value| assert!([1, 2].contains(value)),
        );
        assert_eq!(made, 0);
    }
}
