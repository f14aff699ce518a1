//! The link with wrong input: another protocol version, random bytes, values out of range.

use session::link::RigLink;
use session::SessionError;
use test_stand::{all_at_zero, rig, rig_file, Stand, MS};
use wire::message::{CommandError, FilterChoice, Response, UnitSetpoint};
use wire::{BoardFrame, BoardMessage, Command, Decoder, HostFrame, MAX_FRAME, SCHEMA_HASH, UNITS};

/// Sends one frame without a session and returns the response that carries its number.
fn ask(
    link: &mut dyn RigLink,
    decoder: &mut Decoder,
    seq: u16,
    command: Command,
) -> Option<Response> {
    let mut frame = [0; MAX_FRAME];
    let length = wire::encode(&HostFrame { seq, command }, &mut frame).expect("fits");
    let mut bytes = frame[..length].to_vec();
    for _ in 0..300 {
        let received = link.exchange(&bytes, MS).expect("the rig is there");
        bytes.clear();
        for byte in received.from_board {
            if let Ok(Some(BoardFrame {
                message: BoardMessage::Reply(reply),
                ..
            })) = decoder.push(byte)
            {
                if reply.seq == seq {
                    return Some(reply.response);
                }
            }
        }
    }
    None
}

#[test]
fn a_host_of_another_version_gets_the_boards_version_and_no_access() {
    let mut link = rig(41);
    let mut decoder = Decoder::new();
    // What comes before the board has booted is lost.
    link.exchange(&[], 500 * MS).expect("the rig is there");
    let hello = Command::Hello {
        abi: wire::ABI_VERSION + 1,
        schema: SCHEMA_HASH,
    };
    let mine = CommandError::Version {
        abi: wire::ABI_VERSION,
        schema: SCHEMA_HASH,
    };
    assert_eq!(
        ask(&mut link, &mut decoder, 1, hello),
        Some(Response::Rejected(mine))
    );
    let hello = Command::Hello {
        abi: wire::ABI_VERSION,
        schema: [0xA5; 8],
    };
    assert_eq!(
        ask(&mut link, &mut decoder, 2, hello),
        Some(Response::Rejected(mine))
    );
    for (seq, command) in [
        (3, Command::Arm),
        (4, Command::Disarm),
        (5, Command::Zero { units: 63 }),
    ] {
        let answer = ask(&mut link, &mut decoder, seq, command);
        assert_eq!(answer, Some(Response::Rejected(CommandError::NotConnected)));
    }
}

#[test]
fn garbage_on_the_line_does_no_harm() {
    let mut link = rig(42);
    // A fixed walk through all kinds of bytes, zeros among them.
    let mut x = 0x2545_F491u32;
    let noise: Vec<u8> = (0..40_000)
        .map(|_| {
            x ^= x << 13;
            x ^= x >> 17;
            x ^= x << 5;
            (x >> 11) as u8
        })
        .collect();
    let mut driven = false;
    for chunk in noise.chunks(400) {
        let received = link.exchange(chunk, 2 * MS).expect("the rig is there");
        assert_eq!(received.resets, 0, "garbage reset the board");
        driven |= !received.truth.iter().all(all_at_zero);
    }
    assert!(!driven, "garbage drove a motor");
    let mut stand = Stand::ready(&mut link);
    assert!(
        stand.status().frames_bad > 50,
        "the board counts what it dropped"
    );
}

#[test]
fn setpoints_out_of_range_drive_nothing() {
    let mut link = rig(43);
    let mut stand = Stand::ready(&mut link);
    stand.ask(&Command::Arm);
    for (tension_un, inv_cos_q16) in [
        (i32::MAX, 1 << 16),
        (-5_000_000, 1 << 16),
        (3_000_000, 0),
        (3_000_000, -1),
        (3_000_000, i32::MAX),
    ] {
        stand.session.set_setpoints(Some(
            [UnitSetpoint {
                tension_un,
                inv_cos_q16,
                direction_q14: [0; 3],
                reel_um_per_s: None,
            }; UNITS],
        ));
        stand.truth();
        let refused = (0..5).filter(|_| match stand.session.exchange(session::PERIOD) {
            Err(SessionError::Refused { .. }) => true,
            other => other.map(|()| false).expect("the session goes on"),
        });
        assert_eq!(refused.count(), 1, "{tension_un} uN, 1/cos {inv_cos_q16}");
        assert!(
            stand.truth().iter().all(all_at_zero),
            "{tension_un} uN, 1/cos {inv_cos_q16}: a motor is driven"
        );
    }
}

#[test]
fn a_configuration_out_of_range_is_refused_by_field() {
    let mut link = rig(44);
    let mut stand = Stand::ready(&mut link);
    let good = rig_file().units[0].to_wire();
    let mut worse = Vec::new();
    let mut bad = good;
    bad.kp_q16 = i32::MAX;
    worse.push(bad);
    let mut bad = good;
    bad.filter = FilterChoice::MovingAverage(0);
    worse.push(bad);
    let mut bad = good;
    bad.force_limit_un = -1;
    worse.push(bad);
    for config in worse {
        let refused = stand
            .session
            .command(&Command::StageConfig { unit: 2, config });
        assert!(
            matches!(
                refused,
                Err(SessionError::Refused {
                    refusal: CommandError::Range { unit: 2, .. },
                    ..
                })
            ),
            "{refused:?}"
        );
    }
    let refused = stand.session.command(&Command::StageConfig {
        unit: 6,
        config: good,
    });
    assert!(
        matches!(
            refused,
            Err(SessionError::Refused {
                refusal: CommandError::UnknownUnit(6),
                ..
            })
        ),
        "{refused:?}"
    );
}

#[test]
fn a_configuration_is_not_changed_while_armed() {
    let mut link = rig(45);
    let mut stand = Stand::armed(&mut link, 3.0);
    let config = rig_file().units[0].to_wire();
    for command in [
        Command::StageConfig { unit: 0, config },
        Command::CommitConfig,
        Command::Zero { units: 63 },
    ] {
        let refused = stand.session.command(&command);
        assert!(
            matches!(
                refused,
                Err(SessionError::Refused {
                    refusal: CommandError::State(_),
                    ..
                })
            ),
            "{refused:?}"
        );
    }
}
