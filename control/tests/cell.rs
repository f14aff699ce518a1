//! The load cell's conversion against a cell in `f64` that is curved and creeps.

use control::cell::CellForce;
use control::unit::{Drive, Setpoint};
use control::{AdcCode, Config, Controller, EncoderCounts, Input, InvCos, Micros, Newton, State};
use proptest::prelude::*;
use wire::message::{CellCorrection, FilterChoice, UnitConfig};

const PERIOD_US: u32 = 3_125;
const SCALE_N: f64 = 6.85e-6;

/// A cell: `x + k x^2` of the load with its creep.
struct Cell {
    curve: f64,
    creep: f64,
    time_s: f64,
    crept_n: f64,
}

impl Cell {
    /// Code under a load, and the creep of a sample period under it.
    fn read(&mut self, load_n: f64, zero: i32) -> AdcCode {
        let load = load_n + self.crept_n;
        let end = self.creep * load_n;
        let part = 1.0 - (-f64::from(PERIOD_US) * 1e-6 / self.time_s).exp();
        self.crept_n += (end - self.crept_n) * part;
        // The reading for which the board's parabola gives this load.
        let straight = if self.curve == 0.0 {
            load
        } else {
            ((1.0 + 4.0 * self.curve * load).sqrt() - 1.0) / (2.0 * self.curve)
        };
        AdcCode::new((straight / SCALE_N).round() as i32 + zero)
    }
}

fn unit(cell: CellCorrection) -> UnitConfig {
    UnitConfig {
        zero_code: 4_711,
        filter: FilterChoice::MovingAverage(1),
        spike_limit_un: 60_000_000,
        over_tension_un: 50_000_000,
        cell,
        ..Config::nominal()
    }
}

fn sample(config: &Config, state: &mut State, n: u32, code: AdcCode) -> control::Output {
    let input = Input {
        adc_code: code,
        encoder_counts: EncoderCounts(0),
        at: Micros(n.wrapping_mul(PERIOD_US)),
        setpoint: Setpoint {
            tension: Newton::ZERO,
            inv_cos: InvCos::ONE,
            reel: None,
        },
        drive: Drive::Off,
    };
    Controller::step(config, state, input)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A load that goes up and down in steps is measured right all the time.
    #[test]
    fn curve_and_creep_are_taken_out(
        curve in -15_000_000i32..=15_000_000,
        creep_q16 in -13_107i32..=13_107,
        creep_ms in 500i32..=100_000,
        loads in prop::collection::vec(0.0f64..12.0, 1..6),
    ) {
        let correction = CellCorrection { curve_nn_per_n2: curve, creep_q16, creep_ms };
        let wire = unit(correction);
        let config = Config::from_wire(&wire).expect("within the ranges");
        let mut state = State::default();
        let mut cell = Cell {
            curve: f64::from(curve) * 1e-9,
            creep: f64::from(creep_q16) / 65_536.0,
            time_s: f64::from(creep_ms) * 1e-3,
            crept_n: 0.0,
        };
        let mut n = 0;
        for load in loads {
            for _ in 0..1_000 {
                let output = sample(&config, &mut state, n, cell.read(load, wire.zero_code));
                let off = output.tension.to_f64() - load;
                // The board's Euler step against the exponential: a part dt / 2 tau of the creep.
                let bound = 2e-4 + 0.2 * 12.0 * 1.5625e-3 / cell.time_s;
                prop_assert!(off.abs() < bound, "{off} N at sample {n}");
                n += 1;
            }
        }
    }

    /// What starts from codes has the board's force, also where samples are missing.
    #[test]
    fn the_force_of_a_recording_is_the_boards(
        curve in -15_000_000i32..=15_000_000,
        creep_q16 in -13_107i32..=13_107,
        creep_ms in 500i32..=100_000,
        loads in prop::collection::vec(0.0f64..12.0, 1..6),
        kept in 1u32..4,
    ) {
        let correction = CellCorrection { curve_nn_per_n2: curve, creep_q16, creep_ms };
        let wire = unit(correction);
        let config = Config::from_wire(&wire).expect("within the ranges");
        let (mut state, mut cell) = (State::default(), CellForce::new(&wire));
        let code = |load: f64| AdcCode::new((load / SCALE_N) as i32 + wire.zero_code);
        let mut n = 0;
        // Both begin with an empty cell.
        for load in core::iter::once(0.0).chain(loads) {
            for _ in 0..1_000 {
                let board = sample(&config, &mut state, n, code(load)).tension.to_f64();
                if n % kept == 0 {
                    let force = cell.at(code(load).get(), u64::from(n) * u64::from(PERIOD_US));
                    // A sample of the creep, once for each that is missing.
                    let bound = 1e-4 + 0.4 * 12.0 * f64::from(kept) * 3.125 / f64::from(creep_ms);
                    prop_assert!((force - board).abs() < bound, "{force} and {board} N at {n}");
                }
                n += 1;
            }
        }
    }

    /// More code is more force, whatever the curve: nothing hides a pull.
    #[test]
    fn the_conversion_rises_over_the_whole_range(
        curve in -20_000_000i32..=20_000_000,
        code in -8_388_608i32..8_300_000,
        more in 1_000i32..80_000,
    ) {
        let correction = CellCorrection { curve_nn_per_n2: curve, ..CellCorrection::NONE };
        let config = Config::from_wire(&unit(correction)).expect("within the ranges");
        let at = |code| sample(&config, &mut State::default(), 0, AdcCode::new(code)).tension;
        prop_assert!(at(code + more) > at(code));
    }
}

