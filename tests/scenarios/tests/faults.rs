//! Faults: what is injected, which fault is reported, and what the motors do.

use control::{Fault, MotorState, SystemState};
use emulator_link::Injection;
use session::SessionError;
use test_stand::{all_at_zero, rig, Stand, ZERO_V};
use wire::message::CommandError;
use wire::Command;

/// Mean tension of each cable over half a second. The stand's cells are not calibrated, so a
/// setpoint of 3 N is 3 N give or take some percent.
fn means(stand: &mut Stand<'_>) -> [f64; 6] {
    stand.truth();
    stand.run(0.5);
    let rows = stand.truth();
    std::array::from_fn(|unit| {
        rows.iter().map(|row| row.tension_n[unit]).sum::<f64>() / rows.len() as f64
    })
}

/// The other units hold what they held before.
fn others_hold(stand: &mut Stand<'_>, lost: usize, before: [f64; 6]) {
    stand.truth();
    stand.run(0.5);
    let rows = stand.truth();
    for unit in (0..6).filter(|unit| *unit != lost) {
        let mean = rows.iter().map(|row| row.tension_n[unit]).sum::<f64>() / rows.len() as f64;
        assert!(
            (mean - before[unit]).abs() < 0.05,
            "unit {} holds {mean:.2} N, before {:.2} N",
            unit + 1,
            before[unit]
        );
    }
    assert!(
        rows.iter().all(|row| row.dac_v[lost].abs() < ZERO_V),
        "the lost unit is driven"
    );
}

fn unit_is_lost(injection: Injection, codes: &[Fault]) {
    let mut link = rig(21);
    let mut stand = Stand::armed(&mut link, 3.0);
    let held = means(&mut stand);
    let before = stand.status();
    stand.truth();
    stand.inject(injection);
    let status = stand.wait("unit 3 faults", 0.5, |status| status.units[2].fault != 0);
    let fault = Fault::from_code(status.units[2].fault).expect("a known fault");
    assert!(codes.contains(&fault), "{fault:?}");
    assert_eq!(status.units[2].state, MotorState::Faulted as u8);
    assert_eq!(
        status.state,
        SystemState::Running as u8,
        "the others continue"
    );
    others_hold(&mut stand, 2, held);
    let after = stand.status();
    for unit in [0, 1, 3, 4, 5] {
        assert_eq!(
            after.units[unit].missed,
            before.units[unit].missed,
            "unit {} lost samples",
            unit + 1
        );
    }
    // Plugged in and cleared: the unit comes back, and clearing arms nothing.
    stand.ask(&Command::Disarm);
    stand.session.set_setpoints(None);
    stand.inject(Injection::PlugSensor(3));
    stand.wait("disarmed", 2.0, |status| {
        status.state == SystemState::Ready as u8
    });
    stand.ask(&Command::ClearFaults);
    stand.wait("unit 3 is back", 4.0, |status| {
        status.units[2].state == MotorState::Ready as u8 && status.units[2].fault == 0
    });
    stand.truth();
    stand.run(0.3);
    assert!(
        stand.truth().iter().all(all_at_zero),
        "clearing armed a motor"
    );
}

#[test]
fn an_unplugged_sensor_stops_its_own_unit_only() {
    unit_is_lost(
        Injection::UnplugSensor(3),
        &[Fault::SensorSilent, Fault::SensorReads],
    );
}

#[test]
fn a_converter_that_does_not_acknowledge_stops_its_own_unit_only() {
    unit_is_lost(
        Injection::Nack(3),
        &[Fault::SensorReads, Fault::SensorSilent],
    );
}

#[test]
fn a_stuck_bus_is_freed_and_the_units_continue() {
    let mut link = rig(22);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.inject(Injection::StuckSda);
    stand.run(0.5);
    let status = stand.status();
    assert!(status.bus_recoveries >= 1, "not noticed");
    assert_eq!(status.state, SystemState::Running as u8);
    assert!(
        status.units.iter().all(|unit| unit.fault == 0),
        "{status:?}"
    );
    let samples = status.units.map(|unit| unit.samples);
    stand.run(1.0);
    let after = stand.status();
    for (unit, before) in samples.into_iter().enumerate() {
        let fresh = after.units[unit].samples - before;
        assert!(
            (300..=340).contains(&fresh),
            "unit {}: {fresh} samples in a second",
            unit + 1
        );
    }
}

#[test]
fn the_emergency_stop_takes_all_motors_to_zero() {
    let mut link = rig(23);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.truth();
    stand.inject(Injection::EStop(true));
    stand.run(0.1);
    let rows = stand.truth();
    // The first row is a millisecond after the button.
    assert!(
        rows.iter().skip(2).all(all_at_zero),
        "not at 0 V after 2 ms"
    );
    let status = stand.wait("the fault is latched", 0.2, |status| status.fault != 0);
    assert_eq!(Fault::from_code(status.fault), Some(Fault::EStop));
    assert!(!status.estop_closed);
    // Cleared with the button still pressed: it stays.
    let _ = stand.session.command(&Command::ClearFaults);
    stand.run(0.1);
    assert_ne!(stand.status().fault, 0, "forgotten with the loop open");
    let refused = stand.session.command(&Command::Arm);
    assert!(
        matches!(refused, Err(SessionError::Refused { .. })),
        "armed with the loop open"
    );
    stand.inject(Injection::EStop(false));
    stand.run(0.1);
    assert_ne!(
        stand.status().fault,
        0,
        "releasing the button alone must not clear"
    );
    stand.session.set_setpoints(None);
    stand.ask(&Command::ClearFaults);
    stand.wait("ready again", 4.0, |status| {
        status.fault == 0 && status.state == SystemState::Ready as u8
    });
    stand.truth();
    stand.run(0.2);
    assert!(
        stand.truth().iter().all(all_at_zero),
        "clearing armed a motor"
    );
}

