//! Drivers against simulated controllers, and against peers that mean no good.

#![allow(clippy::unwrap_used)]

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::thread;
use std::time::{Duration, Instant};

use relight_capture::robot::simulated::{Repeatability, SimulatedModel, SimulationSettings};
use relight_capture::robot::{
    Arm, ArmError, ArmStatus, EliteAddresses, EliteArm, JointSpeed, Joints, MotionPlan, SimulatedController,
    TimeLimits, UrAddresses, UrArm,
};

const LIMITS: TimeLimits = TimeLimits {
    connect: Duration::from_secs(2),
    reply: Duration::from_millis(700),
    silence: Duration::from_millis(1500),
    rest: Duration::from_millis(100),
};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Make {
    Ur,
    Elite,
}

const MAKES: [Make; 2] = [Make::Ur, Make::Elite];

impl Make {
    fn home(self) -> Joints {
        match self {
            Make::Ur => SimulatedModel::UR5E.home,
            Make::Elite => SimulatedModel::EC66.home,
        }
    }

    fn simulate(self, faults: &[&str], time_scale: f64) -> SimulatedController {
        let faults = faults.iter().map(|fault| fault.parse().unwrap()).collect();
        let settings = SimulationSettings { seed: 3, faults, time_scale, ..SimulationSettings::default() };
        match self {
            Make::Ur => SimulatedController::ur5e(&UrAddresses::parse("127.0.0.1:0").unwrap(), settings),
            Make::Elite => {
                SimulatedController::ec66(&EliteAddresses::parse("127.0.0.1:0").unwrap(), settings)
            }
        }
        .unwrap()
    }

    fn connect(self, to: &SimulatedController) -> Result<Box<dyn Arm>, ArmError> {
        Ok(match self {
            Make::Ur => Box::new(UrArm::connect(ur_addresses(to), LIMITS)?),
            Make::Elite => Box::new(EliteArm::connect(elite_addresses(to), LIMITS)?),
        })
    }
}

fn ur_addresses(to: &SimulatedController) -> UrAddresses {
    let [rtde, script, dashboard, realtime] =
        ["rtde", "script", "dashboard", "realtime"].map(|service| to.address_of(service));
    UrAddresses { rtde, script, dashboard, realtime }
}

fn elite_addresses(to: &SimulatedController) -> EliteAddresses {
    EliteAddresses { control: to.address_of("control"), monitor: to.address_of("monitor") }
}

/// A plan that nothing checks, through `home` plus each offset on every joint but the last, which stays.
fn plan_at(speed: JointSpeed, home: Joints, offsets: &[f64]) -> MotionPlan {
    let stations: Vec<Joints> =
        offsets.iter().map(|d| std::array::from_fn(|i| home[i] + if i < 5 { *d } else { 0.0 })).collect();
    MotionPlan::through(&stations, speed, |_, _| Ok::<_, String>(())).unwrap()
}

fn plan(home: Joints, offsets: &[f64]) -> MotionPlan {
    plan_at(JointSpeed::FASTEST, home, offsets)
}

