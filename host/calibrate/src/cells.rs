//! Codes of the load cells, as they come from the board.

use super::{CalibrateError, Result};
use control::SystemState;
use rig::Rig;
use run::RunError;
use session::Session;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use wire::message::UnitConfig;
use wire::{Command, UNITS};

/// Time that one request for samples takes: progress and Ctrl-C are looked at in between.
const STEP: Duration = Duration::from_millis(100);
/// How long the sensors may take to come up.
const BRING_UP: Duration = Duration::from_secs(15);

/// Brings a board to where its load cells can be read: configured, disarmed, without a latched
/// fault.
///
/// # Errors
/// The board is armed, a fault is latched, or it does not come up.
pub fn prepare(session: &mut Session<'_>, rig: &Rig) -> Result<()> {
    let status = session.get_status()?;
    let state = SystemState::from_u8(status.state);
    if state.is_some_and(SystemState::drives) {
        return Err(CalibrateError::refused(
            "the board is armed; `forcectl disarm` first: a cable that is driven says nothing about a cell",
        ));
    }
    if status.fault != 0 {
        return Err(CalibrateError::refused(format!(
            "a fault is latched: {}; then `forcectl clear`",
            session::explain_fault(status.fault, status.fault_detail)
        )));
    }
    // A board that was just switched on is ready with all units off.
    let in_use = session.get_configs()?.iter().any(|config| config.enabled);
    if state != Some(SystemState::Ready) || !in_use {
        configure(session, rig, &rig.units.map(|unit| unit.to_wire()))?;
    }
    session.command(&Command::Stream { decimation: 1 })?;
    Ok(())
}

/// Sends a configuration and waits until the sensors are up with it.
///
/// # Errors
/// The board refuses it, or does not come up.
pub fn configure(
    session: &mut Session<'_>,
    rig: &Rig,
    configs: &[UnitConfig; UNITS],
) -> Result<()> {
    session.stage_board(rig.controller.board_config())?;
    session.configure(configs)?;
    // A status that was on its way before does not count.
    session.exchange(STEP)?;
    session.wait_for(BRING_UP, "bringing up the sensors", |status| {
        status.state == SystemState::Ready as u8
    })?;
    Ok(())
}

/// Sends the scales and zeros of a calibrated rig to the board, reads them back and compares.
/// `zeros`: unit and code of the zeros to put in force (units without one keep the board's).
/// Returns how many units the board has.
///
/// # Errors
/// The board refuses it, does not come up, or reads back something else.
pub fn push(session: &mut Session<'_>, rig: &Rig, zeros: &[(u8, i32)]) -> Result<usize> {
    let before = session.get_configs()?;
    let mut wanted = rig.units.map(|unit| unit.to_wire());
    for (i, config) in wanted.iter_mut().enumerate() {
        config.zero_code = before[i].zero_code;
        config.enabled = before[i].enabled || before[i].zero_code == 0;
        if !rig.has_measured_gain(i) && before[i].zero_code != 0 {
            config.scale_pn_per_count = before[i].scale_pn_per_count;
        }
        if let Some((_, zero)) = zeros.iter().find(|(unit, _)| *unit == rig.units[i].number) {
            config.zero_code = *zero;
        }
        config.enabled &= rig.units[i].enabled;
    }
    configure(session, rig, &wanted)?;
    let now = session.get_configs()?;
    let wrong: Vec<String> = (0..now.len())
        .filter(|&i| now[i] != wanted[i])
        .map(|i| (i + 1).to_string())
        .collect();
    if !wrong.is_empty() {
        return Err(CalibrateError::ReadBack(wrong.join(", ")));
    }
    Ok(now.iter().filter(|config| config.enabled).count())
}

/// The codes of all units over a time. `progress` gets the part that is over, 0 to 1.
///
/// # Errors
/// The link, or `stop` was set.
pub fn codes(
    session: &mut Session<'_>,
    duration: Duration,
    stop: &AtomicBool,
    progress: &mut dyn FnMut(f64),
) -> Result<[Vec<i32>; UNITS]> {
    let _ = session.drain();
    let mut out: [Vec<i32>; UNITS] = std::array::from_fn(|_| Vec::new());
    let mut passed = Duration::ZERO;
    while passed < duration {
        if stop.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted.into());
        }
        let step = STEP.min(duration - passed);
        session.exchange(step)?;
        passed += step;
        for timed in session.drain().samples {
            if let Some(codes) = out.get_mut(usize::from(timed.sample.unit)) {
                codes.push(timed.sample.adc_code);
            }
        }
        progress(passed.as_secs_f64() / duration.as_secs_f64());
    }
    Ok(out)
}

/// Positions of the encoders, counts; `None` where a unit sends no sample.
///
/// # Errors
/// The link.
pub fn encoders(session: &mut Session<'_>) -> Result<[Option<i32>; UNITS]> {
    let _ = session.drain();
    session.exchange(STEP)?;
    let mut out = [None; UNITS];
    for timed in session.drain().samples {
        if let Some(newest) = out.get_mut(usize::from(timed.sample.unit)) {
            *newest = Some(timed.sample.encoder_counts);
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use session::link::{fast::FastRig, EmbeddedOptions};

    #[test]
    fn a_board_that_was_just_switched_on_is_brought_up_and_read() {
        let rig = Rig::built_in().unwrap();
        let mut link = FastRig::open(&EmbeddedOptions::default()).unwrap();
        let mut session = Session::connect(&mut link).unwrap();
        prepare(&mut session, &rig).unwrap();
        let stop = AtomicBool::new(false);
        let mut last = 0.0;
        let second = Duration::from_secs(1);
        let found = codes(&mut session, second, &stop, &mut |part| last = part).unwrap();
        for codes in &found {
            assert!((300..340).contains(&codes.len()), "{}", codes.len());
        }
        assert!((last - 1.0).abs() < 1e-9);
        stop.store(true, Ordering::Relaxed);
        assert!(codes(&mut session, second, &stop, &mut |_| {}).is_err());
    }
}
