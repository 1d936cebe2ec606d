//! How the matrix of a camera's pose might have been meant, and how to mend one that was meant otherwise.

use crate::pose::Pose;
use crate::scene::Layout;

/// Which way a matrix goes, and which axes its camera has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Reading {
    /// World-to-camera, and not camera-to-world.
    inverted: bool,
    /// OpenGL's axes, and not OpenCV's.
    opengl: bool,
}

impl Reading {
    /// What the files of a layout hold.
    pub(crate) fn of(layout: Layout) -> Reading {
        Reading { inverted: false, opengl: layout == Layout::Transforms }
    }

    /// All other readings; the first differs in nothing but the axes.
    pub(crate) fn others(self) -> [Reading; 3] {
        [(false, true), (true, false), (true, true)]
            .map(|(way, axes)| Reading { inverted: self.inverted != way, opengl: self.opengl != axes })
    }

    /// The pose, to-world and of OpenCV's axes, that a matrix states.
    pub(crate) fn pose(self, matrix: &Pose) -> Pose {
        let to_world = if self.inverted { matrix.inverse() } else { *matrix };
        if self.opengl { to_world.flip_camera_axes() } else { to_world }
    }

    /// The matrix that states a pose.
    pub(crate) fn matrix(self, pose: &Pose) -> Pose {
        let to_world = if self.opengl { pose.flip_camera_axes() } else { *pose };
        if self.inverted { to_world.inverse() } else { to_world }
    }

    fn axes(self) -> &'static str {
        if self.opengl {
            "OpenGL's axes (+X right, +Y up, looking along -Z)"
        } else {
            "OpenCV's axes (+X right, +Y down, +Z forward)"
        }
    }

    fn way(self) -> &'static str {
        if self.inverted { "world-to-camera" } else { "camera-to-world" }
    }

    /// What a matrix should be, to begin a mend with.
    pub(crate) fn rule(self) -> String {
        format!("Camera poses are {} matrices in metres, of {}", self.way(), self.axes())
    }

    /// What matrices seem to be that must be read so where `right` is meant.
    pub(crate) fn unlike(self, right: Reading) -> String {
        match (self.inverted != right.inverted, self.opengl != right.opengl) {
            (true, false) => self.way().to_owned(),
            (false, _) => format!("of {}", self.axes()),
            (true, true) => format!("{} of {}", self.way(), self.axes()),
        }
    }

    /// What makes such a matrix one of `right`.
    pub(crate) fn mend(self, right: Reading) -> &'static str {
        match (self.inverted != right.inverted, self.opengl != right.opengl) {
            (true, false) => "invert it",
            (false, _) => "negate its second and third column",
            (true, true) => "invert it, then negate its second and third column",
        }
    }
}
