//! How captures are made: two robot arms, one with a camera and one with a point light, or a virtual rig in their place.
//!
//! A session goes one way: a [`trajectory`] of waypoints on equal-area cells, [`kinematics`] that says which joints
//! reach them, [`robot`]s that go there, a [`camera`] that shoots, a [`calibration`] that says where everything was,
//! and a [`session`] that keeps the journal and ends in a scene folder. The [`virtual_rig`] stands in for arms, lamp and
//! camera through the very same code.
//!
//! World: metres, right-handed, +Z up. Poses are to-world; camera axes as OpenCV's. Angles in radians. All in f64.

pub mod calibration;
pub mod camera;
pub mod kinematics;
pub mod rig;
pub mod robot;
pub mod session;
pub mod trajectory;
pub mod virtual_rig;