fn difference(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn arms_go_where_they_are_sent_and_rest_a_little_beside() {
    for make in MAKES {
        let controller = make.simulate(&[], 20.0);
        let mut arm = make.connect(&controller).unwrap();
        let plan = plan(make.home(), &[0.0, 0.4, -0.3, 0.0]);
        assert_eq!(arm.state().unwrap().status, ArmStatus::Idle);
        for (motion, number) in plan.motions().iter().zip(1..) {
            let state = arm.move_along(motion).unwrap();
            assert_eq!(state.status, ArmStatus::Idle);
            let noise = difference(&state.joints, motion.to());
            assert!(noise > 1e-6 && noise < 3e-4, "{make:?}: {noise}");
            let reached = Repeatability::new(3).reached(number, motion.to());
            // Scripts and degrees carry nine digits and more.
            assert!(difference(&state.joints, &reached) < 1e-8, "{make:?}");
        }
    }
}

#[test]
fn motions_take_the_time_that_they_are_planned_to() {
    for make in MAKES {
        let controller = make.simulate(&[], 1.0);
        let mut arm = make.connect(&controller).unwrap();
        let plan = plan(make.home(), &[0.0, 0.2]);
        let begun = Instant::now();
        arm.move_along(&plan.motions()[0]).unwrap();
        // Never faster: a lower bound holds on a busy machine too.
        assert!(begun.elapsed() >= plan.motions()[0].duration(), "{make:?}");
    }
}

#[test]
fn a_motion_that_must_not_go_on_is_stopped_on_the_way() {
    for make in MAKES {
        let controller = make.simulate(&[], 1.0);
        let mut arm = make.connect(&controller).unwrap();
        // Some five seconds.
        let plan = plan_at(JointSpeed { speed: 0.2, acceleration: 1.0 }, make.home(), &[0.0, 1.0]);
        let begun = Instant::now();
        let wrong = ArmError::Stopped { address: "the other".to_owned(), status: ArmStatus::EmergencyStop };
        let mut go_on =
            || if begun.elapsed() < Duration::from_millis(300) { Ok(()) } else { Err(wrong.clone()) };
        assert_eq!(arm.move_while(&plan.motions()[0], &mut go_on), Err(wrong.clone()), "{make:?}");
        let stands = arm.state().unwrap();
        let behind = difference(&stands.joints, plan.motions()[0].from());
        assert!(stands.status == ArmStatus::Idle && behind < 0.9, "{make:?}: {behind}");
    }
}

#[test]
fn a_motion_that_begins_elsewhere_is_refused() {
    for make in MAKES {
        let controller = make.simulate(&[], 20.0);
        let mut arm = make.connect(&controller).unwrap();
        let plan = plan(make.home(), &[0.0, 0.4, 0.8]);
        let error = arm.move_along(&plan.motions()[1]).unwrap_err();
        assert!(matches!(error, ArmError::NotAtStart { .. }), "{error}");
        assert!(difference(&arm.state().unwrap().joints, &make.home()) < 1e-9, "it did not move");
    }
}

#[test]
fn stops_on_the_way_are_told_apart() {
    thread::scope(|scope| {
        for make in MAKES {
            scope.spawn(move || stop_half_way(make, "protective-stop@2", |s| s == ArmStatus::ProtectiveStop));
            scope.spawn(move || stop_half_way(make, "emergency-stop@2", |s| s == ArmStatus::EmergencyStop));
            scope.spawn(move || stop_half_way(make, "error@2", |s| matches!(s, ArmStatus::Fault(_))));
            scope.spawn(move || stop_half_way(make, "leave-remote@2", |s| s == ArmStatus::NotInRemote));
        }
    });
}

fn stop_half_way(make: Make, fault: &str, is_expected: fn(ArmStatus) -> bool) {
    let check = |error: ArmError| {
        let is_right = matches!(error, ArmError::Stopped { status, .. } if is_expected(status));
        assert!(is_right && error.to_string().contains("127.0.0.1:"), "{make:?} {fault}: {error}");
    };
    let controller = make.simulate(&[fault], 5.0);
    let mut arm = make.connect(&controller).unwrap();
    let plan = plan(make.home(), &[0.0, 0.2, 0.4]);
    arm.move_along(&plan.motions()[0]).unwrap();
    check(arm.move_along(&plan.motions()[1]).unwrap_err());
    let halfway = arm.state().unwrap();
    assert!((halfway.joints[0] - make.home()[0] - 0.3).abs() < 0.01, "{make:?} {fault}");
    // It stays there: nothing moves until somebody has looked.
    let stations = [halfway.joints, make.home()];
    let back = MotionPlan::through(&stations, JointSpeed::USUAL, |_, _| Ok::<_, String>(())).unwrap();
    check(arm.move_along(&back.motions()[0]).unwrap_err());
    assert_eq!(arm.state().unwrap().joints, halfway.joints);
}

/// What a driver makes of a fault of the network: in connecting, or in a motion that is long enough for it to come.
fn with_network_fault(make: Make, fault: &str) -> ArmError {
    let controller = make.simulate(&[fault], 1.0);
    let mut arm = match make.connect(&controller) {
        Ok(arm) => arm,
        Err(error) => return error,
    };
    let slow = JointSpeed { speed: 0.1, ..JointSpeed::USUAL };
    let plan = plan_at(slow, make.home(), &[0.0, 1.0]);
    arm.move_along(&plan.motions()[0]).unwrap_err()
}

#[test]
fn a_lost_link_is_told_and_so_is_that_the_arm_may_not_stand() {
    for make in MAKES {
        let error = with_network_fault(make, "link-loss@150");
        assert!(matches!(error.cause(), ArmError::LinkLost { .. }), "{make:?}: {error}");
        assert!(matches!(error, ArmError::NotStopped { .. }), "{make:?}: {error}");
        assert!(error.to_string().contains("emergency stop"), "{error}");
    }
}

#[test]
fn slow_replies_are_not_waited_for() {
    let begun = Instant::now();
    thread::scope(|scope| {
        for make in MAKES {
            scope.spawn(move || {
                let error = with_network_fault(make, "slow-replies@60");
                let is_late = matches!(error.cause(), ArmError::LinkLost { .. } | ArmError::TimedOut { .. });
                assert!(is_late, "{make:?}: {error}");
            });
        }
    });
    // A limit and not a duration: without one this would take forever.
    assert!(begun.elapsed() < Duration::from_secs(30));
}

#[test]
fn garbage_is_told_with_what_to_check() {
    thread::scope(|scope| {
        // Wherever it falls: a greeting, an answer, a state.
        for (make, at) in MAKES.into_iter().flat_map(|make| [1, 2, 3, 4, 60].map(|at| (make, at))) {
            scope.spawn(move || {
                let error = with_network_fault(make, &format!("garbage@{at}"));
                assert!(matches!(error.cause(), ArmError::Protocol { .. }), "{make:?} {at}: {error}");
                assert!(error.to_string().contains("check that this is the port of"), "{error}");
            });
        }
    });
}

#[test]
fn a_link_lost_between_motions_is_noticed() {
    for make in MAKES {
        let controller = make.simulate(&[], 1.0);
        let mut arm = make.connect(&controller).unwrap();
        arm.state().unwrap();
        drop(controller);
        let error = arm.state().unwrap_err();
        assert!(matches!(error, ArmError::LinkLost { .. }), "{make:?}: {error}");
    }
}

#[test]
fn a_stop_ends_what_another_client_began() {
    let controller = Make::Ur.simulate(&[], 1.0);
    let mut arm = Make::Ur.connect(&controller).unwrap();
    let mut other = TcpStream::connect(controller.address_of("script")).unwrap();
    other.write_all(b"movej([3.0, -1.5, 1.5, -1.5, -1.5, 0.0], a=1, v=0.5)\n").unwrap();
    stop_on_the_way(&mut *arm);

    let controller = Make::Elite.simulate(&[], 1.0);
    let mut arm = Make::Elite.connect(&controller).unwrap();
    let mut other = TcpStream::connect(controller.address_of("control")).unwrap();
    let target = r#"{"targetPos":[170,-90,90,-90,90,0],"speed":15}"#;
    other
        .write_all(format!("{{\"method\":\"moveByJoint\",\"params\":{target},\"id\":9}}\n").as_bytes())
        .unwrap();
    stop_on_the_way(&mut *arm);
}

fn stop_on_the_way(arm: &mut dyn Arm) {
    let seen = (0..500).any(|_| {
        thread::sleep(Duration::from_millis(5));
        arm.state().unwrap().status == ArmStatus::Running
    });
    assert!(seen, "the other client's motion is seen");
    arm.stop().unwrap();
    let state = arm.state().unwrap();
    assert_eq!(state.status, ArmStatus::Idle);
    assert!(state.joints[0] > 0.0 && state.joints[0] < 2.5, "{:?}", state.joints);
    thread::sleep(Duration::from_millis(100));
    assert_eq!(arm.state().unwrap().joints, state.joints);
}

#[test]
fn an_arm_that_is_moving_or_paused_takes_no_motion() {
    let controller = Make::Ur.simulate(&[], 1.0);
    let mut arm = Make::Ur.connect(&controller).unwrap();
    let mut dashboard = TcpStream::connect(controller.address_of("dashboard")).unwrap();
    let mut other = TcpStream::connect(controller.address_of("script")).unwrap();
    other.write_all(b"movej([3.0, -1.5, 1.5, -1.5, -1.5, 0.0], a=1, v=0.5)\n").unwrap();
    let mut until = |wanted: ArmStatus| {
        (0..500).any(|_| {
            thread::sleep(Duration::from_millis(5));
            arm.state().unwrap().status == wanted
        })
    };
    assert!(until(ArmStatus::Running));
    dashboard.write_all(b"pause\n").unwrap();
    assert!(until(ArmStatus::Paused));
    let plan = plan(Make::Ur.home(), &[0.0, 0.1]);
    let error = arm.move_along(&plan.motions()[0]).unwrap_err();
    assert!(matches!(error, ArmError::Stopped { status: ArmStatus::Paused, .. }), "{error}");
    dashboard.write_all(b"play\n").unwrap();
    let mut until = |wanted: ArmStatus| {
        (0..500).any(|_| {
            thread::sleep(Duration::from_millis(5));
            arm.state().unwrap().status == wanted
        })
    };
    assert!(until(ArmStatus::Running), "it goes on after a pause");
    let error = arm.move_along(&plan.motions()[0]).unwrap_err();
    assert!(matches!(error, ArmError::Stopped { status: ArmStatus::Running, .. }), "{error}");
}

#[test]
fn nobody_there_is_told_by_address() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let at = || free.clone();
    let ur = UrAddresses { rtde: at(), script: at(), dashboard: at(), realtime: at() };
    let error = UrArm::connect(ur, LIMITS).unwrap_err();
    assert!(matches!(&error, ArmError::Unreachable { address, .. } if *address == free), "{error}");
    let error = EliteArm::connect(EliteAddresses { control: at(), monitor: at() }, LIMITS).unwrap_err();
    assert!(matches!(&error, ArmError::Unreachable { address, .. } if *address == free), "{error}");
    let nowhere = EliteAddresses::parse("no.such.host.invalid").unwrap();
    assert!(matches!(EliteArm::connect(nowhere, LIMITS), Err(ArmError::Unreachable { .. })));
}

