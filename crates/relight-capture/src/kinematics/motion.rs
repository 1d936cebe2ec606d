//! Whether a motion keeps its distance all the way.

use super::{Cell, Contact, Joints, LimitFault};

/// Parts that come this near to the clearance count as meeting, metres: advancing ever smaller steps towards it would not
/// end.
const TOUCH: f64 = 1e-4;

/// What is in the way of a motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Obstruction {
    /// An end of the motion lies outside a joint's range.
    #[error("the {arm}'s {fault}")]
    Limit {
        /// The arm's name.
        arm: String,
        /// Which joint.
        fault: LimitFault,
    },
    /// Two parts meet, or come nearer than the cell's clearance.
    #[error("{contact}, {:.0} % along the motion", .fraction * 100.0)]
    Contact {
        /// The parts that are nearest to each other there, and their distance.
        contact: Contact,
        /// How far along the motion, 0 to 1.
        fraction: f64,
    },
}

impl<const ARMS: usize> Cell<ARMS> {
    /// Whether the arms can stand there.
    ///
    /// # Errors
    /// What is in the way.
    pub fn check(&self, joints: &[Joints; ARMS]) -> Result<(), Obstruction> {
        self.check_motion(joints, joints)
    }

    /// Whether the arms can go from one configuration to another, all joints together at even speed (the `movej` of
    /// controllers).
    ///
    /// Conservative advancement: from what the distance of a pair is here, and from the most that each joint moves any
    /// point of it, follows how far ahead it cannot meet; there it is looked at again. Nothing between is missed.
    ///
    /// # Errors
    /// The first that is in the way.
    pub fn check_motion(&self, from: &[Joints; ARMS], to: &[Joints; ARMS]) -> Result<(), Obstruction> {
        for (i, arm) in self.arms().iter().enumerate() {
            for joints in [from[i], to[i]] {
                let limit = |fault| Obstruction::Limit { arm: arm.name.clone(), fault };
                arm.model.limits.check(&joints).map_err(limit)?;
            }
        }
        let step = std::array::from_fn(|i| std::array::from_fn(|j| to[i][j] - from[i][j]));
        let travels: Vec<f64> = self.pairs.iter().map(|pair| self.travel(pair, &step)).collect();
        let mut safe_until = vec![0.0; self.pairs.len()];
        let mut fraction = 0.0;
        loop {
            let here = std::array::from_fn(|i| std::array::from_fn(|j| from[i][j] + fraction * step[i][j]));
            let posed = self.posed(&here);
            let mut next = f64::INFINITY;
            for ((pair, travel), safe) in self.pairs.iter().zip(&travels).zip(&mut safe_until) {
                if *safe <= fraction {
                    let distance = self.distance(pair, &posed);
                    let spare = distance - self.clearance();
                    if spare < TOUCH {
                        let contact = self.closest(&here).unwrap_or_else(|| self.contact(pair, distance));
                        return Err(Obstruction::Contact { contact, fraction });
                    }
                    *safe = fraction + spare / travel;
                }
                next = next.min(*safe);
            }
            if fraction >= 1.0 || next > 1.0 {
                return Ok(());
            }
            fraction = next;
        }
    }
}
