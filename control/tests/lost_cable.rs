//! A reel that winds in without tension: what its setpoint is, and "cable lost" where it goes on.
//! In the rig the watches on the tension come first, so both are tested on the control core alone.

use control::unit::{Drive, Setpoint, LOST_TRAVEL_NM};
use control::{
    AdcCode, Config, Controller, DacCode, EncoderCounts, Fault, Input, InvCos, Micros, Newton,
    Output, State,
};
use wire::message::flags;

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

    /// A sample after so much travel, in nanometres, at a tension and with a setpoint.
    fn sample(&mut self, step_nm: i64, tension_un: i64, setpoint_un: i32, drive: Drive) -> Output {
        let wire = self.config.wire();
        let code = tension_un * 1_000_000 / i64::from(wire.scale_pn_per_count);
        let adc_code = AdcCode::new(wire.zero_code + code as i32);
        self.counts += step_nm / i64::from(wire.travel_nm_per_count);
        self.at += PERIOD_US;
        let input = Input {
            adc_code,
            encoder_counts: EncoderCounts(self.counts),
            at: Micros(self.at),
            setpoint: Setpoint {
                tension: Newton::from_un(setpoint_un),
                inv_cos: InvCos::from_q16(1 << 16),
                reel: None,
            },
            drive,
        };
        Controller::step(&self.config, &mut self.state, input)
    }

    /// Winds in about so many millimetres (pays out where negative), half a millimetre in each
    /// sample, at a tension. Returns the first output with a fault, and what was wound in until
    /// then in nanometres.
    fn wind(&mut self, mm: i64, tension_un: i64, drive: Drive) -> Option<(Output, i64)> {
        let per_count = i64::from(self.config.wire().travel_nm_per_count);
        let begin = self.counts;
        for _ in 0..(mm * 1_000_000 / STEP_NM).abs() {
            let output = self.sample(mm.signum() * STEP_NM, tension_un, 3_000_000, drive);
            if output.fault.is_some() {
                return Some((output, (self.counts - begin) * per_count));
            }
        }
        None
    }
}

/// The setpoint of 8 N is in force only when a slack cable has closed; a cable that friction holds
/// below 1 N gets it all.
#[test]
fn the_setpoint_waits_while_a_slack_cable_is_wound_in_and_only_then() {
    let after_a_second = |speed_mm_s: i64, tension_un: i64| {
        let mut unit = Unit::new();
        let step_nm = speed_mm_s * i64::from(PERIOD_US);
        let outputs: Vec<Output> = (0..320)
            .map(|_| unit.sample(step_nm, tension_un, 8_000_000, Drive::Follow))
            .collect();
        outputs.last().expect("samples").setpoint.to_un()
    };
    assert!((1_999_000..2_001_000).contains(&after_a_second(30, 0)));
    assert!((1_999_000..2_001_000).contains(&after_a_second(30, 900_000)));
    for (speed_mm_s, tension_un) in [(0, 400_000), (10, 400_000), (-30, 400_000), (30, 1_500_000)] {
        let setpoint_un = after_a_second(speed_mm_s, tension_un);
        assert!(
            setpoint_un > 7_999_000,
            "{speed_mm_s} mm/s at {tension_un} uN: {setpoint_un} uN"
        );
    }
}

/// From 30 mm/s on a cable without tension is braked by 200 N s/m of what is faster, and none that
/// is tight.
#[test]
fn a_reel_that_takes_up_slack_fast_is_braked() {
    let after_a_second = |speed_mm_s: i64, tension_un: i64| {
        let mut unit = Unit::new();
        let step_nm = speed_mm_s * i64::from(PERIOD_US);
        let outputs: Vec<Output> = (0..320)
            .map(|_| unit.sample(step_nm, tension_un, 2_000_000, Drive::Follow))
            .collect();
        outputs.last().expect("samples").command.to_un()
    };
    let slow_un = after_a_second(29, 0);
    assert!(slow_un > 2_000_000, "{slow_un}");
    assert!(
        after_a_second(35, 0) < slow_un - 500_000,
        "1 N less, and the damping"
    );
    assert_eq!(after_a_second(100, 0), 0);
    let tight_un = after_a_second(100, 1_500_000);
    assert!(tight_un > 1_000_000, "{tight_un}");
}

/// The flags say at which of its limits the command stands.
#[test]
fn the_command_is_told_to_be_at_its_upper_or_its_lower_limit() {
    let after_a_second = |step_nm: i64, tension_un: i64, setpoint_un: i32| {
        let mut unit = Unit::new();
        let outputs: Vec<Output> = (0..320)
            .map(|_| unit.sample(step_nm, tension_un, setpoint_un, Drive::Follow))
            .collect();
        outputs.last().expect("samples").flags & flags::AT_A_LIMIT
    };
    let lacks = after_a_second(0, 1_200_000, 8_000_000);
    assert_eq!(lacks, flags::LIMITED, "the cable has far too little");
    let exceeds = after_a_second(0, 12_000_000, 2_000_000);
    assert_eq!(exceeds, flags::AT_ZERO, "something else pulls");
    assert_eq!(after_a_second(0, 3_000_000, 3_000_000), 0);
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