/// Listens and treats every connection as `peer` says; gives up after a while.
fn hostile(peer: fn(TcpStream)) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    thread::spawn(move || {
        for stream in listener.incoming().take(8).flatten() {
            thread::spawn(move || peer(stream));
        }
    });
    address
}

#[test]
fn peers_that_mean_no_good_are_left_in_time() {
    let limits =
        TimeLimits { reply: Duration::from_millis(300), silence: Duration::from_millis(300), ..LIMITS };
    let closes: fn(TcpStream) = drop;
    let silent: fn(TcpStream) = |mut stream| while stream.read(&mut [0; 64]).is_ok_and(|n| n > 0) {};
    let drips: fn(TcpStream) = |mut stream| {
        // Each read succeeds, but a message never comes of them.
        for _ in 0..1000 {
            if stream.write_all(b" ").is_err() {
                return;
            }
            thread::sleep(Duration::from_millis(20));
        }
    };
    let floods: fn(TcpStream) = |mut stream| while stream.write_all(&[b'a'; 4096]).is_ok() {};
    let zeros: fn(TcpStream) = |mut stream| while stream.write_all(&[0; 4096]).is_ok() {};
    let nests: fn(TcpStream) = |mut stream| while stream.write_all(&[b'['; 4096]).is_ok() {};
    let peers = [
        ("closes", closes),
        ("silent", silent),
        ("drips", drips),
        ("floods", floods),
        ("zeros", zeros),
        ("nests", nests),
    ];
    let begun = Instant::now();
    thread::scope(|scope| {
        for (name, peer) in peers {
            scope.spawn(move || leave(name, peer, limits));
        }
    });
    // Far more than all limits together, and less than one drip takes to end.
    assert!(begun.elapsed() < Duration::from_secs(19));
}