/// A zero that is taken while the cell still creeps back is that of the relaxed cell.
#[test]
fn a_zero_after_a_load_leaves_the_creep_out() {
    let wire = unit(CellCorrection {
        curve_nn_per_n2: 0,
        creep_q16: 6_554,
        creep_ms: 6_000,
    });
    let config = Config::from_wire(&wire).unwrap();
    let mut state = State::default();
    let mut cell = Cell {
        curve: 0.0,
        creep: 0.1,
        time_s: 6.0,
        crept_n: 0.0,
    };
    for n in 0..6_400 {
        sample(&config, &mut state, n, cell.read(8.0, wire.zero_code));
    }
    let code = cell.read(0.0, wire.zero_code);
    // 0.77 N of 8 N are left as creep, 113,000 codes.
    assert!(code.get() > 100_000, "{code:?}");
    state.reset();
    let zero = state.relaxed_zero(&config, code);
    assert!((zero.get() - wire.zero_code).abs() < 200, "{zero:?}");
    // Before the first zero nothing is known of the load, and nothing creeps.
    let fresh = Config::from_wire(&UnitConfig {
        zero_code: 0,
        ..wire
    })
    .unwrap();
    let mut state = State::default();
    for n in 0..6_400 {
        let output = sample(&fresh, &mut state, n, AdcCode::new(1_000_000));
        assert!((output.tension.to_f64() - 6.85).abs() < 1e-3);
    }
    assert_eq!(state.relaxed_zero(&fresh, code), code);
}

/// The over-tension limit holds for the reading without correction as well.
#[test]
fn a_wrong_correction_does_not_hide_over_tension() {
    let wire = UnitConfig {
        over_tension_un: 20_000_000,
        ..unit(CellCorrection {
            curve_nn_per_n2: -20_000_000,
            ..CellCorrection::NONE
        })
    };
    let config = Config::from_wire(&wire).unwrap();
    let mut state = State::default();
    let code = AdcCode::new((21.0 / SCALE_N) as i32 + wire.zero_code);
    let faults: Vec<_> = (0..3)
        .map(|n| sample(&config, &mut state, n, code).fault)
        .collect();
    assert_eq!(faults[0], None);
    assert!(matches!(
        faults[1],
        Some((control::Fault::OverTension, 20_900..=21_100))
    ));
}
