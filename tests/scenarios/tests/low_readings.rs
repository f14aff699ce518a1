//! Load cells and outputs that cannot be believed: the true tension stays below what the robot
//! bears, and the motor stops.

use control::let_go::TRIAL_MS;
use control::{Fault, MotorState, SystemState};
use emulator_link::Injection;
use test_stand::{all_at_zero, rig, Stand, ZERO_V};
use wire::Command;

/// What a cable may pull, N.
const HAZARD_N: f64 = 13.0;

/// Injects at 6 N on every cable; unit 3 must fault with one of `codes`, its true tension must
/// never pass the hazard, and its output must be at 0 V once the fault is latched. Returns the
/// state of the board 0.2 s later.
fn unit_3_stops(seed: u64, injection: Injection, then_n: f64, codes: &[Fault]) -> SystemState {
    let mut link = rig(seed);
    let mut stand = Stand::armed(&mut link, 6.0);
    stand.truth();
    stand.inject(injection);
    stand.hold([then_n; 6]);
    let status = stand.wait("unit 3 faults", 3.0, |status| status.units[2].fault != 0);
    let fault = Fault::from_code(status.units[2].fault).expect("a known fault");
    assert!(codes.contains(&fault), "{fault:?}");
    let rows = stand.truth();
    let most = rows.iter().map(|row| row.tension_n[2]).fold(0.0, f64::max);
    assert!(most < HAZARD_N, "{most:.1} N");
    stand.run(0.2);
    let rows = stand.truth();
    assert!(rows.iter().all(|row| row.dac_v[2].abs() < ZERO_V));
    let status = stand.status();
    if status.state == SystemState::Running as u8 {
        SystemState::Running
    } else {
        assert_eq!(status.fault, Fault::OutputStuck.code());
        assert!(status.alive_withheld);
        assert!(stand.truth().last().is_some_and(|row| !row.amplifier_on));
        SystemState::Fault
    }
}

#[test]
fn an_open_excitation_wire() {
    let codes = [
        Fault::Implausible,
        Fault::TensionNegative,
        Fault::CommandAtLimit,
    ];
    let state = unit_3_stops(61, Injection::OpenBridge(3, true), 6.0, &codes);
    assert_eq!(state, SystemState::Running);
}

#[test]
fn a_frozen_code() {
    let codes = [Fault::SensorFrozen];
    let state = unit_3_stops(62, Injection::FrozenCode(3, true), 9.0, &codes);
    assert_eq!(state, SystemState::Running);
}

#[test]
fn exchanged_signal_wires() {
    let codes = [Fault::TensionNegative, Fault::Implausible];
    let state = unit_3_stops(63, Injection::WrongSign(3, true), 6.0, &codes);
    assert_eq!(state, SystemState::Running);
}

/// A motor without force lets no cable go when it is switched to 0 V. Nothing that is measured
/// tells it from a load cell that reads too little in front of a stuck output, unless the reel
/// still pays out: the others continue then, or all stop.
#[test]
fn an_amplifier_that_is_off() {
    let codes = [Fault::Implausible, Fault::CommandAtLimit];
    unit_3_stops(64, Injection::AmplifierOff(3, true), 6.0, &codes);
}

/// The load cell reads too little and the output is stuck: the cell says that the cable has let go.
#[test]
fn a_stuck_dac_behind_a_load_cell_that_reads_low_loses_the_power() {
    let mut link = rig(69);
    let mut stand = Stand::armed(&mut link, 6.0);
    stand.inject(Injection::StuckDac(4, true));
    stand.inject(Injection::OpenBridge(4, true));
    stand.truth();
    stand.run(0.6);
    let rows = stand.truth();
    assert!(rows[0].dac_v[3] > 0.1, "the injection does nothing");
    assert!(rows.last().is_some_and(|row| !row.amplifier_on));
    let most = rows.iter().map(|row| row.tension_n[3]).fold(0.0, f64::max);
    assert!(most < HAZARD_N, "{most:.1} N");
}

#[test]
fn a_preload_of_15_n_is_no_zero() {
    let mut link = rig(65);
    let mut stand = Stand::ready(&mut link);
    // At once after the power came back, a cable that tightens is a stuck output.
    stand.run(f64::from(TRIAL_MS) * 1e-3);
    stand.inject(Injection::PullCable(2, 15.0));
    stand.run(0.1);
    stand.ask(&Command::Zero { units: 0b11_1111 });
    let status = stand.wait("unit 2 refuses its zero", 3.0, |status| {
        status.units[1].fault != 0
    });
    assert_eq!(status.units[1].fault, Fault::ZeroRefused.code());
    assert_eq!(status.units[0].fault, 0);
}

