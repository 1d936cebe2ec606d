//! Numbers for vectors to read.

use std::ops::{Deref, DerefMut};

/// Numbers of a cache line.
const LINE: usize = 64 / size_of::<f32>();

/// Numbers whose first begins a cache line: a vector that lies across two lines takes two reads.
#[derive(Default)]
pub struct Aligned {
    numbers: Vec<f32>,
    first: usize,
    length: usize,
}

impl Aligned {
    /// So many zeros.
    pub fn zeros(length: usize) -> Self {
        let mut zeros = Self::default();
        zeros.resize(length);
        zeros
    }

    /// Makes room for `length` numbers, whatever they are.
    pub fn resize(&mut self, length: usize) {
        self.numbers.resize(self.numbers.len().max(length + LINE - 1), 0.0);
        // Where that cannot be told, reading is slower and no worse.
        self.first = self.numbers.as_ptr().align_offset(64).min(LINE - 1);
        self.length = length;
    }
}

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.numbers[self.first..self.first + self.length]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.numbers[self.first..self.first + self.length]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_begin_a_cache_line() {
        let mut aligned = Aligned::default();
        for length in [0, 1, 64 * 192, 3, 16 * 192] {
            aligned.resize(length);
            assert_eq!(aligned.len(), length);
            assert_eq!(aligned.as_ptr() as usize % 64, 0);
            aligned.fill(1.0);
        }
    }
}
