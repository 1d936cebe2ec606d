//! The grammar of hostile zips: an honest one of some shape, with one to three faults.

use relight_server::submission::Limits;

use super::faults::{FAULTS, Fault};
use super::zip_writer::{Entry, Zip};

/// Counter-based random numbers, so that a case can be made again from its seed.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub fn one<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len())]
    }

    pub fn bytes(&mut self, n: usize) -> Vec<u8> {
        (0..n).map(|_| self.next() as u8).collect()
    }
}

/// A zip on its way to being hostile.
pub struct Case {
    pub zip: Zip,
    pub limits: Limits,
    /// The written zip is replaced by these bytes.
    pub instead: Option<Vec<u8>>,
    /// Of the written zip so many thousandths are kept.
    pub kept: Option<usize>,
}

impl Case {
    /// A zip that an honest program could have written, of some shape.
    pub fn honest(answers: &[(String, Vec<u8>)], random: &mut Random) -> Case {
        let descriptor = random.one(&[None, None, Some(true), Some(false)]);
        let zip64 = random.below(4) == 0;
        let deflated = random.below(3);
        let entries = answers.iter().map(|(name, bytes)| Entry {
            zip64,
            descriptor,
            ..Entry::new(name, bytes, if deflated == 2 { random.below(2) == 0 } else { deflated == 1 })
        });
        let entries = entries.collect();
        let zip = Zip { entries, zip64: random.below(4) == 0, ..Zip::default() };
        Case { zip, limits: Limits::default(), instead: None, kept: None }
    }

    /// One with one to three faults, and which these are. No fault takes another away.
    pub fn hostile(answers: &[(String, Vec<u8>)], random: &mut Random) -> (Case, Vec<&'static Fault>) {
        let mut case = Case::honest(answers, random);
        let mut applied = Vec::new();
        for _ in 0..=random.below(3) {
            let fault = &FAULTS[random.below(FAULTS.len())];
            if case.zip.entries.iter().filter(|entry| !entry.spoilt).count() > 2 {
                (fault.apply)(&mut case, random);
                applied.push(fault);
            }
        }
        (case, applied)
    }

    /// The bytes of the file.
    pub fn written(&self) -> Vec<u8> {
        let Some(thousandths) = self.kept else {
            return self.instead.clone().unwrap_or_else(|| self.zip.write());
        };
        // What follows the zip does not count: without it the zip may be whole.
        let zip = Zip { trailing: Vec::new(), ..self.zip.clone() };
        let mut bytes = self.instead.clone().unwrap_or_else(|| zip.write());
        bytes.truncate(bytes.len() * thousandths / 1000);
        bytes
    }
}
