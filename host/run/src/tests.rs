//! Whole runs against the board in memory.

use super::*;
use control::SystemState;
use emulator_link::Injection;
use force::metrics::{self, Step};
use plant::effects::AmplifierGain;
use rig::Rig;
use session::link::fake::{Behavior, FakeBoard};
use session::link::{Exchange, LinkError, RigControls, RigLink};
use session::TimedSample;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering;
use std::sync::Arc;
use std::time::Duration;
use wire::Command;

#[derive(Default)]
struct Notes(Vec<String>, u64);

impl Observer for Notes {
    fn notice(&mut self, text: &str) {
        self.0.push(text.to_owned());
    }
    fn samples(&mut self, samples: &[TimedSample]) {
        self.1 += samples.len() as u64;
    }
}

fn rig() -> Rig {
    Rig::built_in().unwrap()
}

fn options() -> Options {
    Options::new([0.0, 2.5, 0.0], 4.0)
}

#[test]
fn a_force_is_held_while_the_robot_moves() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut notes = Notes::default();
    let outcome = set_force(&mut board, &rig(), &options(), &mut notes).unwrap();
    assert_eq!(outcome.ended, Ended::Done, "{:?}", notes.0);
    // The samples of zeroing and calibrating are there as well.
    assert!(notes.1 > outcome.samples, "{} {}", notes.1, outcome.samples);
    assert_eq!(outcome.link_counters.frames_lost, 0);
    let metrics = outcome.metrics.unwrap();
    assert!(metrics.tip_force_error_n < 0.1, "{metrics:?}");
    assert!(
        metrics.tension_rms_n.iter().all(|rms| *rms < 0.3),
        "{metrics:?}"
    );
    assert!(metrics.settling_s.is_some_and(|s| s < 1.0), "{metrics:?}");
    let moved = outcome.steps.iter().map(|step| step.tip_m[0]);
    let (low, high) = moved.fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
    assert!(high - low > 0.005, "the robot stood still");
    // Disarmed at the end, motors at 0 V.
    assert_eq!(board.system, SystemState::Ready);
    assert!(board
        .plant
        .truth()
        .units
        .iter()
        .all(|unit| unit.amplifier_volts == 0.0));
}

#[test]
fn load_cells_of_an_emulated_rig_are_calibrated_with_a_weight() {
    let mut board = FakeBoard::new(Behavior::Good);
    let options = Options::new([0.0, 1.0, 0.0], 0.2);
    let outcome = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
    for (i, config) in outcome.configs.iter().enumerate() {
        // A code is 1 / (128 * 2^24) V/V.
        let per_n = board.plant.parameters(i).bridge_per_n * 128.0 * f64::from(1 << 24);
        let error = f64::from(config.scale_pn_per_count) * 1e-12 * per_n - 1.0;
        assert!(error.abs() < 1e-3, "unit {}: {error}", i + 1);
    }
}

#[test]
fn nothing_is_driven_with_a_bad_force() {
    for bad in [
        [f64::NAN, 0.0, 0.0],
        [0.0, f64::INFINITY, 0.0],
        [0.0, 1e9, 0.0],
    ] {
        let mut board = FakeBoard::new(Behavior::Good);
        let result = set_force(
            &mut board,
            &rig(),
            &Options::new(bad, 1.0),
            &mut NoopObserver,
        );
        assert!(matches!(result, Err(RunError::Argument(_))), "{bad:?}");
        assert!(board.commands.is_empty());
    }
}

#[test]
fn a_unit_that_faults_is_left_out_where_the_others_can_hold_zero_force() {
    // Unit 4 pulls where unit 3 does and does not have to pull back: the other five balance without
    // it.
    let mut rig = rig();
    for unit in &mut rig.units {
        unit.tension_min_n = 0.1;
    }
    rig.units[2].tension_min_n = 0.1;
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(1.5, Injection::UnplugSensor(4))];
    let mut notes = Notes::default();
    let outcome = set_force(&mut board, &rig, &options, &mut notes).unwrap();
    assert_eq!(outcome.ended, Ended::Degraded);
    assert_eq!(outcome.faults[0].unit, Some(4));
    assert_eq!(kinds(&outcome)[0], ShortfallKind::UnitLost);
    assert!(
        notes.0.iter().any(|n| n.contains("unit 4 dropped out")),
        "{:?}",
        notes.0
    );
    // To the end, and without unit 4.
    let end = outcome.steps.last().unwrap();
    assert!(end.t_s > 3.9, "{end:?}");
    assert_eq!(end.tension_setpoint_n[3], 0.0);
}

