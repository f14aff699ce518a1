//! Whole runs against the board in memory.

use super::*;
use crate::force::metrics::Step;
use crate::link::fake::{Behavior, FakeBoard};
use crate::session::TimedSample;
use control::SystemState;
use std::sync::atomic::Ordering;
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

fn rig() -> RigFile {
    RigFile::built_in().unwrap()
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
fn a_unit_that_faults_is_reported_and_the_others_continue() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(1.5, Injection::UnplugSensor(4))];
    let mut notes = Notes::default();
    let outcome = set_force(&mut board, &rig(), &options, &mut notes).unwrap();
    assert_eq!(outcome.ended, Ended::Degraded);
    assert_eq!(outcome.faults.len(), 1);
    assert_eq!(outcome.faults[0].unit, Some(4));
    assert!(
        notes.0.iter().any(|n| n.contains("unit 4 dropped out")),
        "{:?}",
        notes.0
    );
    // +y needs unit 3, which is there: the force goes on.
    let end = outcome.steps.last().unwrap();
    assert!((end.best_force_n()[1] - 2.5).abs() < 0.3, "{end:?}");
    assert_eq!(end.tension_setpoint_n[3], 0.0);
}

#[test]
fn a_unit_that_never_came_up_is_left_out() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(f64::NEG_INFINITY, Injection::UnplugSensor(2))];
    let mut notes = Notes::default();
    let outcome = set_force(&mut board, &rig(), &options, &mut notes).unwrap();
    assert!(
        notes.0.iter().any(|n| n.contains("unit 2 is left out")),
        "{:?}",
        notes.0
    );
    assert!(!outcome.configs[1].enabled);
    assert_eq!(outcome.ended, Ended::Degraded);
}

#[test]
fn the_e_stop_ends_the_run_with_its_page() {
    let mut board = FakeBoard::new(Behavior::Good);
    let mut options = options();
    options.injections = vec![(1.0, Injection::EStop(true))];
    let error = set_force(&mut board, &rig(), &options, &mut NoopObserver).unwrap_err();
    assert!(
        error.to_string().contains("fault 1, E-stop open"),
        "{error}"
    );
    assert!(!board.system.drives());
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
