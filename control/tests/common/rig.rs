//! Six controllers on the plant, sample by sample, in virtual time: converters with their own
//! periods and sinc4 filters, encoder counts, DAC codes. What the firmware adds (bus, queue) is a
//! delay here.
#![allow(dead_code)] // each user takes a part

use control::friction::ReelSpeed;
use control::unit::{Drive, Setpoint};
use control::zero::{Averager, Progress};
use control::{
    AdcCode, Config, Controller, EncoderCounts, Input, InvCos, Micros, Newton, Output, State,
};
use plant::{Plant, PlantConfig};
use wire::message::UnitConfig;

pub const STEP_US: u64 = 50;
/// NAU7802 at gain 128 and 3.0 V: code = bridge * 128 * 2^24 / 1 (full scale +-0.5 / gain).
const CODES_PER_BRIDGE: f64 = 128.0 * 16_777_216.0;

/// A converter: a ring of bridge values on the plant's grid, read through a sinc4 kernel.
struct Converter {
    period_steps: usize,
    next_step: u64,
    ring: Vec<f64>,
    kernel: Vec<f64>,
    noise: Noise,
}

/// Gaussian enough: sum of twelve uniforms of a 64-bit LCG.
pub struct Noise(pub u64);

impl Noise {
    pub fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.unit()).sum::<f64>() - 6.0
    }
}

fn sinc4(period: usize) -> Vec<f64> {
    let mut kernel = vec![1.0];
    for _ in 0..4 {
        let mut next = vec![0.0; kernel.len() + period - 1];
        for (i, k) in kernel.iter().enumerate() {
            for j in 0..period {
                next[i + j] += k / period as f64;
            }
        }
        kernel = next;
    }
    kernel
}

pub struct Unit {
    pub config: Config,
    pub state: State,
    pub setpoint_n: f64,
    /// Speed of the reel that comes with the setpoint.
    pub reel_um_per_s: Option<i32>,
    pub drive: Drive,
    pub output: Output,
    pub spikes: Option<Noise>,
    converter: Converter,
    pending: Option<(u64, f64)>,
}

pub struct Rig {
    pub plant: Plant,
    pub units: Vec<Unit>,
    pub step: u64,
}

impl Rig {
    /// Zeroed with slack cables (3 mm at least), drives off.
    pub fn new(plant: PlantConfig, seed: u64, wire: &UnitConfig) -> Self {
        let mut plant = plant;
        plant.cable.initial_slack_m = plant.cable.initial_slack_m.max(3e-3);
        let mut plant = Plant::new(plant, seed).expect("the plant's configuration is valid");
        plant.set_amplifier_power(true);
        let units = (0..plant.units())
            .map(|i| {
                let period_steps = [61, 62, 63, 64, 62, 63][i % 6];
                let per_n = plant.parameters(i).bridge_per_n;
                let mut wire = *wire;
                wire.scale_pn_per_count = (1e12 / (per_n * CODES_PER_BRIDGE)).round() as i32;
                wire.travel_nm_per_count = -4_229;
                Unit {
                    config: Config::from_wire(&wire).expect("in range"),
                    state: State::default(),
                    setpoint_n: 0.0,
                    reel_um_per_s: None,
                    drive: Drive::Off,
                    output: Output::default(),
                    spikes: None,
                    converter: Converter {
                        period_steps,
                        next_step: 400 + 9 * i as u64,
                        ring: vec![0.0; 4 * 64],
                        kernel: sinc4(period_steps),
                        noise: Noise(seed.wrapping_mul(77) + i as u64),
                    },
                    pending: None,
                }
            })
            .collect();
        let mut rig = Self {
            plant,
            units,
            step: 0,
        };
        rig.zero();
        rig
    }

    fn zero(&mut self) {
        let mut averagers = vec![Averager::new(0, u32::MAX); self.units.len()];
        let mut zeros = vec![None; self.units.len()];
        while zeros.iter().any(Option::is_none) {
            self.advance(|i, code, _| {
                if zeros[i].is_none() {
                    if let Progress::Done(zero) = averagers[i].push(code) {
                        zeros[i] = Some(zero);
                    }
                }
            });
        }
        for (unit, zero) in self.units.iter_mut().zip(zeros) {
            unit.config = unit.config.with_zero(zero.expect("found"));
            unit.state.reset();
        }
    }

    /// One plant step; `seen` gets unit, code and the unit's controller output of each sample.
    pub fn advance(&mut self, mut seen: impl FnMut(usize, AdcCode, &Output)) {
        for sample in self.sample() {
            let unit = &mut self.units[sample.unit];
            let input = Input {
                adc_code: sample.code,
                encoder_counts: sample.counts,
                at: Micros((self.step * STEP_US) as u32),
                setpoint: Setpoint {
                    tension: Newton::from_un((unit.setpoint_n * 1e6) as i32),
                    inv_cos: sample.inv_cos,
                    reel: unit.reel_um_per_s.map(ReelSpeed::from_um_per_s),
                },
                drive: unit.drive,
            };
            unit.output = Controller::step(&unit.config, &mut unit.state, input);
            let volts = f64::from(unit.output.dac.steps()) * 10.0 / 32_768.0;
            seen(sample.unit, sample.code, &unit.output);
            // 0.2 ms from DRDY to the DAC.
            self.apply(sample.unit, volts, 4);
        }
    }

