//! Detections that another one would hide: each scenario fails where its detection alone is
//! switched off (`cargo xtask mutants`).

use control::{Fault, MotorState};
use emulator_link::Injection;
use session::link::RigLink;
use test_stand::{all_at_zero, rig, Stand, MS, ZERO_V};
use wire::{BoardFrame, BoardMessage, Command, Decoder, HostFrame, MAX_FRAME};

/// Far more than the load cell's range, at once: the converter is at its end before anything else
/// is certain.
#[test]
fn a_converter_at_the_end_of_its_range_stops_its_unit() {
    let mut link = rig(71);
    let mut stand = Stand::armed_for(&mut link, 3.0, 0.4);
    stand.inject(Injection::PullCable(5, 200.0));
    let status = stand.wait("unit 5 faults", 0.2, |status| status.units[4].fault != 0);
    assert_eq!(
        Fault::from_code(status.units[4].fault),
        Some(Fault::AdcSaturated)
    );
    assert_eq!(status.units[4].state, MotorState::Faulted as u8);
    stand.truth();
    stand.run(0.1);
    assert!(stand.truth().iter().all(|row| row.dac_v[4].abs() < ZERO_V));
}

#[test]
fn a_spi_that_stops_takes_the_motors_to_zero_and_the_power_away() {
    let mut link = rig(72);
    let mut stand = Stand::armed_for(&mut link, 3.0, 0.4);
    stand.truth();
    stand.inject(Injection::StopSpi(true));
    stand.run(0.1);
    let rows = stand.truth();
    let driven = rows.iter().rposition(|row| !all_at_zero(row));
    // A word that is begun with a tick is late one tick after.
    assert!(driven.is_none_or(|last| last < 4), "driven: row {driven:?}");
    assert!(rows.last().is_some_and(|row| !row.amplifier_on));
    let status = stand.status();
    assert_eq!(Fault::from_code(status.fault), Some(Fault::DacLink));
    assert!(status.alive_withheld);
}

/// Answers of the board to these bytes, which come after `wait_ms` milliseconds.
fn answers(link: &mut dyn RigLink, decoder: &mut Decoder, bytes: &[u8], wait_ms: u32) -> Vec<u16> {
    let mut seen = Vec::new();
    let mut bytes = bytes.to_vec();
    for _ in 0..wait_ms {
        let received = link.exchange(&bytes, MS).expect("the rig is there");
        bytes.clear();
        for byte in received.from_board {
            if let Ok(Some(BoardFrame {
                message: BoardMessage::Reply(reply),
                ..
            })) = decoder.push(byte)
            {
                seen.push(reply.seq);
            }
        }
    }
    seen
}

#[test]
fn a_frame_with_a_wrong_checksum_is_dropped_and_counted() {
    let mut link = rig(73);
    let mut decoder = Decoder::new();
    // What comes before the board has booted is lost.
    link.exchange(&[], 500 * MS).expect("the rig is there");
    let frame = |seq| {
        let mut frame = [0; MAX_FRAME];
        let command = Command::GetStatus;
        let length = wire::encode(&HostFrame { seq, command }, &mut frame).expect("fits");
        frame[..length].to_vec()
    };
    assert_eq!(answers(&mut link, &mut decoder, &frame(7), 50), [7]);
    // The number of the frame is the first byte behind the one of COBS; another number is as good a
    // frame but for its checksum.
    let mut damaged = frame(8);
    let at = damaged
        .iter()
        .position(|byte| *byte == 8)
        .expect("the number");
    damaged[at] = 9;
    let none: Vec<u16> = Vec::new();
    assert_eq!(answers(&mut link, &mut decoder, &damaged, 50), none);
    let mut stand = Stand::connect(&mut link);
    assert_eq!(stand.status().frames_bad, 1);
}

#[test]
fn the_watchdog_resets_within_its_time_while_interrupts_go_on() {
    let mut link = rig(74);
    drop(Stand::armed_for(&mut link, 3.0, 0.4));
    let before = link.exchange(&[], MS).expect("the rig is there").resets;
    link.controls()
        .expect("an embedded rig")
        .inject(Injection::HangLoop)
        .unwrap_or_else(|error| panic!("{error}"));
    // 50 ms after the last feed, which was up to 10 ms before.
    let early = link.exchange(&[], 38 * MS).expect("the rig is there");
    assert_eq!(early.resets, before, "reset too early");
    let late = link.exchange(&[], 27 * MS).expect("the rig is there");
    assert_eq!(late.resets, before + 1, "not reset in time");
    let after = link.exchange(&[], 20 * MS).expect("the rig is there");
    assert!(after.truth.iter().all(all_at_zero), "driven after a reset");
}
