//! "Cable lost": a reel that winds in far without tension. In the rig the watches on the tension come first, so the condition is
//! tested on the control core alone.

use control::unit::{Drive, Setpoint, LOST_TRAVEL_NM};
use control::{
    AdcCode, Config, Controller, DacCode, EncoderCounts, Fault, Input, InvCos, Micros, Newton,
    Output, State,
};

/// Period of the samples, in microseconds.
const PERIOD_US: u32 = 3_125;
/// Travel in each sample, in nanometres.
const STEP_NM: i64 = 500_000;

/// A unit whose reel and load cell are moved by hand.
struct Unit {
    config: Config,
    state: State,
    counts: i64,
    at: u32,
}

impl Unit {
    fn new() -> Self {
        Self {
            config: Config::from_wire(&Config::nominal()).expect("in range"),
            state: State::default(),
            counts: 0,
            at: 0,
        }
    }

    /// Winds in about so many millimetres (pays out where negative), half a millimetre in each sample, at a tension. Returns the
    /// first output with a fault, and what was wound in until then in nanometres.
    fn wind(&mut self, mm: i64, tension_un: i64, drive: Drive) -> Option<(Output, i64)> {
        let wire = self.config.wire();
        let per_count = i64::from(wire.travel_nm_per_count);
        let code = tension_un * 1_000_000 / i64::from(wire.scale_pn_per_count);
        let code = AdcCode::new(wire.zero_code + code as i32);
        let begin = self.counts;
        for _ in 0..(mm * 1_000_000 / STEP_NM).abs() {
            self.counts += mm.signum() * STEP_NM / per_count;
            self.at += PERIOD_US;
            let input = Input {
                adc_code: code,
                encoder_counts: EncoderCounts(self.counts),
                at: Micros(self.at),
                setpoint: Setpoint {
                    tension: Newton::from_un(3_000_000),
                    inv_cos: InvCos::from_q16(1 << 16),
                },
                drive,
            };
            let output = Controller::step(&self.config, &mut self.state, input);
            if output.fault.is_some() {
                return Some((output, (self.counts - begin) * per_count));
            }
        }
        None
    }
}

#[test]
fn a_reel_that_winds_in_without_tension_is_stopped_after_150_mm() {
    let mut unit = Unit::new();
    let (output, wound_nm) = unit.wind(300, 0, Drive::Follow).expect("a fault");
    let limit = i64::from(LOST_TRAVEL_NM);
    assert!(
        (limit..limit + 2 * STEP_NM).contains(&wound_nm),
        "{wound_nm} nm"
    );
    let (fault, detail_um) = output.fault.expect("a fault");
    assert_eq!(fault, Fault::CableLost);
    assert!((i64::from(detail_um) - wound_nm / 1_000).abs() <= STEP_NM / 1_000);
    assert_eq!(output.dac, DacCode::ZERO_VOLT);
    // It stays while the reel stays.
    let again = unit.wind(1, 0, Drive::Follow).expect("a fault");
    assert_eq!(
        again.0.fault.map(|(fault, _)| fault),
        Some(Fault::CableLost)
    );
}

#[test]
fn a_ramp_down_counts_as_well() {
    let found = Unit::new().wind(300, 0, Drive::Ramp).expect("a fault");
    assert_eq!(
        found.0.fault.map(|(fault, _)| fault),
        Some(Fault::CableLost)
    );
}

#[test]
fn a_cable_under_tension_may_be_wound_in() {
    assert_eq!(Unit::new().wind(400, 3_000_000, Drive::Follow), None);
}

#[test]
fn what_is_paid_out_again_does_not_count() {
    let mut unit = Unit::new();
    for _ in 0..5 {
        assert_eq!(unit.wind(100, 0, Drive::Follow), None);
        assert_eq!(unit.wind(-100, 0, Drive::Follow), None);
    }
}

#[test]
fn tension_or_a_motor_that_is_off_begins_anew() {
    let mut unit = Unit::new();
    assert_eq!(unit.wind(100, 0, Drive::Follow), None);
    assert_eq!(unit.wind(20, 3_000_000, Drive::Follow), None);
    assert_eq!(unit.wind(100, 0, Drive::Follow), None);
    assert_eq!(unit.wind(300, 0, Drive::Off), None);
    assert_eq!(unit.wind(100, 0, Drive::Follow), None);
}
