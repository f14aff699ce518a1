//! Fixed point against the `f64` reference over random configurations and inputs.
#![allow(dead_code)] // each user takes a part

use crate::reference::Reference;
use control::friction::ReelSpeed;
use control::unit::{Drive, Setpoint};
use control::{AdcCode, Config, Controller, EncoderCounts, Input, InvCos, Micros, Newton, State};
use wire::message::{CellCorrection, FilterChoice, Ripple, UnitConfig};

/// 64-bit LCG, upper bits.
pub struct Random(pub u64);

impl Random {
    pub fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    /// Uniform in the logarithm.
    pub fn scale(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }
    pub fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

/// A configuration anywhere in the ranges that a rig can have.
pub fn config(r: &mut Random) -> UnitConfig {
    let sign = |r: &mut Random| if r.chance(0.5) { -1.0 } else { 1.0 };
    let maybe = |r: &mut Random, low: f64, high: f64| {
        if r.chance(0.2) {
            0.0
        } else {
            r.scale(low, high)
        }
    };
    let friction_gain = r.between(32_768.0, 131_072.0);
    UnitConfig {
        enabled: true,
        scale_pn_per_count: (sign(r) * r.scale(1e6, 30e6)) as i32,
        zero_code: r.between(-2e6, 2e6) as i32,
        stored_zero_code: r.between(-2e6, 2e6) as i32,
        zero_deviation_un: r.scale(1e5, 1e7) as i32,
        filter: if r.chance(0.5) {
            FilterChoice::MovingAverage(1 + (r.unit() * 16.0) as u8)
        } else {
            FilterChoice::LowPass {
                corner_chz: r.between(500.0, 12_001.0) as u16,
            }
        },
        spike_limit_un: r.scale(5e4, 6e7) as i32,
        kp_q16: (65_536.0 * maybe(r, 0.01, 20.0)) as i32,
        ki_q16: (65_536.0 * maybe(r, 0.01, 200.0)) as i32,
        kd_q16: (65_536.0 * maybe(r, 1e-4, 0.05)) as i32,
        damping_q16: (65_536.0 * maybe(r, 0.1, 1000.0)) as i32,
        friction_feedforward: r.chance(0.6),
        friction_offset_un: r.between(-3e6, 3e6) as i32,
        friction_gain_q16: friction_gain as i32,
        coulomb_un: r.between(0.0, 5e6) as i32,
        coulomb_load_q16: r.between(0.0, 26_214f64.min(friction_gain / 2.0 - 1.0)) as i32,
        reversal_nm: r.scale(1e4, 5e6) as i32,
        travel_nm_per_count: (sign(r) * r.scale(1_000.0, 50_000.0)) as i32,
        dac_counts_per_n_q16: (sign(r) * r.scale(10.0, 800.0) * 65_536.0) as i32,
        force_limit_un: r.between(2e6, 40e6) as i32,
        authority_un: r.scale(5e5, 4e7) as i32,
        plausible_un: r.scale(5e5, 2e7) as i32,
        slew_un_per_s: r.scale(5e6, 2e9) as i32,
        over_tension_un: r.between(10e6, 50e6) as i32,
        viscous_q16: (65_536.0 * maybe(r, 0.1, 100.0)) as i32,
        ripples: core::array::from_fn(|_| Ripple {
            periods_per_count_q32: (sign(r) * r.scale(1e3, 8e8)) as i32,
            phase_q32: r.between(-2_147_483_648.0, 2_147_483_647.0) as i32,
            amplitude_un: (1e6 * maybe(r, 0.01, 3.0)) as i32,
            amplitude_load_q16: (65_536.0 * maybe(r, 1e-3, 0.2)) as i32,
        }),
        cell: CellCorrection {
            curve_nn_per_n2: (sign(r) * 1e9 * maybe(r, 1e-5, 0.02)) as i32,
            creep_q16: (sign(r) * 65_536.0 * maybe(r, 1e-4, 0.2)) as i32,
            creep_ms: r.scale(500.0, 3.6e6) as i32,
        },
        tension_max_un: r.between(1e6, 40e6) as i32,
        leaky_ki_q16: (65_536.0 * maybe(r, 0.01, 200.0)) as i32,
    }
}

/// What a comparison found.
#[derive(Debug, Clone, Copy, Default)]
pub struct Found {
    /// Samples compared.
    pub samples: u64,
    /// Largest |fixed - f64| of the command, in N.
    pub worst_command: f64,
    /// Largest |fixed - f64| of tension, P, I, D, feedforward, in N.
    pub worst_terms: [f64; 5],
    /// Largest distance of the DAC code from the reference's command, in codes.
    pub worst_codes: f64,
    /// Largest command seen, in N.
    pub largest_command: f64,
    /// Samples whose command stood at no limit of force or slew.
    pub free: u64,
    /// Runs given up because a decision was too close to its threshold to call.
    pub undecided: u64,
    /// Runs that ended in a trip, on both sides.
    pub trips: u64,
}

/// Runs random units, each for up to `run` samples, until `samples` are compared.
pub fn compare(seed: u64, samples: u64, run: u64) -> Found {
    let mut r = Random(seed);
    let mut found = Found::default();
    while found.samples < samples {
        let wire = config(&mut r);
        let length = run.min(samples - found.samples).max(1);
        one_run(&mut r, &wire, length, &mut found);
    }
    found
}

fn one_run(r: &mut Random, wire: &UnitConfig, length: u64, found: &mut Found) {
    let config = Config::from_wire(wire).expect("drawn within the ranges");
    let mut state = State::default();
    let mut reference = Reference::new(*wire);
    let limit = f64::from(wire.force_limit_un) * 1e-6;
    let scale = f64::from(wire.scale_pn_per_count) * 1e-12;
    let mut at = r.between(0.0, 4e9) as u32;
    let mut counts = r.between(-1e7, 1e7);
    let period = r.between(3_030.0, 3_226.0);
    let calm = r.chance(0.5);
    let (mut speed, mut ripple, mut inv_cos) = (0.0, 0.0, r.between(1.0, 2.0));
    let mut setpoint = r.between(0.5, limit.min(12.0));
    let mut drive = Drive::Follow;
    // What the host expects: nothing, about the truth, or anything.
    let told = (r.unit() * 4.0) as u32;
    let mut reel_um_per_s = None;
    for n in 0..length {
        // A force around the setpoint, so that the integral lives, with noise, waves, spikes and
        // steps.
        ripple = 0.98 * ripple + 0.05 * r.normal();
        if r.chance(0.002) {
            setpoint = r.between(0.0, limit.min(12.0));
        }
        if r.chance(0.0005) {
            drive =
                [Drive::Follow, Drive::Follow, Drive::Ramp, Drive::Off][(r.unit() * 4.0) as usize];
        }
        if r.chance(0.01) {
            inv_cos = (inv_cos + 0.02 * r.normal()).clamp(1.0, 3.9);
        }
        let mut force = (setpoint + ripple + 0.005 * r.normal()) / inv_cos;
        if !calm && r.chance(0.01) {
            force += 20.0 * r.normal();
        }
        speed = if calm {
            0.97 * speed + 0.1 * r.normal()
        } else {
            0.99 * speed + 4.0 * r.normal()
        };
        counts += if r.chance(0.3) { 0.0 } else { speed };
        let um_per_s = speed * f64::from(wire.travel_nm_per_count) * 0.32;
        reel_um_per_s = match told {
            1 => Some(um_per_s as i32),
            2 if r.chance(0.3) => r.chance(0.8).then(|| (um_per_s + 1e3 * r.normal()) as i32),
            3 if r.chance(0.05) => r.chance(0.8).then(|| (1e5 * r.normal()) as i32),
            _ => reel_um_per_s,
        };
        at = at.wrapping_add(if r.chance(0.01) {
            2.0 * period
        } else {
            period + 2.0 * r.normal()
        } as u32);
        let input = Input {
            adc_code: AdcCode::new((force / scale) as i32 + wire.zero_code),
            encoder_counts: EncoderCounts(counts as i64),
            at: Micros(at),
            setpoint: Setpoint {
                tension: Newton::from_un((setpoint * 1e6) as i32),
                inv_cos: InvCos::from_q16((inv_cos * 65_536.0) as i32),
                reel: reel_um_per_s.map(ReelSpeed::from_um_per_s),
            },
            drive,
        };
        let fixed = Controller::step(&config, &mut state, input);
        let exact = reference.step(&input);
        if exact.margin < 3e-6 {
            found.undecided += 1;
            return;
        }
        assert_eq!(
            fixed.fault.is_some(),
            exact.tripped,
            "sample {n} of {wire:?}: {exact:?}"
        );
        found.samples += 1;
        let off = |a: Newton, b: f64| (a.to_f64() - b).abs();
        // The format ends at 512 N, where any limit has long acted.
        let within = |a: Newton, b: f64| if b.abs() < 511.0 { off(a, b) } else { 0.0 };
        let error = off(fixed.command, exact.command);
        if error > found.worst_command {
            found.worst_command = error;
        }
        let terms = [
            off(fixed.tension, exact.tension),
            within(fixed.terms.p, exact.p),
            off(fixed.terms.i, exact.i),
            within(fixed.terms.d, exact.d),
            off(fixed.feedforward, exact.feedforward),
        ];
        for (worst, term) in found.worst_terms.iter_mut().zip(terms) {
            *worst = worst.max(term);
        }
        let codes = exact.command * f64::from(wire.dac_counts_per_n_q16) / 65_536.0;
        let codes = codes.clamp(-32_768.0, 32_767.0);
        found.worst_codes = found
            .worst_codes
            .max((f64::from(fixed.dac.steps()) - codes).abs());
        found.largest_command = found.largest_command.max(exact.command);
        let slewing = wire::message::flags::SLEWING | wire::message::flags::AT_A_LIMIT;
        if fixed.flags & slewing == 0 && exact.command > 0.0 {
            found.free += 1;
        }
        if exact.tripped {
            found.trips += 1;
            return;
        }
    }
}