#[test]
fn a_stuck_dac_loses_the_amplifiers_power() {
    let mut link = rig(66);
    let mut stand = Stand::armed(&mut link, 6.0);
    stand.inject(Injection::StuckDac(4, true));
    stand.ask(&Command::Stop);
    stand.truth();
    stand.run(0.5);
    let rows = stand.truth();
    assert!(rows[0].dac_v[3] > 0.1, "the injection does nothing");
    let off = rows.iter().position(|row| !row.amplifier_on);
    let off = off.expect("the PLC still gives power");
    assert!(off < 200, "{off} ms");
    assert!(rows.last().expect("rows").tension_n[3] < 2.0);
    let status = stand.status();
    assert!(status.alive_withheld);
    // Not repaired: with the clear the motor pulls again, and loses its power again.
    stand.session.set_setpoints(None);
    stand.ask(&Command::ClearFaults);
    stand.truth();
    stand.run(0.6);
    let rows = stand.truth();
    assert!(rows.iter().any(|row| row.amplifier_on));
    assert!(rows.last().is_some_and(|row| !row.amplifier_on));
    assert_eq!(stand.status().fault, Fault::OutputStuck.code());
    // Repaired: the power comes back with the clear, and nothing is driven.
    stand.inject(Injection::StuckDac(4, false));
    stand.ask(&Command::ClearFaults);
    stand.truth();
    stand.run(0.3);
    let rows = stand.truth();
    assert!(rows
        .last()
        .is_some_and(|row| row.amplifier_on && all_at_zero(row)));
}

/// The same behind a load cell that reads nothing: the unit faults too, and a clear starts its
/// converter anew. For 0.65 s nothing is measured then, and the motor must have no power.
#[test]
fn a_clear_of_a_units_fault_gives_a_stuck_dac_no_power_that_it_keeps() {
    for broken in [Injection::OpenBridge(4, true), Injection::UnplugSensor(4)] {
        let mut link = rig(66);
        let mut stand = Stand::armed(&mut link, 6.0);
        stand.inject(Injection::StuckDac(4, true));
        stand.inject(broken);
        stand.run(0.6);
        assert!(stand.status().alive_withheld);
        stand.session.set_setpoints(None);
        if let Injection::UnplugSensor(unit) = broken {
            stand.inject(Injection::PlugSensor(unit));
        }
        // Of two clears the second does not find the first one's fault alone.
        for _ in 0..2 {
            let _ = stand.session.command(&Command::ClearFaults);
            stand.truth();
            stand.run(2.0);
            let rows = stand.truth();
            let most = rows.iter().map(|row| row.tension_n[3]).fold(0.0, f64::max);
            assert!(most < HAZARD_N, "{most:.1} N");
            let powered = rows.iter().filter(|row| row.amplifier_on).count();
            assert!(powered < 150, "{powered} ms of power");
            assert!(rows.last().is_some_and(|row| !row.amplifier_on));
        }
    }
}

/// A unit loses its load cell while its DAC is stuck: only the encoder shows that the cable is
/// still held.
#[test]
fn a_stuck_dac_behind_a_lost_sensor_loses_the_power_too() {
    let mut link = rig(67);
    let mut stand = Stand::armed(&mut link, 6.0);
    stand.inject(Injection::StuckDac(4, true));
    stand.inject(Injection::UnplugSensor(4));
    stand.truth();
    stand.run(0.5);
    let rows = stand.truth();
    assert!(rows.last().is_some_and(|row| !row.amplifier_on));
    // The same without the stuck DAC: the others continue.
    let mut link = rig(67);
    let mut stand = Stand::armed(&mut link, 6.0);
    stand.inject(Injection::UnplugSensor(4));
    stand.run(0.5);
    let status = stand.status();
    assert!(!status.alive_withheld);
    assert_eq!(status.units[3].state, MotorState::Faulted as u8);
    assert_eq!(status.state, SystemState::Running as u8);
}

#[test]
fn the_tip_force_of_the_board_is_the_true_one() {
    let mut link = rig(68);
    let mut stand = Stand::armed(&mut link, 3.0);
    stand.hold([3.0, 3.0, 6.0, 3.0, 3.0, 3.0]);
    stand.run(1.0);
    stand.truth();
    stand.run(0.05);
    let truth = stand.truth().last().expect("rows").tip_force_n;
    let board = stand.status().tip_force_un.map(|un| f64::from(un) * 1e-6);
    for axis in 0..3 {
        // The stand's cells are not calibrated: 4 % of the tensions.
        let error = board[axis] - truth[axis];
        assert!(error.abs() < 0.6, "{board:?} {truth:?}");
    }
    assert!(board[1] > 2.0, "{board:?}");
}
