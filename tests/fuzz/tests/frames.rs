//! Frames of both directions, damaged on the line, and well-framed ones whose content nobody would
//! send.

use board::machine::{Effects, Health, LinkCounters, LoopFigures, Machine, LINKS};
use control::{Micros, UnitIndex};
use fuzz::{check, damaged, damages};
use proptest::collection::vec;
use proptest::prelude::any;
use serde::{de::DeserializeOwned, Serialize};
use wire::frame::crc32;
use wire::message::{BoardFrame, BoardInfo, BoardMessage, FaultReport, Response, UnitSetpoint};
use wire::{encode, Command, Decoder, HostFrame, ABI_VERSION, MAX_FRAME, SCHEMA_HASH, UNITS};

fn frame<T: Serialize>(message: &T) -> Vec<u8> {
    let mut room = [0; MAX_FRAME];
    let length = encode(message, &mut room).expect("fits");
    room[..length].to_vec()
}

/// Messages that come out of these bytes.
fn decoded<T: DeserializeOwned>(bytes: &[u8]) -> Vec<T> {
    let mut decoder = Decoder::new();
    let mut bad = 0;
    let mut all = Vec::new();
    for byte in bytes {
        match decoder.push(*byte) {
            Ok(message) => all.extend(message),
            Err(_) => bad += 1,
        }
    }
    assert_eq!(decoder.bad_frames(), bad);
    all
}

fn commands() -> Vec<HostFrame> {
    let setpoint = UnitSetpoint {
        tension_un: 3_000_000,
        inv_cos_q16: 66_000,
        direction_q14: [16_384, 0, 0],
        reel_um_per_s: None,
    };
    let hello = Command::Hello {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
    };
    let setpoints = Command::Setpoints {
        valid_ms: 100,
        units: [setpoint; UNITS],
    };
    let config = Command::StageConfig {
        unit: 2,
        config: control::Config::nominal(),
    };
    [
        hello,
        Command::Arm,
        config,
        Command::CommitConfig,
        setpoints,
    ]
    .into_iter()
    .zip(0..)
    .map(|(command, seq)| HostFrame { seq, command })
    .collect()
}

/// What the machine asks for, forgotten.
struct Nothing;

impl Effects for Nothing {
    fn start_sensor(&mut self, _: UnitIndex) {}
    fn stop_sensor(&mut self, _: UnitIndex) {}
    fn zero_output(&mut self, _: UnitIndex) {}
    fn report(&mut self, _: FaultReport) {}
}

fn machine() -> Machine {
    Machine::new(BoardInfo {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
        version: "0".try_into().expect("short"),
        core_hz: 400_000_000,
        silicon: 0x2003,
        hse: true,
        reset_flags: 0,
        option_bytes: 0,
        unique_id: [0; 3],
        dac_reset_pull: wire::message::Pull::Down,
        crash_record: None,
    })
}

/// Gives frames to a machine, with a millisecond after each.
fn obey(machine: &mut Machine, frames: &[HostFrame]) {
    for (n, frame) in frames.iter().enumerate() {
        let now = Micros(n as u32 * 1_000);
        let figures = LoopFigures::default();
        let counters = LinkCounters::default();
        let response = machine.command(n % LINKS, frame, now, figures, counters, &mut Nothing);
        if let Some(response) = response {
            // Every response must fit into a frame.
            let message = BoardMessage::Reply(wire::message::Reply { seq: 0, response });
            let _ = self::frame(&BoardFrame { seq: 0, message });
        }
        machine.tick(now, Health::default(), &mut Nothing);
    }
}

#[test]
fn damaged_commands_are_dropped_or_are_the_ones_that_were_sent() {
    let line: Vec<u8> = commands().iter().flat_map(frame).collect();
    check(1, damages(), |damages| {
        let frames = decoded::<HostFrame>(&damaged(&line, &damages));
        // A CRC of 32 bits lets one damaged frame in four billion pass; none of these does.
        assert!(frames.iter().all(|frame| commands().contains(frame)));
        obey(&mut machine(), &frames);
    });
}

/// The CRC is right, the content is anything: what a program with errors sends.
#[test]
fn any_content_of_a_command_does_no_harm() {
    let contents: Vec<Vec<u8>> = commands()
        .iter()
        .map(|frame| postcard::to_allocvec(frame).expect("encodes"))
        .collect();
    let case = vec((0..contents.len(), damages()), 1..6);
    check(1, case, |chosen| {
        let mut line = Vec::new();
        for (which, damages) in chosen {
            let mut content = damaged(&contents[which], &damages);
            content.extend(crc32(&content).to_le_bytes());
            let mut framed = vec![0; content.len() + content.len() / 254 + 2];
            let length = cobs_encode(&content, &mut framed);
            line.extend(&framed[..length]);
            line.push(0);
        }
        obey(&mut machine(), &decoded::<HostFrame>(&line));
    });
}

/// COBS (Cheshire and Baker 1999), written here so that the frame is not made by the code under
/// test.
fn cobs_encode(bytes: &[u8], out: &mut [u8]) -> usize {
    let (mut code_at, mut at, mut code) = (0, 1, 1);
    for byte in bytes {
        if *byte != 0 {
            out[at] = *byte;
            at += 1;
            code += 1;
        }
        if *byte == 0 || code == 255 {
            out[code_at] = code;
            (code_at, code) = (at, 1);
            at += 1;
        }
    }
    out[code_at] = code;
    at
}

#[test]
fn damaged_messages_of_the_board_are_dropped_or_are_the_ones_that_were_sent() {
    let status = BoardMessage::Status(machine().status(
        Micros(0),
        LoopFigures::default(),
        LinkCounters::default(),
    ));
    let fault = BoardMessage::Fault(FaultReport {
        t_us: 5,
        unit: 255,
        code: 16,
        detail: 20_123,
    });
    let reply = BoardMessage::Reply(wire::message::Reply {
        seq: 3,
        response: Response::Config(control::Config::nominal()),
    });
    let frames: Vec<BoardFrame> = [status, fault, reply]
        .into_iter()
        .zip(0..)
        .map(|(message, seq)| BoardFrame { seq, message })
        .collect();
    let line: Vec<u8> = frames.iter().flat_map(frame).collect();
    check(1, damages(), |damages| {
        let got = decoded::<BoardFrame>(&damaged(&line, &damages));
        assert!(got.iter().all(|frame| frames.contains(frame)));
    });
}

#[test]
fn any_bytes_at_all() {
    check(1, vec(any::<u8>(), 0..2_000), |bytes| {
        let _ = decoded::<BoardFrame>(&bytes);
        obey(&mut machine(), &decoded::<HostFrame>(&bytes));
    });
}
