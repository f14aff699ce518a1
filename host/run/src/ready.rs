//! A board made ready for a run: with zeros measured now, or with those that it holds already.
//!
//! A zero is true only while the cables are slack. On a rig that stays powered, friction keeps 0.7 to 1.0 N in a cable
//! after a run; a zero taken then would make every later force wrong by that much. So a zero is measured at power-on of
//! an emulated rig and when the user asks for it, and a run keeps what is there. A measured zero far from the last one
//! is refused ([`ZERO_TOLERANCE_N`]): a cable that pulls looks like a zero that moved.

use super::prepare::{
    bring_up, check_idle, leave_out_faulted, prepare_board, wait_ready, zero, Prepared,
    BRING_UP_TIMEOUT,
};
use super::{Observer, Phase, RunError};
use control::SystemState;
use known::zeros::{ZeroStore, ZERO_TOLERANCE_N};
use rig::RigFile;
use session::Session;
use std::sync::atomic::AtomicBool;
use std::time::Duration;
use wire::message::UnitConfig;
use wire::{Command, UNITS};

/// How long zeroing goes on at most after its command.
const ZERO_END: Duration = Duration::from_secs(5);

/// Where the zeros of a run come from.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Zeroing {
    /// Measured now and used whatever they are: an emulated rig at power-on, where the cables are slack.
    #[default]
    Measure,
    /// Those that the board holds. Where it holds none (it was powered up since), they are measured and have to
    /// agree with the stored ones.
    Keep(ZeroStore),
    /// Measured now, because the user says that the cables are slack; refused where they disagree with the last ones.
    Ask(ZeroStore),
    /// Measured now, and the reference for later.
    Replace(ZeroStore),
}

/// Makes a board ready: configured, with zeros, disarmed.
///
/// # Errors
/// [`RunError`]; nothing was armed, and zeros that were refused are not in force.
pub fn ready_board(
    session: &mut Session<'_>,
    rig: &RigFile,
    zeroing: &Zeroing,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let (store, replace) = match zeroing {
        Zeroing::Measure => return prepare_board(session, rig, stop, observer),
        Zeroing::Keep(store) => return keep(session, rig, store, stop, observer),
        Zeroing::Ask(store) => (store, false),
        Zeroing::Replace(store) => (store, true),
    };
    let before = session.get_configs()?;
    let references = if replace {
        References::Replaced
    } else {
        References::Stored(references(store, &before)?)
    };
    measure(session, rig, &before, &references, store, stop, observer)
}

/// Uses the zeros that the board holds.
fn keep(
    session: &mut Session<'_>,
    rig: &RigFile,
    store: &ZeroStore,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    check_idle(&session.get_status()?)?;
    let in_force = session.get_configs()?;
    let wanted = carried_over(session, rig, &in_force);
    let complete = wanted
        .iter()
        .all(|config| !config.enabled || config.zero_code != 0);
    if !complete {
        let stored = store.references()?;
        if stored.is_empty() {
            return Err(RunError::Argument(format!(
                "no zero is known for rig `{}`: let all cables hang slack and run `forcectl zero`; nothing was driven",
                rig.name
            )));
        }
        observer.notice("the board was powered up since its last zero: zeros are measured and compared with the stored ones");
        return measure(
            session,
            rig,
            &in_force,
            &References::Stored(stored),
            store,
            stop,
            observer,
        );
    }
    let wrong = far(&wanted, &store.references()?);
    if !wrong.is_empty() {
        return Err(RunError::Fault(format!(
            "the zeros that the board holds are not the stored ones: {}; let all cables hang slack and run \
             `forcectl zero`; nothing was driven",
            wrong.join(", ")
        )));
    }
    let mut configs = wanted;
    let same = wanted == in_force && session.get_board()? == rig.controller.board_config();
    let faults = if same {
        // Nothing is sent that would start the sensors anew.
        observer.configured(&in_force);
        session.command(&Command::Stream { decimation: 1 })?;
        let status = wait_ready(session, BRING_UP_TIMEOUT, Phase::BringUp, stop, observer)?;
        leave_out_faulted(session, &mut configs, &status, observer)?
    } else {
        bring_up(session, rig, &mut configs, stop, observer)?
    };
    Prepared::verified(session, configs, faults, observer)
}

/// The rig file's configuration with what belongs to the board: its zeros, and an emulated rig's calibrated scales.
fn carried_over(
    session: &mut Session<'_>,
    rig: &RigFile,
    in_force: &[UnitConfig; UNITS],
) -> [UnitConfig; UNITS] {
    let emulated = session.link().controls().is_some();
    let mut configs = rig.units.map(|unit| unit.to_wire());
    for (i, (config, before)) in configs.iter_mut().zip(in_force).enumerate() {
        config.zero_code = before.zero_code;
        if emulated && before.zero_code != 0 && !rig.has_measured_gain(i) {
            config.scale_pn_per_count = before.scale_pn_per_count;
        }
    }
    configs
}

