//! RTDE of a simulated UR controller.

use std::io;
use std::time::{Duration, Instant};

use super::super::ur::rtde::{self, Reader, Value, kind};
use super::arm::Snapshot;
use super::server::Wire;
use super::ur_outputs::{input_type, output};

/// Version of the controller's software: major, minor, bugfix, build.
pub(super) const VERSION: [u32; 4] = [5, 12, 6, 1_102_099];
/// Fastest stream, Hz.
const FASTEST: f64 = 500.0;
/// Recipe of the outputs; there is one at a time.
const RECIPE: u8 = 1;

/// What a client has set up.
#[derive(Debug, Default)]
struct Session {
    names: Vec<String>,
    period: Duration,
    inputs: u8,
    /// When the next state is due; `None` while the stream stands.
    due: Option<Instant>,
}

pub(super) fn serve_rtde(wire: &mut Wire) -> io::Result<()> {
    let mut session = Session::default();
    loop {
        let now = Instant::now();
        wire.receive(session.due.map_or(Duration::MAX, |due| due.saturating_duration_since(now)))?;
        while let Some(frame) = wire.take(rtde::frame_length)? {
            let snapshot = wire.arm().snapshot();
            if let Some(answer) = session.answer(&frame, &snapshot) {
                wire.send(&answer)?;
            }
        }
        let now = Instant::now();
        if let Some(due) = session.due
            && now >= due
        {
            // A client that was away for long is not sent all that it missed.
            let next = due + session.period;
            session.due = Some(if next + Duration::from_millis(200) < now { now } else { next });
            let snapshot = wire.arm().snapshot();
            if let Some(state) = session.state(&snapshot) {
                wire.send(&state)?;
            }
        }
    }
}

impl Session {
    /// The answer to a frame, if it has one.
    fn answer(&mut self, frame: &[u8], snapshot: &Snapshot) -> Option<Vec<u8>> {
        let (kind, payload) = rtde::parts(frame)?;
        let yes_or_no = |yes: bool| rtde::frame(kind, &[u8::from(yes)]);
        match kind {
            kind::VERSION => yes_or_no(payload == 2u16.to_be_bytes()),
            kind::CONTROLLER_VERSION => {
                rtde::frame(kind, &VERSION.iter().flat_map(|v| v.to_be_bytes()).collect::<Vec<_>>())
            }
            kind::OUTPUTS => self.set_outputs(payload, snapshot),
            kind::INPUTS => {
                let types =
                    names(payload).map(|name| input_type(name).unwrap_or("NOT_FOUND")).collect::<Vec<_>>();
                self.inputs = self.inputs.wrapping_add(1).max(1);
                let recipe = if types.contains(&"NOT_FOUND") { 0 } else { self.inputs };
                rtde::frame(kind, &[&[recipe], types.join(",").as_bytes()].concat())
            }
            kind::START => {
                let can = self.state(snapshot).is_some();
                self.due = can.then(Instant::now);
                yes_or_no(can)
            }
            kind::PAUSE => {
                self.due = None;
                yes_or_no(true)
            }
            // Values of inputs and text need no answer, and change nothing that is simulated.
            _ => None,
        }
    }

    fn set_outputs(&mut self, payload: &[u8], snapshot: &Snapshot) -> Option<Vec<u8>> {
        let mut reader = Reader(payload);
        let frequency = reader.f64()?;
        let frequency = if frequency > 0.0 { frequency.clamp(1.0, FASTEST) } else { FASTEST };
        let wanted: Vec<&str> = names(reader.0).collect();
        let types: Vec<&str> = wanted
            .iter()
            .map(|name| output(name, snapshot).map_or("NOT_FOUND", |value| value.type_name()))
            .collect();
        let is_good = !types.contains(&"NOT_FOUND");
        self.due = None;
        self.period = Duration::from_secs_f64(1.0 / frequency);
        self.names =
            if is_good { wanted.iter().map(|name| (*name).to_owned()).collect() } else { Vec::new() };
        let recipe = if is_good { RECIPE } else { 0 };
        rtde::frame(kind::OUTPUTS, &[&[recipe], types.join(",").as_bytes()].concat())
    }

