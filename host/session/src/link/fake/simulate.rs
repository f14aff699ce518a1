//! What the board does with time: samples through the control core, states and statuses every
//! millisecond.

use super::{Behavior, FakeBoard, MS};
use control::unit::Drive;
use control::zero::Progress;
use control::{
    AdcCode, Controller, EncoderCounts, Fault, Input, Micros, MotorState, SystemState, UnitIndex,
};
use emulator_link::Truth;
use wire::message::{Batch, Sample, BATCH};
use wire::{BoardMessage, UNITS};

/// Time from power-on to ready, ns.
const BRING_UP_NS: u64 = 1_000_000_000;
/// The converter's sinc4 filter on a grid of 1 ms: four boxes of 4 ms, convolved; 6 ms of delay.
pub(super) const SINC: [f64; 13] = [
    1.0, 4.0, 10.0, 20.0, 31.0, 40.0, 44.0, 40.0, 31.0, 20.0, 10.0, 4.0, 1.0,
];
/// Period of the status, ns.
const STATUS_NS: u64 = 50_000_000;

impl FakeBoard {
    pub(super) fn sample(&mut self, i: usize) {
        self.samples[i] += 1;
        let bridge: f64 = self.bridge[i]
            .iter()
            .zip(SINC)
            .map(|(b, w)| b * w / 256.0)
            .sum();
        // 24 bits over +-0.5 VREF/128; noise of 3 mN is 440 counts.
        let code = bridge * 128.0 * f64::from(1 << 24) + 440.0 * self.noise();
        let code = AdcCode::new(code.round() as i32);
        let counts = self.plant.encoder_counts(i);
        let drive = match self.unit_state(i) {
            MotorState::Running if self.setpoints[i].tension.to_bits() > 0 => Drive::Follow,
            MotorState::Running | MotorState::Stopping => Drive::Ramp,
            _ => Drive::Off,
        };
        let input = Input {
            adc_code: code,
            encoder_counts: EncoderCounts(counts),
            at: Micros(self.t_us()),
            setpoint: self.setpoints[i],
            drive,
        };
        let output = Controller::step(&self.configs[i], &mut self.states[i], input);
        if let Some((fault, detail)) = output.fault {
            self.latch(Some(i), fault, detail);
        }
        let volts = f64::from(output.dac.steps()) * 20.0 / 65_536.0;
        self.plant.set_amplifier_volts(i, volts).expect("a unit");
        if let Some(averager) = &mut self.zeroing[i] {
            match averager.push(code) {
                Progress::Collecting(_) => {}
                Progress::Done(zero) => {
                    self.configs[i] = self.configs[i].with_zero(zero);
                    self.zeroing[i] = None;
                }
                Progress::Refused(refused) => {
                    self.zeroing[i] = None;
                    self.latch(Some(i), Fault::ZeroRefused, refused.detail());
                }
            }
        }
        let mut sample = Sample {
            unit: i as u8,
            adc_code: code.get(),
            encoder_counts: counts as i32,
            latency_us: 200,
            ..Sample::default()
        };
        output.describe(&mut sample);
        sample.tip_force_mn = self.tip.sample(UnitIndex::ALL[i], output.tension);
        let t_us = self.t_us();
        let batch = self.batch.get_or_insert(Batch {
            t_us,
            samples: Default::default(),
        });
        sample.dt_us = (t_us - batch.t_us) as u16;
        batch.samples.push(sample).expect("sent when full");
        if batch.samples.len() == BATCH {
            let batch = self.batch.take().expect("just filled");
            self.send(BoardMessage::Samples(batch));
        }
    }

    /// One millisecond, for what is looked at in that grid.
    pub(super) fn tick(&mut self) {
        for i in 0..UNITS {
            self.bridge[i].pop_front();
            let weight = self.weight_n[i] * self.plant.parameters(i).bridge_per_n;
            self.bridge[i].push_back(self.plant.bridge_v_per_v(i) + weight);
        }
        let age = self.now_ns - self.epoch_ns;
        match self.system {
            SystemState::Boot | SystemState::BringUp if age >= BRING_UP_NS => {
                self.system = SystemState::Ready;
                for i in 0..UNITS {
                    if self.unplugged[i] {
                        self.latch(Some(i), Fault::BringUpFailed, 0x0100);
                    }
                }
            }
            SystemState::Zeroing if self.zeroing.iter().all(Option::is_none) => {
                self.system = SystemState::Ready;
            }
            SystemState::Stopping
                if (0..UNITS).all(|i| {
                    self.unit_faults[i].is_some() || self.states[i].command().to_bits() == 0
                }) =>
            {
                self.system = SystemState::Ready;
            }
            _ => {}
        }
        if self.expires_ns.is_some_and(|at| self.now_ns > at) {
            self.expires_ns = None;
            self.latch(None, Fault::SetpointsExpired, 101);
        }
        if age.is_multiple_of(STATUS_NS) {
            let status = self.status();
            self.send(BoardMessage::Status(status));
        }
        if self.behavior == Behavior::ResetsAt(self.now_ns) {
            let (plant, resets) = (self.plant.clone(), self.resets + 1);
            let commands = std::mem::take(&mut self.commands);
            *self = Self {
                plant,
                resets,
                commands,
                now_ns: self.now_ns,
                epoch_ns: self.now_ns,
                next_sample_ns: [self.now_ns + 500 * MS; UNITS],
                ..Self::new(Behavior::Good)
            };
            for i in 0..UNITS {
                self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
            }
        }
    }

    pub(super) fn truth(&self) -> Truth {
        let truth = self.plant.truth();
        Truth {
            t_ns: self.now_ns,
            amplifier_on: truth.amplifier_power,
            tip_m: truth.tip_position_m,
            tip_force_n: truth.tip_force_n,
            tension_n: core::array::from_fn(|i| truth.units[i].tension_n),
            reel_rad_s: core::array::from_fn(|i| truth.units[i].reel_rad_per_s),
            dac_v: core::array::from_fn(|i| truth.units[i].amplifier_volts),
        }
    }
}