#[test]
fn a_unit_that_faults_ends_the_run_where_the_others_cannot_hold_zero_force() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(1.5, Injection::UnplugSensor(4))];
    let stopped = hold_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap_err();
    let text = stopped.error.to_string();
    assert!(matches!(stopped.error, RunError::UnitLost(_)), "{text}");
    assert!(
        text.contains("unit 4 dropped out") && text.contains("fault 33"),
        "{text}"
    );
    let outcome = stopped.outcome.unwrap();
    assert_eq!(outcome.ended, Ended::Stopped);
    assert_eq!(outcome.faults[0].unit, Some(4));
    // Ramped down at once: neither to the end of the run nor with a stop. The cables that pulled
    // with unit 4 let go.
    let commanded = outcome.steps.iter().rfind(|s| s.commanded_n.norm() > 0.0);
    assert!(commanded.unwrap().t_s < 1.6);
    let end = outcome.steps.last().unwrap();
    assert!(end.t_s < 3.0 && end.best_force_n().norm() < 2.0, "{end:?}");
    assert_eq!(board.system, SystemState::Ready);
    assert!(board.commands.contains(&Command::Disarm));
    assert!(!board.commands.contains(&Command::Stop));
}

#[test]
fn nothing_is_armed_where_zero_force_is_out_of_reach() {
    // By the rig file: nothing is sent.
    let mut copied = rig();
    copied.units[1].exit_m = copied.units[0].exit_m;
    copied.units[1].axis = copied.units[0].axis;
    let mut board = FakeBoard::new(Behavior::Good);
    let error = set_force(&mut board, &copied, &options(), &mut NoopObserver).unwrap_err();
    assert!(matches!(error, RunError::Infeasible(_)), "{error}");
    assert!(board.commands.is_empty());
    // By a unit that never came up.
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(f64::NEG_INFINITY, Injection::UnplugSensor(2))];
    let mut notes = Notes::default();
    let stopped = hold_force(&mut board, &rig(), &options, &mut notes).unwrap_err();
    assert!(
        notes.0.iter().any(|n| n.contains("unit 2 is left out")),
        "{:?}",
        notes.0
    );
    let text = stopped.error.to_string();
    assert!(text.contains("zero force is out of reach"), "{text}");
    assert!(stopped.outcome.is_none());
    assert!(!board.commands.contains(&Command::Arm));
}

#[test]
fn nothing_is_armed_without_a_pose() {
    // The link reports none: noticed before the board is prepared.
    let mut board = FakeBoard::new(Behavior::NoPose);
    let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
    assert!(error.to_string().contains("reports no pose"), "{error}");
    assert!(!board.commands.contains(&Command::CommitConfig));
    // Poses of the time before arming do not count: one waits in the socket, and no more come.
    let listen = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = listen.local_addr().unwrap();
    drop(listen);
    let rig = Rig {
        pose: rig::PoseChoice::Udp {
            listen: address.to_string(),
            max_age_s: 1.0,
        },
        ..rig()
    };
    struct Once(std::net::SocketAddr);
    impl Observer for Once {
        fn progress(&mut self, phase: Phase, _fraction: f64) {
            if phase == Phase::Calibrate {
                let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
                let pose = br#"{"position": [-0.08, 0.025, -0.14]}"#;
                sender.send_to(pose, self.0).unwrap();
            }
        }
    }
    let mut board = FakeBoard::new(Behavior::Good);
    let error = set_force(&mut board, &rig, &options(), &mut Once(address)).unwrap_err();
    assert!(error.to_string().contains("no pose"), "{error}");
    assert!(!board.commands.contains(&Command::Arm));
}

