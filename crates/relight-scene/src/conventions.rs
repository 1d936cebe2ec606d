//! Whether poses follow the conventions that they should.

use crate::error::Faults;
use crate::scene::Scene;

pub(crate) fn check(_scene: &Scene, _faults: &mut Faults) {}