    /// The state in a frame; `None` without outputs, or with more than a frame holds.
    fn state(&self, snapshot: &Snapshot) -> Option<Vec<u8>> {
        if self.names.is_empty() {
            return None;
        }
        let mut payload = vec![RECIPE];
        for name in &self.names {
            output(name, snapshot).unwrap_or(Value::Byte(0)).pack(&mut payload);
        }
        rtde::frame(kind::DATA, &payload)
    }
}

/// The names in a list. A client in the field ends its list with a comma, so that empty names are none.
fn names(list: &[u8]) -> impl Iterator<Item = &str> {
    list.split(|b| *b == b',')
        .map(|name| std::str::from_utf8(name).unwrap_or("?").trim())
        .filter(|name| !name.is_empty())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::golden;
    use super::super::arm::SimulatedArm;
    use super::super::{SimulatedModel, SimulationSettings};
    use super::*;

    fn snapshot() -> Snapshot {
        let settings = SimulationSettings { joints: Some(golden::joints()), ..SimulationSettings::default() };
        let snapshot = SimulatedArm::new(&SimulatedModel::UR5E, &settings).snapshot();
        Snapshot { time: 1.5, is_running: true, ..snapshot }
    }

    #[test]
    fn urs_own_client_is_answered_with_the_bytes_it_accepts() {
        let (requests, answers) = (golden::ur_requests(), golden::ur_answers());
        let mut session = Session::default();
        assert_eq!(session.answer(&requests["S"], &snapshot()).unwrap()[3], 0, "no start without outputs");
        for kind in ["V", "v", "I", "O", "S", "P"] {
            let answer = session.answer(&requests[kind], &snapshot()).unwrap();
            let expected = rtde::frame(kind.as_bytes()[0], &answers[kind]).unwrap();
            assert_eq!(answer, expected, "{kind}");
        }
        assert_eq!(session.state(&snapshot()).unwrap(), golden::ur_state());
    }

    #[test]
    fn empty_names_are_none_and_unknown_ones_are_not_found() {
        let mut session = Session::default();
        let mut ask = |list: &str| {
            let payload = [&125f64.to_be_bytes(), list.as_bytes()].concat();
            let answer = session.answer(&rtde::frame(kind::OUTPUTS, &payload).unwrap(), &snapshot()).unwrap();
            (answer[3], String::from_utf8(answer[4..].to_vec()).unwrap())
        };
        assert_eq!(ask("actual_q,timestamp,"), (1, "VECTOR6D,DOUBLE".to_owned()));
        assert_eq!(ask("actual_q,happiness"), (0, "VECTOR6D,NOT_FOUND".to_owned()));
        assert_eq!(ask(""), (1, String::new()));
        let names = (0..48).map(|i| format!("output_double_register_{i}")).collect::<Vec<_>>().join(",");
        assert!(!ask(&names).1.contains("NOT_FOUND"));
        assert!(ask("output_double_register_48").1.contains("NOT_FOUND"));
    }

    #[test]
    fn more_outputs_than_a_frame_holds_do_not_start() {
        let mut session = Session::default();
        let payload = [&125f64.to_be_bytes(), "actual_q,".repeat(2000).as_bytes()].concat();
        session.answer(&rtde::frame(kind::OUTPUTS, &payload).unwrap(), &snapshot());
        assert_eq!(session.answer(&rtde::frame(kind::START, &[]).unwrap(), &snapshot()).unwrap()[3], 0);
        assert!(session.due.is_none());
    }

    proptest! {
        #[test]
        fn no_frame_makes_it_panic(kind in prop::sample::select(b"VvMUOISPx".to_vec()), payload in prop::collection::vec(any::<u8>(), 0..60)) {
            let mut session = Session::default();
            session.answer(&rtde::frame(kind, &payload).unwrap(), &snapshot());
            session.state(&snapshot());
        }
    }
}