#[test]
fn a_pose_that_the_link_no_longer_reports_ends_a_run_and_holding_tensions() {
    // The board and its samples go on: only the pose gets old.
    type Drive = fn(&mut FakeBoard) -> Result<(), RunError>;
    let force: Drive = |board| set_force(board, &rig(), &options(), &mut NoopObserver).map(|_| ());
    let tensions: Drive = |board| {
        let options = TensionOptions {
            tension_n: None,
            duration_s: Some(4.0),
            zeroing: options().zeroing,
            stop: options().stop,
        };
        hold_tensions(board, &rig(), &options, &mut NoopObserver, &mut || {}).map(|_| ())
    };
    for drive in [force, tensions] {
        let mut board = FakeBoard::new(Behavior::Good);
        drive(&mut board).unwrap();
        let until_ns = board.now_ns - 3_000_000_000;
        let mut board = FakeBoard::new(Behavior::PoseUntil(until_ns));
        let error = drive(&mut board).unwrap_err();
        assert!(error.to_string().contains("no pose"), "{error}");
        assert!(board.commands.contains(&Command::Arm));
        assert_eq!(board.system, SystemState::Stopping);
        // 100 ms of age, a cycle, and the way to the safe state.
        let late_ns = board.now_ns - until_ns;
        assert!(late_ns < 500_000_000, "{late_ns} ns");
    }
}

/// Kinds of what was not as commanded.
fn kinds(outcome: &Outcome) -> Vec<ShortfallKind> {
    outcome.shortfalls.iter().map(|s| s.kind).collect()
}

#[test]
fn a_force_that_is_not_held_is_no_success() {
    // Zeroed with a cable that is pulled: nothing that the load cells say is right.
    let mut board = FakeBoard::new(Behavior::Good);
    let options = Options {
        injections: vec![(f64::NEG_INFINITY, Injection::PullCable(2, 3.0))],
        ..options()
    };
    let outcome = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
    assert_eq!(outcome.ended, Ended::Degraded);
    assert_eq!(kinds(&outcome), [ShortfallKind::NeverSettled]);
    let text = &outcome.shortfalls[0].text;
    assert!(text.contains("cable 2 has"), "{text}");
    // An amplifier that gives 40 %.
    let mut plant = plant::PlantConfig::default();
    plant
        .effects
        .push(plant::effects::Effect::AmplifierGain(AmplifierGain {
            units: vec![2],
            relative_error: -0.6,
        }));
    let mut board = FakeBoard::with(Behavior::Good, 1, plant);
    let options = Options::new([0.0, 9.0, 0.0], 4.0);
    let outcome = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
    assert_eq!(outcome.ended, Ended::Degraded);
    let text = &outcome.shortfalls[0].text;
    assert!(
        text.contains("never settled") && text.contains("unit 3's command was at its limit"),
        "{text}"
    );
}

#[test]
fn an_injection_that_did_not_happen_is_named() {
    let mut board = FakeBoard::new(Behavior::Good);
    let options = Options {
        injections: vec![(9.0, Injection::UnplugSensor(3))],
        ..options()
    };
    let outcome = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap();
    assert_eq!(outcome.ended, Ended::Degraded);
    assert_eq!(kinds(&outcome), [ShortfallKind::NotInjected]);
    assert!(outcome.shortfalls[0].text.contains("unplug=3@9s"));
}

#[test]
fn the_e_stop_ends_the_run_with_its_page() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(1.0, Injection::EStop(true))];
    let stopped = hold_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap_err();
    let error = stopped.error;
    assert!(
        error.to_string().contains("fault 1, E-stop open"),
        "{error}"
    );
    assert!(!board.system.drives());
    // What was measured until then is there.
    let outcome = stopped.outcome.unwrap();
    assert_eq!(outcome.ended, Ended::Stopped);
    assert_eq!(kinds(&outcome)[0], ShortfallKind::Stopped);
    assert!((0.9..1.4).contains(&outcome.steps.last().unwrap().t_s));
}

/// A board that somebody stops over another link, a time after the force is commanded.
struct StoppedByOthers {
    board: FakeBoard,
    after_s: f64,
    at_ns: Option<u64>,
    stopped: bool,
}

