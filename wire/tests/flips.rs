//! Every flip of one bit, and of two bits, in every kind of frame: none is taken for a message.

use serde::{de::DeserializeOwned, Serialize};
use wire::message::*;
use wire::{encode, Decoder, ABI_VERSION, MAX_FRAME, SCHEMA_HASH, UNITS};

/// Messages that come out of these bytes.
fn accepted<T: DeserializeOwned>(bytes: &[u8]) -> usize {
    let mut decoder = Decoder::new();
    bytes
        .iter()
        .filter(|byte| matches!(decoder.push::<T>(**byte), Ok(Some(_))))
        .count()
}

/// All flips of one and of two bits of a frame, its closing zero included.
fn no_flip_passes<T: Serialize + DeserializeOwned>(frame: &T, what: &str) {
    let mut room = [0; MAX_FRAME];
    let length = encode(frame, &mut room).expect("fits");
    let mut bytes = room[..length].to_vec();
    assert_eq!(accepted::<T>(&bytes), 1, "{what}");
    let flip = |bytes: &mut [u8], bit: usize| bytes[bit / 8] ^= 1 << (bit % 8);
    for first in 0..8 * length {
        flip(&mut bytes, first);
        assert_eq!(accepted::<T>(&bytes), 0, "{what}: bit {first}");
        for second in first + 1..8 * length {
            flip(&mut bytes, second);
            assert_eq!(accepted::<T>(&bytes), 0, "{what}: bits {first}, {second}");
            flip(&mut bytes, second);
        }
        flip(&mut bytes, first);
    }
}

fn config() -> UnitConfig {
    UnitConfig {
        enabled: true,
        scale_pn_per_count: 6_850_000,
        zero_code: -12_345,
        stored_zero_code: 700_000,
        zero_deviation_un: 1_000_000,
        filter: FilterChoice::LowPass { corner_chz: 10_000 },
        spike_limit_un: 1_000_000,
        kp_q16: 19_661,
        ki_q16: 1_310_720,
        kd_q16: 0,
        damping_q16: 7_208_960,
        friction_feedforward: true,
        friction_offset_un: 155_000,
        friction_gain_q16: 66_716,
        coulomb_un: 909_000,
        coulomb_load_q16: 10_093,
        reversal_nm: 100_000,
        travel_nm_per_count: -4_229,
        dac_counts_per_n_q16: 18_495_479,
        force_limit_un: 16_000_000,
        authority_un: 4_000_000,
        plausible_un: 2_500_000,
        slew_un_per_s: 400_000_000,
        over_tension_un: 20_000_000,
        viscous_q16: 0,
        ripples: [Ripple::default(); RIPPLES],
        cell: CellCorrection::NONE,
        tension_max_un: 12_000_000,
        leaky_ki_q16: 1_966_080,
    }
}

#[test]
fn commands() {
    let setpoint = UnitSetpoint {
        tension_un: 3_000_000,
        inv_cos_q16: 66_000,
        direction_q14: [DIRECTION_ONE, 0, -1],
        reel_um_per_s: None,
    };
    let commands = [
        Command::Hello {
            abi: ABI_VERSION,
            schema: SCHEMA_HASH,
        },
        Command::GetStatus,
        Command::GetConfig { unit: 3 },
        Command::StageConfig {
            unit: 1,
            config: config(),
        },
        Command::StageBoard {
            config: BoardConfig::default(),
        },
        Command::GetBoard,
        Command::CommitConfig,
        Command::Zero { units: 0b11_1111 },
        Command::Arm,
        Command::Disarm,
        Command::Stop,
        Command::ClearFaults,
        Command::Setpoints {
            valid_ms: 100,
            units: [setpoint; UNITS],
        },
        Command::Stream { decimation: 1 },
    ];
    for command in commands {
        let what = format!("{command:?}");
        let frame = HostFrame {
            seq: 0x1234,
            command,
        };
        no_flip_passes(&frame, &what);
    }
}

#[test]
fn messages_of_the_board() {
    let unit = UnitStatus {
        state: 3,
        samples: 1_000,
        period_us: 3_120,
        tension_un: 3_012_345,
        adc_code: 440_123,
        encoder_counts: -1_200,
        ..UnitStatus::default()
    };
    let status = Status {
        t_us: 123_456_789,
        state: 4,
        fault: 0,
        fault_detail: 0,
        estop_closed: true,
        units: [unit; UNITS],
        tip_force_un: [1_000_000, -2_000_000, 3],
        alive_withheld: false,
        config_crc: 0xDEAD_BEEF,
        setpoint_age_ms: 7,
        frames_dropped: 0,
        frames_bad: 0,
        bus_recoveries: 0,
        sleep_permille: 930,
        queue_high_water: 3,
    };
    let sample = Sample {
        unit: 2,
        dt_us: 1_500,
        adc_code: 440_123,
        encoder_counts: -1_200,
        dac_code: 0x8654,
        latency_us: 101,
        tension: 30_123,
        setpoint: 30_000,
        p: -36,
        i: 812,
        d: -55,
        ff: 41_234,
        tip_force_mn: 2_500,
        flags: 40,
    };
    let reply = |response| {
        BoardMessage::Reply(Reply {
            seq: 0x4321,
            response,
        })
    };
    let info = BoardInfo {
        abi: ABI_VERSION,
        schema: SCHEMA_HASH,
        version: "0.1.0".try_into().unwrap(),
        core_hz: 400_000_000,
        silicon: 0x2003,
        hse: true,
        reset_flags: 0x0040_0000,
        option_bytes: 0x1006_AAF0,
        unique_id: [0x0031_0025, 0x3039_510D, 0x3431_3737],
        dac_reset_pull: Pull::Down,
        crash_record: None,
    };
    let messages = [
        reply(Response::Done),
        reply(Response::Hello(info)),
        reply(Response::Status(status.clone())),
        reply(Response::Config(config())),
        reply(Response::Board(BoardConfig::default())),
        reply(Response::Rejected(CommandError::Faulted(15))),
        BoardMessage::Samples(Batch {
            t_us: 123_456_789,
            samples: [sample; BATCH].into_iter().collect(),
        }),
        BoardMessage::Status(status),
        BoardMessage::Fault(FaultReport {
            t_us: 5,
            unit: 255,
            code: 16,
            detail: 20_123,
        }),
    ];
    for message in messages {
        let what = format!("{message:?}");
        no_flip_passes(&BoardFrame { seq: 7, message }, &what);
    }
}
