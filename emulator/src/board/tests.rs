//! Tests of the board: wiring, injections, complaints.

use super::*;
use crate::wiring;
use emulator_link::{DacResetPull, Injection};
use plant::PlantConfig;

fn board() -> Board {
    Board::new(Plant::new(PlantConfig::default(), 1).unwrap(), 1).unwrap()
}

#[test]
fn a_bus_faster_than_400_khz_is_seen() {
    let mut board = board();
    board.i2c_begins(1_000_000, 0x70);
    board.i2c_start(1_022_500, 0x70, false);
    assert!(board.complaints().is_empty());
    board.i2c_begins(2_000_000, 0x70);
    board.i2c_start(2_020_000, 0x70, false);
    assert!(!board.complaints().is_empty());
}

fn select(board: &mut Board, mask: u8) {
    assert!(board.i2c_start(ADDRESS_NS, 0x70, false));
    assert!(board.i2c_write(0, mask));
    board.i2c_stop();
}

fn write(board: &mut Board, register: u8, value: u8) -> bool {
    let done = board.i2c_start(ADDRESS_NS, 0x2A, false)
        && board.i2c_write(0, register)
        && board.i2c_write(0, value);
    board.i2c_stop();
    done
}

fn read(board: &mut Board, register: u8) -> u8 {
    board.i2c_start(ADDRESS_NS, 0x2A, false);
    board.i2c_write(0, register);
    board.i2c_start(ADDRESS_NS, 0x2A, true);
    let byte = board.i2c_read(0);
    board.i2c_stop();
    byte
}

#[test]
fn the_multiplexer_routes() {
    let mut board = board();
    assert!(
        !board.i2c_start(ADDRESS_NS, 0x2A, false),
        "no channel, no converter"
    );
    select(&mut board, 0x02);
    assert!(write(&mut board, 0x01, 0x2F));
    select(&mut board, 0x01);
    assert_eq!(read(&mut board, 0x01), 0x00);
    select(&mut board, 0x02);
    assert_eq!(read(&mut board, 0x01), 0x2F);
    select(&mut board, 0xC0);
    assert!(
        !board.i2c_start(ADDRESS_NS, 0x2A, false),
        "channels 7 and 8 are empty"
    );
}

#[test]
fn several_channels_at_once_are_a_wired_and() {
    let mut board = board();
    select(&mut board, 0x01);
    write(&mut board, 0x01, 0x2F);
    select(&mut board, 0x02);
    write(&mut board, 0x01, 0x37);
    select(&mut board, 0x03);
    assert_eq!(read(&mut board, 0x01), 0x27);
    write(&mut board, 0x01, 0x07);
    select(&mut board, 0x01);
    assert_eq!(read(&mut board, 0x01), 0x07);
}

#[test]
fn a_held_sda_lets_go_after_nine_clocks_or_a_multiplexer_reset() {
    let mut board = board();
    board.take_drives();
    let scl = wiring::I2C_SCL.bit();
    board.inject(Injection::StuckSda).unwrap();
    assert_eq!(board.take_drives(), [(wiring::I2C_SDA, Some(false))]);
    for pulse in 0..9 {
        assert!(board.sda_held(), "pulse {pulse}");
        board.port_changed(0, 1, scl, 0);
        board.port_changed(0, 1, 0, scl);
    }
    assert!(!board.sda_held());
    board.inject(Injection::StuckSda).unwrap();
    board.port_changed(0, 5, wiring::MUX_RST.bit(), 0);
    assert!(!board.sda_held());
}

#[test]
fn a_pressed_emergency_stop_opens_the_loop_and_takes_the_power() {
    let mut board = board();
    let alive = wiring::ALIVE.bit();
    for k in 0..20 {
        board.port_changed(k * 1_000_000, 2, alive, if k % 2 == 0 { alive } else { 0 });
    }
    assert!(board.truth(20_000_000).amplifier_on);
    board.take_drives();
    board.inject(Injection::EStop(true)).unwrap();
    assert_eq!(board.take_drives(), [(wiring::E_STOP, Some(false))]);
    assert!(!board.truth(20_000_000).amplifier_on);
    board.inject(Injection::EStop(false)).unwrap();
    assert!(board.truth(20_000_000).amplifier_on);
    board.advance(40_000_000);
    assert!(
        !board.truth(40_000_000).amplifier_on,
        "the alive line stopped"
    );
}

#[test]
fn bad_injections_are_refused_with_a_reason() {
    let mut board = board();
    let error = board.inject(Injection::UnplugSensor(7)).unwrap_err();
    assert!(error.contains("units are 1 to 6"), "{error}");
    assert!(board.inject(Injection::UnplugSensor(0)).is_err());
    assert!(board.inject(Injection::PullCable(1, f64::NAN)).is_err());
}