impl RigLink for StoppedByOthers {
    fn name(&self) -> String {
        self.board.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let mut bytes = to_board.to_vec();
        let now_ns = self.board.now_ns;
        if self.at_ns.is_none() && self.board.commands.contains(&Command::Arm) {
            let after_s = options::PRETENSION_S + options::ROBOT_START_S + self.after_s;
            self.at_ns = Some(now_ns + (after_s * 1e9) as u64);
        }
        let due = self.at_ns.is_some_and(|at_ns| now_ns >= at_ns);
        if due && !std::mem::replace(&mut self.stopped, true) {
            let frame = wire::HostFrame {
                seq: 60_000,
                command: Command::Stop,
            };
            let mut out = [0; wire::MAX_FRAME];
            let length = wire::encode(&frame, &mut out).unwrap();
            bytes.extend_from_slice(&out[..length]);
        }
        self.board.exchange(&bytes, duration)
    }

    fn stopped_by(&self) -> Option<&str> {
        self.stopped.then_some("a test (process 7)")
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        self.board.controls()
    }
}

#[test]
fn a_run_that_is_stopped_says_by_whom_and_its_error_ends_there() {
    let mut board = FakeBoard::new(Behavior::Good);
    let whole = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
    let until = |t_s| whole.steps.partition_point(|step| step.t_s < t_s);
    // A report of the fault that is lost comes with the status, up to 50 ms later.
    for behavior in [Behavior::Good, Behavior::Drops(7), Behavior::Drops(11)] {
        for after_s in [1.5, 1.503] {
            let mut link = StoppedByOthers {
                board: FakeBoard::new(behavior),
                after_s,
                at_ns: None,
                stopped: false,
            };
            let stopped = hold_force(&mut link, &rig(), &options(), &mut NoopObserver).unwrap_err();
            let error = stopped.error.to_string();
            assert!(
                error.starts_with("stopped by a test (process 7): fault 3"),
                "{error}"
            );
            let metrics = stopped.outcome.unwrap().metrics.unwrap();
            let held = &whole.steps[..until(after_s)];
            let undisturbed = metrics::of_run(options().commanded_n, held).unwrap();
            let cycles = undisturbed.steady_cycles;
            assert!(
                (cycles - 10..=cycles + 1).contains(&metrics.steady_cycles),
                "{behavior:?}: {} and {cycles}",
                metrics.steady_cycles
            );
            let (rms, other) = (metrics.tip_force_rms_n, undisturbed.tip_force_rms_n);
            assert!(rms < 1.5 * other, "{behavior:?}: {rms} and {other}");
        }
    }
}

#[test]
fn ctrl_c_disarms() {
    struct Press(Arc<AtomicBool>);
    impl Observer for Press {
        fn step(&mut self, step: &Step) {
            if step.t_s > 1.5 {
                self.0.store(true, Ordering::Relaxed);
            }
        }
    }
    let mut board = FakeBoard::new(Behavior::Good);
    let options = options();
    let mut press = Press(Arc::clone(&options.stop));
    let outcome = set_force(&mut board, &rig(), &options, &mut press).unwrap();
    assert_eq!(outcome.ended, Ended::Interrupted);
    assert_eq!(board.system, SystemState::Ready);
    assert!(outcome.steps.last().unwrap().t_s < 1.6);
    // Before anything was armed: nothing ever is.
    let mut board = FakeBoard::new(Behavior::Good);
    let options = Options {
        stop: Arc::new(AtomicBool::new(true)),
        ..options
    };
    let result = set_force(&mut board, &rig(), &options, &mut NoopObserver);
    assert!(matches!(result, Err(RunError::Interrupted)));
    assert!(!board.commands.contains(&Command::Arm));
}

#[test]
fn a_link_that_breaks_is_an_error_and_the_board_stops_by_itself() {
    let mut board = FakeBoard::new(Behavior::BreaksAt(5_500_000_000));
    let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
    assert!(error.to_string().contains("went away"), "{error}");
    board.behavior = Behavior::Good;
    board.exchange(&[], Duration::from_millis(200)).unwrap();
    assert_eq!(board.fault.map(|f| f.0.code()), Some(2));
}