#[test]
fn a_silent_host_stops_the_rig() {
    let mut link = rig(24);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.truth();
    stand.session.set_setpoints(None);
    stand.run(0.3);
    let rows = stand.truth();
    assert!(
        !all_at_zero(&rows[50]),
        "stopped before the setpoints expired"
    );
    assert!(
        rows.iter().skip(125).all(all_at_zero),
        "not at 0 V 125 ms after the last setpoints"
    );
    let status = stand.status();
    assert_eq!(
        Fault::from_code(status.fault),
        Some(Fault::SetpointsExpired)
    );
}

#[test]
fn stop_is_latched() {
    let mut link = rig(25);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.ask(&Command::Stop);
    stand.truth();
    stand.run(0.3);
    assert!(
        stand.truth().iter().skip(2).all(all_at_zero),
        "setpoints after a stop drove a motor"
    );
    assert_eq!(
        Fault::from_code(stand.status().fault),
        Some(Fault::HostStop)
    );
    let refused = stand.session.command(&Command::Arm);
    assert!(
        matches!(
            refused,
            Err(SessionError::Refused {
                refusal: CommandError::Faulted(_),
                ..
            })
        ),
        "armed with a latched fault: {refused:?}"
    );
}

#[test]
fn a_pulled_cable_is_over_tension() {
    let mut link = rig(26);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.inject(Injection::PullCable(4, 25.0));
    let status = stand.wait("unit 4 faults", 0.5, |status| status.units[3].fault != 0);
    assert_eq!(
        Fault::from_code(status.units[3].fault),
        Some(Fault::OverTension)
    );
    stand.truth();
    stand.run(0.1);
    assert!(stand.truth().iter().all(|row| row.dac_v[3].abs() < ZERO_V));
}

#[test]
fn a_hung_loop_is_reset_by_the_watchdog_and_reported() {
    let mut link = rig(27);
    {
        let mut stand = Stand::armed(&mut link, 3.0);
        stand.truth();
        stand.inject(Injection::HangLoop);
        let mut error = None;
        for _ in 0..100 {
            if let Err(stop) = stand.session.exchange(session::PERIOD) {
                error = Some(stop);
                break;
            }
        }
        let error = error.expect("the session notices").to_string();
        assert!(error.contains("reset"), "{error}");
        let rows = stand.truth();
        let last = rows.last().expect("rows");
        assert!(all_at_zero(last), "a motor is driven after the reset");
    }
    let stand = Stand::connect(&mut link);
    let record = stand
        .session
        .info()
        .and_then(|info| info.crash_record.clone())
        .expect("a crash record");
    assert_eq!(Fault::from_code(record.code), Some(Fault::WatchdogReset));
}

#[test]
fn a_spike_is_not_a_force() {
    let mut link = rig(28);
    let mut stand = Stand::armed(&mut link, 3.0);
    let before = stand.status().units[1].spikes;
    stand.truth();
    // 1,000,000 codes are about 7 N.
    stand.inject(Injection::Spike(2, 1_000_000));
    stand.run(0.3);
    assert!(stand.status().units[1].spikes > before, "not noticed");
    let worst = stand
        .truth()
        .iter()
        .map(|row| (row.tension_n[1] - 3.0).abs())
        .fold(0.0, f64::max);
    assert!(worst < 0.4, "the motor answered a spike: {worst:.2} N");
}

#[test]
fn a_lost_encoder_is_noticed_by_what_the_tension_does() {
    let mut link = rig(29);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.inject(Injection::FreezeEncoder(5, true));
    stand.robot(true);
    let status = stand.wait("unit 5 faults", 3.0, |status| status.units[4].fault != 0);
    let fault = Fault::from_code(status.units[4].fault);
    assert_eq!(fault, Some(Fault::EncoderStill));
    assert_eq!(
        status.state,
        SystemState::Running as u8,
        "the others continue"
    );
    stand.truth();
    stand.run(0.2);
    assert!(stand.truth().iter().all(|row| row.dac_v[4].abs() < ZERO_V));
    // The swing may have been the load cell's: nothing tells whether the cable has let go.
    assert_eq!(stand.status().fault, Fault::OutputStuck.code());
}

#[test]
fn disarming_ramps_down() {
    let mut link = rig(30);
    let mut stand = Stand::armed(&mut link, 4.0);
    stand.truth();
    stand.ask(&Command::Disarm);
    stand.session.set_setpoints(None);
    stand.wait("ready again", 3.0, |status| {
        status.state == SystemState::Ready as u8
    });
    let rows = stand.truth();
    let steepest = rows
        .windows(2)
        .map(|pair| (pair[1].dac_v[0] - pair[0].dac_v[0]).abs())
        .fold(0.0, f64::max);
    // 4 N are 0.34 V: a ramp takes it in many steps.
    assert!(steepest < 0.15, "a step of {steepest:.3} V");
    stand.run(0.1);
    assert!(stand.truth().last().is_some_and(all_at_zero));
    assert_eq!(stand.status().fault, 0, "disarming is no fault");
}
