//! Single bits of the running image: registers that are known to matter must be noticed by the
//! watch on the registers, and no bit may end in a hazard. `cargo xtask faults --image` runs as
//! many drawn bits as wanted.

use control::{Fault, SystemState};
use emulator_link::Injection;
use faults::outcome::TENSION_N;
use scenarios::image_faults::{table, Plan, Stage};
use test_stand::{all_at_zero, rig, Stand};
use wire::Command;

/// CPHA of SPI1_CFG2 (RM0433 section 50.11.4): every DAC takes another word than was sent.
const SPI1_CFG2: u32 = 0x4001_300C;
const CPHA: u8 = 24;

/// Registers that matter, with a bit of each (RM0433 sections 50.11, 11.4, 8.7, 12.3, 20.6, 38.4).
const KNOWN: [(&str, u32, u8); 9] = [
    ("SPI1_CFG2 CPHA", SPI1_CFG2, CPHA),
    ("SPI1_CFG2 LSBFRST", SPI1_CFG2, 23),
    ("SPI1_CFG1 DSIZE", 0x4001_3008, 1),
    ("GPIOF_OSPEEDR, RST of the DACs", 0x5802_1408, 30),
    ("GPIOG_MODER, CS of DAC 1", 0x5802_1800, 1),
    ("RCC_D1CCIPR", 0x5802_444C, 0),
    ("SYSCFG_EXTICR2", 0x5800_040C, 12),
    ("EXTI_FTSR1, DRDY 3", 0x5800_0004, 2),
    ("TIM2_PSC", 0x4000_0028, 5),
];

/// Those that the board puts right by itself: SPI1 and pins.
const PUT_RIGHT: [u32; 4] = [SPI1_CFG2, 0x4001_3008, 0x5802_1408, 0x5802_1800];

/// Those that are compared each millisecond.
const EACH_TICK: [u32; 2] = [SPI1_CFG2, 0x4001_3008];

/// Cases of the campaign that `cargo xtask test` runs, and how long each is watched: longer than a
/// turn of the watch on the registers.
const DRAWN: u64 = 12;
const WATCH_MS: u32 = 120;

/// Each of them is the board's fault within a turn of the watch. A register that the board puts
/// right is cleared; one that it cannot put right keeps its fault until its bit is back.
#[test]
fn a_known_register_that_changes_is_a_fault() {
    let mut link = rig(84);
    let mut stand = Stand::armed_for(&mut link, 4.0, 0.4);
    for (name, address, bit) in KNOWN {
        stand.truth();
        stand.inject(Injection::FlipRegister(address, bit));
        let status = stand.wait(name, 0.1, |status| status.fault != 0);
        let fault = Fault::from_code(status.fault);
        assert_eq!(fault, Some(Fault::RegisterChanged), "{name}");
        assert_eq!(status.fault_detail, address, "{name}");
        stand.session.set_setpoints(None);
        stand.run(0.2);
        let rows = stand.truth();
        let all = rows.iter().flat_map(|row| row.tension_n);
        let most = all.fold(0.0, f64::max);
        assert!(most < TENSION_N, "{name}: {most:.1} N");
        // A tick and the row that it lies in, or a turn of the watch; and they stay there.
        let rows_driven = if EACH_TICK.contains(&address) { 3 } else { 60 };
        let driven = rows.iter().rposition(|row| !all_at_zero(row));
        assert!(
            driven.is_none_or(|last| last < rows_driven),
            "{name}: row {driven:?}"
        );
        let cleared = stand.session.command(&Command::ClearFaults).is_ok();
        assert_eq!(cleared, PUT_RIGHT.contains(&address), "{name}");
        if !cleared {
            stand.inject(Injection::FlipRegister(address, bit));
            stand.run(0.2);
            let cleared = stand.session.command(&Command::ClearFaults);
            assert!(cleared.is_ok(), "{name}: {:?}", stand.status());
        }
        stand.wait("ready again", 1.0, |status| {
            status.state == SystemState::Ready as u8
        });
        stand.ask(&Command::Arm);
        stand.hold([4.0; 6]);
        stand.run(0.4);
        let rows = stand.truth();
        let last = rows.last().expect("rows").tension_n;
        assert!(
            last.iter().all(|newtons| (3.0..5.0).contains(newtons)),
            "{name}: not held again: {last:?}"
        );
    }
}

#[test]
fn no_drawn_bit_is_a_hazard() {
    let stage = Stage::new().unwrap_or_else(|error| panic!("{error}"));
    let memory = stage.memory().unwrap_or_else(|error| panic!("{error}"));
    let plans: Vec<Plan> = (0..DRAWN)
        .map(|number| Plan::draw(1, number, &memory))
        .collect();
    let mut done = 0;
    while done < plans.len() {
        let outcomes = stage
            .run_until_noticed(&plans[done..], WATCH_MS)
            .unwrap_or_else(|error| panic!("{error}"));
        for outcome in &outcomes {
            assert!(outcome.hazards.is_empty(), "{}", table::words(outcome));
        }
        done += outcomes.len();
    }
}