#[test]
fn a_board_that_falls_silent_or_restarts_ends_the_run() {
    let mut board = FakeBoard::new(Behavior::MuteAt(5_500_000_000));
    let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
    assert!(error.to_string().contains("doesn't answer"), "{error}");
    let mut board = FakeBoard::new(Behavior::ResetsAt(5_500_000_000));
    let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
    assert!(error.to_string().contains("was reset"), "{error}");
    assert!(error.to_string().contains("watchdog"), "{error}");
}

#[test]
fn a_bad_line_is_survived_and_counted() {
    let mut board = FakeBoard::new(Behavior::Noisy(4000));
    let outcome = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
    assert!(
        outcome.link_counters.frames_bad > 10,
        "{:?}",
        outcome.link_counters
    );
    assert!(outcome.link_counters.frames_lost > 10);
    assert!(outcome.metrics.unwrap().tip_force_error_n < 0.1);
}

#[test]
fn dropped_frames_are_counted_by_their_gaps() {
    let mut board = FakeBoard::new(Behavior::Drops(50));
    let outcome = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
    let counters = outcome.link_counters;
    let share = counters.frames_lost as f64 / (counters.frames + counters.frames_lost) as f64;
    assert!((share - 0.02).abs() < 0.001, "{counters:?}");
}

#[test]
fn an_answer_that_gets_lost_ends_no_run() {
    let mut board = FakeBoard::new(Behavior::LosesAnswers);
    let outcome = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap();
    assert_eq!(outcome.ended, Ended::Done);
    assert!(outcome.metrics.unwrap().tip_force_error_n < 0.1);
    // Those that drive among them.
    for twice in [Command::Arm, Command::Zero { units: 0x3f }] {
        let got = board.commands.iter().filter(|command| **command == twice);
        assert_eq!(got.count(), 2, "{twice:?}");
    }
}

#[test]
fn other_devices_are_refused_with_the_reason() {
    for (behavior, words) in [
        (Behavior::OtherAbi(wire::ABI_VERSION + 1), "update forcectl"),
        (Behavior::OtherAbi(0), "cargo xtask flash"),
        (Behavior::Garbage, "none of them a frame"),
        (Behavior::Silent, "sends nothing"),
        (Behavior::Refusing, "refused"),
    ] {
        let mut board = FakeBoard::new(behavior);
        let error = set_force(&mut board, &rig(), &options(), &mut NoopObserver).unwrap_err();
        assert!(error.to_string().contains(words), "{behavior:?}: {error}");
        assert!(!board.commands.contains(&Command::Arm));
    }
}

/// A robot that sends its poses over UDP, and a key that nobody knows once the force is commanded.
struct UdpRobot {
    sender: std::net::UdpSocket,
    tip_m: [f64; 3],
    notes: Vec<String>,
}

impl UdpRobot {
    fn send(&self, more: &str) {
        let pose = format!(r#"{{"position": {:?}{more}}}"#, self.tip_m);
        // The address is listened on from the second call on.
        let _ = self.sender.send(pose.as_bytes());
    }
}

impl Observer for UdpRobot {
    fn notice(&mut self, text: &str) {
        self.notes.push(text.to_owned());
    }
    fn received(&mut self, _: &session::Received) {
        self.send("");
    }
    fn step(&mut self, step: &Step) {
        if step.t_s > 0.0 {
            self.send(r#", "time": 5"#);
        }
    }
}

#[test]
fn a_key_of_a_pose_that_first_comes_after_arming_is_told() {
    let free = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let listen = free.local_addr().unwrap().to_string();
    drop(free);
    let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    sender.connect(&listen).unwrap();
    let mut rig = rig();
    let mut robot = UdpRobot {
        sender,
        tip_m: rig.workspace.center_m.into(),
        notes: Vec::new(),
    };
    rig.pose = rig::PoseChoice::Udp {
        listen,
        max_age_s: 10.0,
    };
    let mut board = FakeBoard::new(Behavior::Good);
    let told = set_force(&mut board, &rig, &options(), &mut robot);
    let notes = robot.notes;
    assert!(
        notes.iter().any(|text| text.contains("`time`")),
        "{told:?}: {notes:?}"
    );
}