/// Puts `peer` in the place of each port in turn.
fn leave(name: &str, peer: fn(TcpStream), limits: TimeLimits) {
    let address = hostile(peer);
    let good = Make::Ur.simulate(&[], 1.0);
    let dashboard = UrAddresses { dashboard: address.clone(), ..ur_addresses(&good) };
    let rtde = UrAddresses { rtde: address.clone(), ..ur_addresses(&good) };
    for error in [dashboard, rtde].map(|addresses| UrArm::connect(addresses, limits).unwrap_err()) {
        assert!(error.to_string().starts_with(&address), "{name}: {error}");
    }
    let good = Make::Elite.simulate(&[], 1.0);
    let control = EliteAddresses { control: address.clone(), ..elite_addresses(&good) };
    let error = EliteArm::connect(control, limits).unwrap_err();
    assert!(error.to_string().starts_with(&address), "{name}: {error}");
    let monitor = EliteAddresses { monitor: address.clone(), ..elite_addresses(&good) };
    let error = EliteArm::connect(monitor, limits).and_then(|mut arm| arm.state()).unwrap_err();
    assert!(error.to_string().starts_with(&address), "{name}: {error}");
}

#[test]
fn controllers_outlive_clients_that_mean_no_good() {
    for make in MAKES {
        let controller = make.simulate(&[], 20.0);
        for (_, address) in controller.listening() {
            for bytes in
                [&[0xFF; 5000][..], &[0; 5000], b"{\n\n}\n", b"def f():\n", "é\n".as_bytes(), b"[[[[[[\n"]
            {
                let mut stream = TcpStream::connect(address).unwrap();
                let _ = stream.write_all(bytes);
            }
        }
        let mut arm = make.connect(&controller).unwrap();
        arm.move_along(&plan(make.home(), &[0.0, 0.1]).motions()[0]).unwrap();
    }
}

#[test]
fn a_port_that_is_taken_is_named() {
    let first = Make::Ur.simulate(&[], 1.0);
    let taken = first.address_of("rtde");
    let at = UrAddresses { rtde: taken.clone(), ..UrAddresses::parse("127.0.0.1:0").unwrap() };
    let error = SimulatedController::ur5e(&at, SimulationSettings::default()).unwrap_err();
    assert!(error.to_string().contains(&taken), "{error}");
}