/// What measured zeros are compared with.
enum References {
    /// With none: the user has them accepted as they are.
    Replaced,
    /// With these, ADC codes.
    Stored(Vec<[i32; UNITS]>),
}

/// The zeros to compare with: the stored ones, else those in force.
fn references(
    store: &ZeroStore,
    in_force: &[UnitConfig; UNITS],
) -> Result<Vec<[i32; UNITS]>, RunError> {
    let stored = store.references()?;
    if !stored.is_empty() {
        return Ok(stored);
    }
    // A code of 0 is no zero, and compared with none.
    Ok(vec![in_force.map(|config| config.zero_code)])
}

/// Measures zeros. Where they disagree with the references, the board gets `before` back.
fn measure(
    session: &mut Session<'_>,
    rig: &RigFile,
    before: &[UnitConfig; UNITS],
    references: &References,
    store: &ZeroStore,
    stop: &AtomicBool,
    observer: &mut dyn Observer,
) -> Result<Prepared, RunError> {
    let mut configs = carried_over(session, rig, before);
    let mut faults = bring_up(session, rig, &mut configs, stop, observer)?;
    match zero(session, &mut configs, stop, observer) {
        Ok(found) => faults.extend(found),
        Err(error) => {
            // The board may have finished by itself: zeros that nobody has compared must not stay in force.
            let _ = session.wait_for(ZERO_END, "zeroing", |status| {
                status.state == SystemState::Ready as u8
            });
            let _ = session.configure(before);
            return Err(error);
        }
    }
    let (wrong, accepted) = match references {
        References::Replaced => (Vec::new(), true),
        References::Stored(stored) => (far(&configs, stored), false),
    };
    if !wrong.is_empty() {
        session.configure(before)?;
        return Err(RunError::Fault(format!(
            "the zeros are refused: {}; a slack cable moves by {ZERO_TOLERANCE_N} N at most, so these cables pull (or the \
             sensor changed). Take the load off them and repeat; if they are slack, `forcectl zero --replace`. The \
             board has its former zeros",
            wrong.join(", ")
        )));
    }
    let prepared = Prepared::verified(session, configs, faults, observer)?;
    store.add(&rig.name, &configs, accepted)?;
    Ok(prepared)
}

/// Units whose zero is too far from a reference, in words.
fn far(configs: &[UnitConfig; UNITS], references: &[[i32; UNITS]]) -> Vec<String> {
    let mut wrong = Vec::new();
    for (i, config) in configs.iter().enumerate().filter(|(_, c)| c.enabled) {
        let newton_per_count = f64::from(config.scale_pn_per_count) * 1e-12;
        let moved_n = references
            .iter()
            .filter(|codes| codes[i] != 0)
            .map(|codes| (f64::from(config.zero_code) - f64::from(codes[i])) * newton_per_count)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()));
        if let Some(moved_n) = moved_n.filter(|moved_n| moved_n.abs() > ZERO_TOLERANCE_N) {
            wrong.push(format!("unit {} moved by {moved_n:+.2} N", i + 1));
        }
    }
    wrong
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::NoopObserver;
    use emulator_link::Injection;
    use session::link::fake::{Behavior, FakeBoard};
    use session::link::RigControls;

    fn ready(
        session: &mut Session<'_>,
        rig: &RigFile,
        zeroing: &Zeroing,
    ) -> Result<Prepared, RunError> {
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
        let rig = RigFile::built_in().unwrap();
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
        session.advance(Duration::from_millis(300)).unwrap();
        let error = ready(&mut session, &rig, &Zeroing::Ask(store.clone())).unwrap_err();
        assert!(error.to_string().contains("unit 2 moved by"), "{error}");
        assert_eq!(session.get_configs().unwrap(), first.configs);
        // A run keeps the zeros; the tension is reported as it is.
        let kept = ready(&mut session, &rig, &Zeroing::Keep(store.clone())).unwrap();
        assert_eq!(kept.configs, first.configs);
        session.advance(Duration::from_millis(200)).unwrap();
        let (tension, _) = session.tension_n()[1].unwrap();
        assert!((tension - 0.8).abs() < 0.1, "{tension}");
        // Who insists gets it.
        let replaced = ready(&mut session, &rig, &Zeroing::Replace(store.clone())).unwrap();
        assert_ne!(replaced.configs[1].zero_code, first.configs[1].zero_code);
    }

    #[test]
    fn a_run_that_keeps_its_zeros_sends_the_boards_limits() {
        let mut rig = RigFile::built_in().unwrap();
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
        let rig = RigFile::built_in().unwrap();
        let mut board = FakeBoard::new(Behavior::Good);
        let mut zero = |newton: f64, zeroing: &Zeroing| {
            pull(&mut board, newton);
            let mut session = Session::connect(&mut board).unwrap();
            session.advance(Duration::from_millis(300)).unwrap();
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
        let rig = RigFile::built_in().unwrap();
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
        let rig = RigFile::built_in().unwrap();
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
}
