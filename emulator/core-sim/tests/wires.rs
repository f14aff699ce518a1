//! Mistakes of wiring on the board's side of the DACs and of the PLC, at every unit.

use core_sim::{CoreRig, Options};
use emulator_link::Injection;

const UNITS: usize = 6;
/// A code whose output is not 0 V.
const CODE: u16 = 0x9000;

fn rig_with(injections: &[Injection]) -> CoreRig {
    let mut rig = CoreRig::new(Options::default()).unwrap();
    for injection in injections {
        rig.inject(*injection).unwrap();
    }
    rig
}

/// Units whose outputs differ from 0 V after a word for `unit` (from 0).
fn moved_by(rig: &mut CoreRig, unit: usize) -> Vec<usize> {
    let now_ns = rig.now_ns();
    rig.board_mut().dac_code(now_ns, unit, CODE);
    let truth = rig.board_mut().truth(now_ns);
    (0..UNITS).filter(|i| truth.dac_v[*i] != 0.0).collect()
}

#[test]
fn a_word_reaches_its_own_dac_unless_a_wire_is_wrong() {
    for unit in 0..UNITS {
        let number = unit as u8 + 1;
        let next = (unit + 1) % UNITS;
        assert_eq!(moved_by(&mut rig_with(&[]), unit), [unit]);
        let mut deaf = rig_with(&[Injection::OpenLdac(number, true)]);
        assert!(moved_by(&mut deaf, unit).is_empty());
        let tied = Injection::TieSelects(number, next as u8 + 1);
        let mut both = [unit, next];
        both.sort_unstable();
        for of in both {
            assert_eq!(moved_by(&mut rig_with(&[tied]), of), both);
        }
        let none = Injection::TieSelects(number, number);
        assert_eq!(moved_by(&mut rig_with(&[tied, none]), unit), [unit]);
    }
}

/// The firmware runs without a host: it is not configured, so its alive line stands still and the
/// PLC gives no power. Here the test moves the line.
fn alive(rig: &mut CoreRig, from_ms: u64) {
    for ms in from_ms..from_ms + 20 {
        rig.board_mut().advance(ms * 1_000_000);
        rig.board_mut().alive_edge(ms * 1_000_000);
    }
}

#[test]
fn the_relay_follows_the_plc_unless_a_wire_is_wrong() {
    use Injection as I;
    // Power before the line moves, with it, with the E-stop pressed.
    let cases: [(&[I], [bool; 3]); 6] = [
        (&[], [false, true, false]),
        (&[I::BridgeRelay(true)], [true, true, true]),
        (&[I::InvertRelay(true)], [true, false, true]),
        (&[I::OpenAlive(true)], [false, false, false]),
        (&[I::UnplugAlive(true)], [false, false, false]),
        (&[I::BridgeEStopAtPlc(true)], [false, true, true]),
    ];
    for (injections, expected) in cases {
        let mut rig = rig_with(injections);
        let before = rig.board().powered();
        alive(&mut rig, 1);
        let with = rig.board().powered();
        rig.inject(I::EStop(true)).unwrap();
        let pressed = rig.board().powered();
        assert_eq!([before, with, pressed], expected, "{injections:?}");
        // None of these is at the board's own input.
        assert!(!rig.board().estop_closed(), "{injections:?}");
    }
    for (injection, closed) in [
        (I::BridgeEStop(true), [true, true]),
        (I::InvertEStop(true), [false, true]),
    ] {
        let mut rig = rig_with(&[injection]);
        let released = rig.board().estop_closed();
        rig.inject(I::EStop(true)).unwrap();
        assert_eq!([released, rig.board().estop_closed()], closed);
    }
}