#[test]
fn short_strobes_and_contention_on_the_counters_bus_are_seen() {
    let mut board = board();
    let idle = wiring::IDLE[3];
    let all = 0x00FF;
    let data = wiring::CNT_DATA;
    let cs = wiring::CNT_CS[0].bit();
    let selected = (idle & !cs) | wiring::CNT_CD.bit();
    board.port_changed(0, 4, data, 0x1100);
    board.port_changed(0, 3, all, idle);
    board.port_changed(100, 3, all, selected);
    board.port_changed(200, 3, all, selected & !wiring::CNT_WR.bit());
    board.port_changed(240, 3, all, selected);
    board.port_changed(400, 3, all, selected & !wiring::CNT_RD.bit());
    board.data_sampled(440);
    let complaints = board.complaints();
    let seen: Vec<&str> = complaints.iter().map(|(_, what, _)| what).collect();
    assert!(
        seen.iter().any(|what| what.starts_with("WR low")),
        "{seen:?}"
    );
    assert!(
        seen.iter().any(|what| what.starts_with("contention")),
        "{seen:?}"
    );
    assert!(
        seen.iter().any(|what| what.starts_with("data sampled")),
        "{seen:?}"
    );
}

#[test]
fn the_alive_line_and_ldac_reach_the_plant() {
    let mut board = board();
    let alive = wiring::ALIVE.bit();
    let mut t = 0;
    board.spi_set(
        Mode {
            cpol: true,
            cpha: true,
        },
        Some(true),
    );
    let f = wiring::IDLE[5] | wiring::DAC_RST.bit();
    for k in 0..300u64 {
        t = k * 1_000_000;
        board.port_changed(t, 2, alive, if k % 2 == 0 { alive } else { 0 });
        if k == 20 {
            board.port_changed(t, 6, 0x3F, 0x3E);
            board.spi_frame(0x8D00, 16);
            board.port_changed(t, 6, 0x3F, 0x3F);
            board.port_changed(t, 5, 0xF000, f & !wiring::DAC_LDAC.bit());
            board.port_changed(t, 5, 0xF000, f);
        }
    }
    let truth = board.truth(t);
    assert!(
        (truth.dac_v[0] - 1.015_625).abs() < 1e-9,
        "{:?}",
        truth.dac_v
    );
    assert!(truth.tension_n[0] > 5.0, "{:?}", truth.tension_n);
    assert!(truth.tension_n[1] < 1.0);
    assert!(board.complaints().is_empty());
}

/// A load within a word reaches the motor as a voltage that nobody asked for, and is complained
/// about.
#[test]
fn a_load_within_a_word_is_a_wrong_torque() {
    let mut board = board();
    board.spi_set(
        Mode {
            cpol: true,
            cpha: true,
        },
        Some(true),
    );
    let f = wiring::IDLE[5] | wiring::DAC_RST.bit();
    let load = |board: &mut Board| {
        board.port_changed(0, 5, 0xF000, f & !wiring::DAC_LDAC.bit());
        board.port_changed(0, 5, 0xF000, f);
    };
    board.port_changed(0, 6, 0x3F, 0x3E);
    board.spi_frame(0x8D, 8);
    load(&mut board);
    assert!(board.truth(0).dac_v[0] < -9.0, "{:?}", board.truth(0).dac_v);
    assert!(!board.complaints().is_empty());
}

/// The resistor of DAC_RST takes the motors to 0 V with the controller's reset; without it an
/// output stays where it was.
#[test]
fn the_pull_down_of_dac_rst_is_what_a_reset_leaves_at_0_v() {
    for (pull, volts) in [
        (DacResetPull::Down, 0.0),
        (DacResetPull::None, 1.015_625),
        (DacResetPull::Up, 1.015_625),
    ] {
        let mut board = board();
        board.inject(Injection::DacResetPull(pull)).unwrap();
        let mode = Mode {
            cpol: true,
            cpha: true,
        };
        board.spi_set(mode, Some(true));
        let f = wiring::IDLE[5] | wiring::DAC_RST.bit();
        board.port_changed(0, 5, 0xF000, f);
        board.port_changed(0, 6, 0x3F, 0x3E);
        board.spi_frame(0x8D00, 16);
        board.port_changed(0, 6, 0x3F, 0x3F);
        board.port_changed(0, 5, 0xF000, f & !wiring::DAC_LDAC.bit());
        board.port_changed(0, 5, 0xF000, f);
        assert!((board.truth(0).dac_v[0] - 1.015_625).abs() < 1e-9);
        board.controller_reset(1_000);
        let left = board.truth(1_000).dac_v[0];
        assert!((left - volts).abs() < 1e-9, "{pull:?}: {left} V");
    }
}
