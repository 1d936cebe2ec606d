//! Somebody at the terminal, who is asked to do what a rig cannot.

use std::io::{IsTerminal, stdin};

use relight_capture::session::{RigFault, Target};

/// Has something held before the camera.
pub fn show(target: Target) -> Result<(), RigFault> {
    let task = match target {
        Target::Dark => "cap the lens, or put the lamp out and darken the room".to_owned(),
        Target::Flat => {
            "hold an evenly lit, matt, white card before the lens, out of focus if it can be".to_owned()
        }
        Target::Card([x, y, z]) => {
            format!(
                "lay a matt grey card flat in the scene's place, its middle at {x} {y} {z} m, and light the lamp"
            )
        }
        Target::Scene => {
            "put the scene in its place, with nothing before the camera, and light the lamp".to_owned()
        }
    };
    if !stdin().is_terminal() {
        return Err(RigFault::Nobody(task));
    }
    eprintln!("{task}; press Enter when it is done");
    match stdin().read_line(&mut String::new()) {
        Ok(read) if read > 0 => Ok(()),
        // The end of the input: somebody has gone.
        _ => Err(RigFault::Nobody(task)),
    }
}
