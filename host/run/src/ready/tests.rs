//! Readiness against the board in memory.

use super::*;
use crate::NoopObserver;
use emulator_link::Injection;
use rig::board_crc;
use session::link::fake::{Behavior, FakeBoard};
use session::link::RigControls;

fn ready(session: &mut Session<'_>, rig: &Rig, zeroing: &Zeroing) -> Result<Prepared, RunError> {
    ready_board(
        session,
        rig,
        zeroing,
        &AtomicBool::new(false),
        &mut NoopObserver,
    )
}

fn pull(board: &mut FakeBoard, newton: f64) {
    board.inject(Injection::PullCable(2, newton)).unwrap();
}

#[test]
fn a_zero_far_from_the_last_one_is_refused_and_not_in_force() {
    let folder = tempfile::tempdir().unwrap();
    let store = ZeroStore::at(folder.path().join("zeros.toml"));
    let rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let first = {
        let mut session = Session::connect(&mut board).unwrap();
        ready(&mut session, &rig, &Zeroing::Ask(store.clone())).unwrap()
    };
    assert_eq!(
        store.last().unwrap(),
        Some(first.configs.map(|c| c.zero_code))
    );
    // 0.8 N are left in a cable, as friction leaves them.
    pull(&mut board, 0.8);
    let mut session = Session::connect(&mut board).unwrap();
    session.exchange(Duration::from_millis(300)).unwrap();
    let error = ready(&mut session, &rig, &Zeroing::Ask(store.clone())).unwrap_err();
    assert!(error.to_string().contains("unit 2 moved by"), "{error}");
    assert_eq!(session.get_configs().unwrap(), first.configs);
    // A run keeps the zeros; the tension is reported as it is.
    let kept = ready(&mut session, &rig, &Zeroing::Keep(store.clone())).unwrap();
    assert_eq!(kept.configs, first.configs);
    session.exchange(Duration::from_millis(200)).unwrap();
    let (tension, _) = session.tension_n()[1].unwrap();
    assert!((tension - 0.8).abs() < 0.1, "{tension}");
    // Who insists gets it.
    let replaced = ready(&mut session, &rig, &Zeroing::Replace(store.clone())).unwrap();
    assert_ne!(replaced.configs[1].zero_code, first.configs[1].zero_code);
}

#[test]
fn a_run_that_keeps_its_zeros_sends_the_boards_limits() {
    let mut rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let mut session = Session::connect(&mut board).unwrap();
    ready(&mut session, &rig, &Zeroing::Measure).unwrap();
    rig.controller.tip_force_limit_n = 6.0;
    ready(&mut session, &rig, &Zeroing::Keep(ZeroStore::none())).unwrap();
    assert_eq!(session.get_board().unwrap(), rig.controller.board_config());
}

#[test]
fn steps_that_are_accepted_do_not_add_up() {
    let folder = tempfile::tempdir().unwrap();
    let store = ZeroStore::at(folder.path().join("zeros.toml"));
    let rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let mut zero = |newton: f64, zeroing: &Zeroing| {
        pull(&mut board, newton);
        let mut session = Session::connect(&mut board).unwrap();
        session.exchange(Duration::from_millis(300)).unwrap();
        ready(&mut session, &rig, zeroing).map(|_| ())
    };
    zero(0.0, &Zeroing::Ask(store.clone())).unwrap();
    zero(0.35, &Zeroing::Ask(store.clone())).unwrap();
    let error = zero(0.7, &Zeroing::Ask(store.clone())).unwrap_err();
    assert!(
        error.to_string().contains("unit 2 moved by +0.7"),
        "{error}"
    );
    zero(0.7, &Zeroing::Replace(store.clone())).unwrap();
    zero(1.05, &Zeroing::Ask(store)).unwrap();
}

#[test]
fn an_interrupted_zero_is_not_in_force() {
    let rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let mut session = Session::connect(&mut board).unwrap();
    let first = ready(&mut session, &rig, &Zeroing::Measure).unwrap();
    // The signal comes when zeroing has begun.
    struct AtZero<'a>(&'a AtomicBool);
    impl Observer for AtZero<'_> {
        fn progress(&mut self, phase: Phase, _: f64) {
            if phase == Phase::Zero {
                self.0.store(true, std::sync::atomic::Ordering::SeqCst);
            }
        }
    }
    let stop = AtomicBool::new(false);
    let zeroing = Zeroing::Replace(ZeroStore::none());
    let error = ready_board(&mut session, &rig, &zeroing, &stop, &mut AtZero(&stop));
    assert!(matches!(error, Err(RunError::Interrupted)));
    assert_eq!(session.get_configs().unwrap(), first.configs);
}

#[test]
fn a_board_without_zeros_needs_stored_ones() {
    let folder = tempfile::tempdir().unwrap();
    let store = ZeroStore::at(folder.path().join("zeros.toml"));
    let rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let mut session = Session::connect(&mut board).unwrap();
    let error = ready(&mut session, &rig, &Zeroing::Keep(store.clone())).unwrap_err();
    assert!(error.to_string().contains("forcectl zero"), "{error}");
    ready(&mut session, &rig, &Zeroing::Ask(store.clone())).unwrap();
    // Powered up again: the zeros are measured and agree.
    let mut board = FakeBoard::new(Behavior::Good);
    let mut session = Session::connect(&mut board).unwrap();
    let prepared = ready(&mut session, &rig, &Zeroing::Keep(store.clone())).unwrap();
    assert!(prepared.configs.iter().all(|config| config.zero_code != 0));
    // Powered up under load: refused.
    let mut board = FakeBoard::new(Behavior::Good);
    pull(&mut board, 0.8);
    let mut session = Session::connect(&mut board).unwrap();
    assert!(ready(&mut session, &rig, &Zeroing::Keep(store)).is_err());
}

#[test]
fn a_prepared_board_holds_the_configuration_and_is_disarmed() {
    let rig = Rig::built_in().unwrap();
    let mut board = FakeBoard::new(Behavior::Good);
    let mut session = Session::connect(&mut board).unwrap();
    let prepared = ready(&mut session, &rig, &Zeroing::Measure).unwrap();
    assert_eq!(prepared.available, [true; UNITS]);
    assert_eq!(prepared.config_crc, board_crc(&prepared.configs));
    assert_eq!(session.get_configs().unwrap(), prepared.configs);
    assert!(prepared.configs.iter().all(|config| config.zero_code != 0));
    assert_eq!(board.system, SystemState::Ready);
    assert!(!board.commands.contains(&Command::Arm));
}

#[test]
fn a_board_that_is_armed_or_faulted_is_left_as_it_is() {
    let rig = Rig::built_in().unwrap();
    for (command, words) in [
        (Command::Arm, "armed already"),
        (Command::Stop, "a fault is latched"),
    ] {
        let mut board = FakeBoard::new(Behavior::Good);
        let mut session = Session::connect(&mut board).unwrap();
        session.exchange(Duration::from_secs(2)).unwrap();
        session.command(&command).unwrap();
        let error = ready(&mut session, &rig, &Zeroing::Measure).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
        assert!(!board.commands.contains(&Command::CommitConfig));
    }
}