    /// Lets an amplifier have a voltage so many plant steps from now.
    pub fn apply(&mut self, unit: usize, volts: f64, after_steps: u64) {
        self.units[unit].pending = Some((self.step + after_steps, volts));
    }

    /// One plant step; returns the samples that are ready after it.
    pub fn sample(&mut self) -> Vec<Sample> {
        self.step += 1;
        let now = self.step;
        for (i, unit) in self.units.iter_mut().enumerate() {
            if let Some((due, volts)) = unit.pending {
                if due <= now {
                    self.plant.set_amplifier_volts(i, volts).expect("finite");
                    unit.pending = None;
                }
            }
        }
        self.plant.advance_to(now * STEP_US * 1_000);
        let mut samples = Vec::new();
        for (i, unit) in self.units.iter_mut().enumerate() {
            let bridge = self.plant.bridge_v_per_v(i);
            let c = &mut unit.converter;
            let size = c.ring.len();
            c.ring[now as usize % size] = bridge;
            if now < c.next_step {
                continue;
            }
            c.next_step += c.period_steps as u64;
            let mean: f64 = c
                .kernel
                .iter()
                .enumerate()
                .map(|(k, w)| w * c.ring[(now as usize + size - k) % size])
                .sum();
            // 3 mN of noise.
            let noise = 3.0e-3 / 6.85e-6 * c.noise.normal();
            let mut code = (mean * CODES_PER_BRIDGE + noise).round() as i32;
            if let Some(spikes) = &mut unit.spikes {
                if spikes.unit() < 0.003 {
                    // 1.4 to 20 N, either way.
                    let size = 200_000.0 + 2_800_000.0 * spikes.unit();
                    code += if spikes.unit() < 0.5 { size } else { -size } as i32;
                }
            }
            let cos = self.plant.cell_force_n(i) / self.plant.tension_n(i);
            let inv_cos = if cos.is_finite() {
                (65_536.0 / cos) as i32
            } else {
                65_536
            };
            samples.push(Sample {
                unit: i,
                code: AdcCode::new(code),
                counts: EncoderCounts(self.plant.encoder_counts(i)),
                inv_cos: InvCos::from_q16(inv_cos),
            });
        }
        samples
    }

    pub fn time_s(&self) -> f64 {
        (self.step * STEP_US) as f64 * 1e-6
    }
}

/// A conversion and what goes with it.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    pub unit: usize,
    pub code: AdcCode,
    pub counts: EncoderCounts,
    pub inv_cos: InvCos,
}

/// Drives all units for so long with setpoints that vary slowly between 2.2 and 6 N, while the tip
/// moves from 1 s on. `host` acts before each step, `seen` gets the time, s, and the rig after it.
pub fn follow(
    plant: PlantConfig,
    seed: u64,
    wire: &UnitConfig,
    seconds: f64,
    mut host: impl FnMut(&mut Rig),
    mut seen: impl FnMut(f64, &Rig),
) -> Rig {
    let mut rig = Rig::new(plant, seed, wire);
    let start = rig.time_s();
    for unit in &mut rig.units {
        unit.drive = Drive::Follow;
    }
    while rig.time_s() < start + seconds {
        let t = rig.time_s() - start;
        if t > 1.0 {
            rig.plant.set_robot_moving(true);
        }
        for (i, unit) in rig.units.iter_mut().enumerate() {
            unit.setpoint_n = 4.1 + 1.9 * (0.4 * t + i as f64).sin();
        }
        host(&mut rig);
        rig.advance(|_, _, output| assert_eq!(output.fault, None));
        seen(t, &rig);
    }
    rig
}

/// Root mean square and largest tension error per unit over `seconds` while the tip moves, after a
/// settling time of 3 s, with setpoints that vary slowly between 2.2 and 6 N.
pub fn tension_errors(
    plant: PlantConfig,
    seed: u64,
    wire: &UnitConfig,
    seconds: f64,
) -> Vec<(f64, f64)> {
    errors_with(plant, seed, wire, seconds, |_| {})
}

/// The same with a host that acts before each step.
pub fn errors_with(
    plant: PlantConfig,
    seed: u64,
    wire: &UnitConfig,
    seconds: f64,
    host: impl FnMut(&mut Rig),
) -> Vec<(f64, f64)> {
    let mut sums = [(0.0, 0.0f64); control::UNITS];
    let mut count = 0.0;
    follow(plant, seed, wire, 3.0 + seconds, host, |t, rig| {
        if t > 3.0 {
            count += 1.0;
            for (i, sum) in sums.iter_mut().enumerate() {
                let error = rig.plant.tension_n(i) - rig.units[i].setpoint_n;
                sum.0 += error * error;
                sum.1 = sum.1.max(error.abs());
            }
        }
    });
    sums.iter()
        .map(|(square, peak)| ((square / count).sqrt(), *peak))
        .collect()
}
