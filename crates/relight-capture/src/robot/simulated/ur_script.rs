//! The secondary and the real-time interface of a simulated UR controller, as far as they take scripts.

use std::io;

use super::arm::Step;
use super::server::Wire;

/// Longest program, bytes.
const LONGEST: usize = 1 << 16;
/// What `movej` does when told nothing: rad/s and rad/s^2; and what `stopj` does, rad/s^2.
const SPEED: f64 = 1.05;
const ACCELERATION: f64 = 1.4;
const DECELERATION: f64 = 2.0;

/// A program that is understood.
#[derive(Clone, Debug, PartialEq)]
struct Program {
    steps: Vec<Step>,
    /// Stop first, with this deceleration.
    stop: Option<f64>,
}

pub(super) fn serve(wire: &mut Wire) -> io::Result<()> {
    let mut program = String::new();
    loop {
        let line = wire.line()?;
        if program.is_empty() && line.trim().is_empty() {
            continue;
        }
        program.push_str(&line);
        program.push('\n');
        if program.len() > LONGEST {
            return Err(io::ErrorKind::InvalidData.into());
        }
        // A program is one line, or begins with `def` and goes on to an `end` at its margin.
        let is_whole = !program.trim_start().starts_with("def ") || line == "end";
        if !is_whole {
            continue;
        }
        // What is not understood is not run; a real controller would say so on its screen.
        if let Some(Program { steps, stop }) = parse(&program) {
            let mut arm = wire.arm();
            match stop {
                Some(deceleration) if arm.snapshot().is_remote => arm.halt(deceleration),
                Some(_) => {}
                None => {
                    let _ = arm.run(steps);
                }
            }
        }
        program.clear();
    }
}

/// Reads a program of `movej`, `stopj`, `sleep` and `textmsg`, with or without a `def` around; `None` if there is anything
/// else in it, or a `stopj` beside a motion.
fn parse(program: &str) -> Option<Program> {
    let mut parsed = Program { steps: Vec::new(), stop: None };
    for line in program.lines() {
        let line = line.split('#').next().unwrap_or_default().trim();
        let is_frame =
            line.is_empty() || line == "end" || (line.starts_with("def ") && line.ends_with("():"));
        if is_frame {
            continue;
        }
        let (name, arguments) = line.strip_suffix(')')?.split_once('(')?;
        match name.trim() {
            "movej" => parsed.steps.push(movej(arguments)?),
            "sleep" => parsed.steps.push(Step::Wait(number(arguments)?)),
            "stopj" => {
                let given = arguments.strip_prefix("a=").unwrap_or(arguments);
                parsed.stop = Some(if given.trim().is_empty() { DECELERATION } else { number(given)? });
            }
            "textmsg" => {}
            _ => return None,
        }
    }
    (parsed.stop.is_none() || parsed.steps.is_empty()).then_some(parsed)
}

/// `[q1, …, q6], a, v, t, r`, the last four by name or in order; time and blend radius only as zero.
fn movej(arguments: &str) -> Option<Step> {
    let (joints, rest) = arguments.trim().strip_prefix('[')?.split_once(']')?;
    let joints = joints.split(',').map(number).collect::<Option<Vec<_>>>()?;
    let mut values = [ACCELERATION, SPEED, 0.0, 0.0];
    let given = rest.split(',').skip(1).enumerate();
    for (position, argument) in given {
        let (index, value) = match argument.split_once('=') {
            Some((name, value)) => {
                (["a", "v", "t", "r"].iter().position(|known| *known == name.trim())?, value)
            }
            None => (position, argument),
        };
        *values.get_mut(index)? = number(value)?;
    }
    let [acceleration, speed, time, blend] = values;
    let is_plain =
        time == 0.0 && blend == 0.0 && (rest.trim().is_empty() || rest.trim_start().starts_with(','));
    is_plain.then_some(Step::Move { target: joints.try_into().ok()?, speed, acceleration })
}

fn number(words: &str) -> Option<f64> {
    words.trim().parse().ok().filter(|v: &f64| v.is_finite())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn to(q: f64, speed: f64, acceleration: f64) -> Step {
        Step::Move { target: [q; 6], speed, acceleration }
    }

    #[test]
    fn programs_are_read_as_they_are_written() {
        let program = "def f():\n  textmsg(\"hi\")\n  movej([1,1,1, 1,1,1], a=0.5, v=0.25)\n  sleep(0.5)\n  \
                       movej([2,2,2,2,2,2], 0.7) # back\nend\n";
        let steps = vec![to(1.0, 0.25, 0.5), Step::Wait(0.5), to(2.0, SPEED, 0.7)];
        assert_eq!(parse(program), Some(Program { steps, stop: None }));
        assert_eq!(parse("stopj(3)"), Some(Program { steps: Vec::new(), stop: Some(3.0) }));
        assert_eq!(parse("movej([0,0,0,0,0,0])").unwrap().steps, [to(0.0, SPEED, ACCELERATION)]);
    }

    #[test]
    fn what_is_not_understood_is_not_run() {
        for program in [
            "movej([1,2,3])",
            "movej(p[1,2,3,4,5,6])",
            "movej([0,0,0,0,0,0], t=3)",
            "movej([0,0,0,0,0,0], r=0.1)",
            "movej([0,0,0,0,0,0], z=1)",
            "movej([0,0,0,0,0,0] 1)",
            "movej([0,0,0,0,0,inf])",
            "movej([0,0,0,0,0,0]",
            "movel([0,0,0,0,0,0])",
            "set_digital_out(0, True)",
            "def f():\n movej([0,0,0,0,0,0])\n stopj(2)\nend",
            "x = 1",
        ] {
            assert_eq!(parse(program), None, "{program}");
        }
    }

    proptest! {
        #[test]
        fn no_words_make_it_panic(program in "(def f\\(\\):\n)?[ -~\n]{0,80}", list in "[0-9a-z.,= \\[\\]-]{0,40}") {
            parse(&program);
            parse(&format!("movej([{list})"));
        }
    }
}
