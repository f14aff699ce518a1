//! The whole step once more in `f64`, written from the documentation and not from the fixed-point
//! code: SI units, no formats, no precomputed numbers.
#![allow(dead_code)] // each user takes a part

use control::unit::{Drive, Input};
use wire::message::{FilterChoice, UnitConfig};

const RATE: f64 = 320.0;
const PERIOD_US: f64 = 3_125.0;

/// Result of the reference for one sample.
#[derive(Debug, Clone, Copy, Default)]
pub struct Answer {
    /// Command in N before rounding to a DAC code.
    pub command: f64,
    /// Filtered tension in N.
    pub tension: f64,
    /// Terms in N.
    pub p: f64,
    pub i: f64,
    pub d: f64,
    pub feedforward: f64,
    pub direction: f64,
    /// Smallest distance of a yes-or-no decision from its threshold, in N: below a few steps of the
    /// format the two sides may rightly decide differently.
    pub margin: f64,
    pub tripped: bool,
}

#[derive(Debug, Clone)]
pub struct Reference {
    wire: UnitConfig,
    gate: Option<(f64, f64)>,
    crept: f64,
    held: u32,
    rejected: f64,
    history: Vec<f64>,
    biquad: Option<[f64; 4]>,
    tension: f64,
    last: Option<(i64, u32)>,
    direction: f64,
    slack_nm: f64,
    fine_nm: f64,
    pace_nm: f64,
    slow_nm: f64,
    viscous_nm: f64,
    integral: f64,
    leaky: f64,
    setpoint: f64,
    command: f64,
    closed: bool,
    over: u32,
    saturated: u32,
    lost_nm: f64,
    travel_nm: f64,
    level: Level,
    /// Expected less measured travel in nm, samples of doubt, and the elements of presliding
    /// friction.
    lead_nm: f64,
    doubt: u32,
    elements: Option<[f64; 4]>,
    foretold: bool,
}

/// Friction over that of the model, as the integral shows it at reversals.
#[derive(Debug, Clone, Default)]
struct Level {
    excess: f64,
    inwards: bool,
    mean: f64,
    samples: u32,
    before: Option<f64>,
    rested: u32,
}

impl Level {
    fn pause(&mut self) {
        self.rested += 1;
        if self.rested > 250 {
            (self.samples, self.before) = (0, None);
        }
    }

    /// What the integral gives up.
    fn slid(&mut self, inwards: bool, integral: f64, half: f64, share: f64) -> f64 {
        self.rested = 0;
        if inwards != self.inwards {
            self.before = (self.samples >= 64).then_some(self.mean);
            (self.inwards, self.samples) = (inwards, 0);
        }
        self.mean += (integral - self.mean) / 16.0;
        self.samples += 1;
        if self.samples != 64 || half < 0.25 {
            return 0.0;
        }
        let Some(before) = self.before.take() else {
            return 0.0;
        };
        let sign = if inwards { 1.0 } else { -1.0 };
        // The feedforward takes nine tenths of the friction or all of it: the integral keeps the
        // rest.
        let left = half * (1.0 + self.excess) * (1.0 / share - 1.0);
        let missing = (sign * (self.mean - before) / 2.0 - left).clamp(-2.0, 2.0);
        let excess = (self.excess + missing / half).clamp(-0.4, 0.4);
        let moved = sign * half * (excess - self.excess);
        self.excess = excess;
        self.mean -= moved;
        moved
    }
}

fn q16(x: i32) -> f64 {
    f64::from(x) / 65_536.0
}
fn micro(x: i32) -> f64 {
    f64::from(x) * 1e-6
}

impl Reference {
    pub fn new(wire: UnitConfig) -> Self {
        Self {
            wire,
            gate: None,
            crept: 0.0,
            held: 0,
            rejected: 0.0,
            history: Vec::new(),
            biquad: None,
            tension: 0.0,
            last: None,
            direction: 0.0,
            slack_nm: 0.0,
            fine_nm: 0.0,
            pace_nm: 0.0,
            slow_nm: 0.0,
            viscous_nm: 0.0,
            integral: 0.0,
            leaky: 0.0,
            setpoint: 0.0,
            command: 0.0,
            closed: false,
            over: 0,
            saturated: 0,
            lost_nm: 0.0,
            travel_nm: 0.0,
            level: Level::default(),
            lead_nm: 0.0,
            doubt: 0,
            elements: None,
            foretold: false,
        }
    }

    fn spike_gate(&mut self, x: f64, margin: &mut f64) -> f64 {
        let limit = micro(self.wire.spike_limit_un);
        let Some((last, slope)) = self.gate else {
            self.gate = Some((x, 0.0));
            return x;
        };
        let predicted = last + slope;
        let mut near = |a: f64, b: f64| {
            let distance = (a - b).abs();
            *margin = margin.min((distance - limit).abs());
            distance <= limit
        };
        let confirmed = self.held > 0 && near(x, self.rejected);
        if near(x, predicted) || confirmed || self.held == 3 {
            let slope = if self.held > 0 {
                0.0
            } else {
                (x - last).clamp(-limit, limit)
            };
            self.gate = Some((x, slope));
            self.held = 0;
            x
        } else {
            self.rejected = x;
            self.held += 1;
            self.gate = Some((predicted, 0.0));
            predicted
        }
    }

    fn filter(&mut self, x: f64) -> f64 {
        match self.wire.filter {
            FilterChoice::MovingAverage(n) => {
                let n = usize::from(n);
                if self.history.is_empty() {
                    self.history = vec![x; n];
                }
                self.history.push(x);
                self.history.remove(0);
                self.history.iter().sum::<f64>() / n as f64
            }
            FilterChoice::LowPass { corner_chz } => {
                // s^2 + sqrt2 s + 1 with s = (1/k) (z - 1)/(z + 1), k = tan(pi fc / fs).
                let k = (std::f64::consts::PI * f64::from(corner_chz) / 100.0 / RATE).tan();
                let a0 = 1.0 + 2f64.sqrt() * k + k * k;
                let a1 = 2.0 * (k * k - 1.0);
                let a2 = 1.0 - 2f64.sqrt() * k + k * k;
                let [x1, x2, y1, y2] = self.biquad.unwrap_or([x; 4]);
                let y = (k * k * (x + 2.0 * x1 + x2) - a1 * y1 - a2 * y2) / a0;
                self.biquad = Some([x, x1, y, y1]);
                y
            }
        }
    }

    /// The cell's curve and creep taken out of a straight reading.
    fn without_creep(&mut self, x: f64, dt_us: f64) -> f64 {
        let cell = self.wire.cell;
        let reading = x + f64::from(cell.curve_nn_per_n2) * 1e-9 * x.clamp(-20.0, 20.0).powi(2);
        if self.wire.zero_code == 0 {
            return reading;
        }
        let load = reading - self.crept;
        self.crept +=
            dt_us / (1e3 * f64::from(cell.creep_ms)) * (q16(cell.creep_q16) * load - self.crept);
        load
    }

    /// The feedforward, and half of what it jumps by in a reversal, without the level.
    fn friction(&self, tension: f64, counts: i64, share: f64) -> (f64, f64) {
        if !self.wire.friction_feedforward {
            return (tension, 0.0);
        }
        let gain = q16(self.wire.friction_gain_q16);
        let c0 = micro(self.wire.coulomb_un);
        let c1 = q16(self.wire.coulomb_load_q16);
        // Viscous friction at the smoothed speed, at most 3 N.
        let speed_m_per_s = self.viscous_nm * 1e-9 * RATE;
        let viscous = (q16(self.wire.viscous_q16) * speed_m_per_s).clamp(-3.0, 3.0);
        let ripples: f64 = self
            .wire
            .ripples
            .iter()
            .map(|r| {
                let turn = 2f64.powi(32);
                // Whole turns out before the product loses digits.
                let turns = i128::from(counts) * i128::from(r.periods_per_count_q32)
                    + i128::from(r.phase_q32);
                let turns = turns.rem_euclid(1 << 32) as f64 / turn;
                (micro(r.amplitude_un) + q16(r.amplitude_load_q16) * tension)
                    * (std::f64::consts::TAU * turns).sin()
            })
            .sum();
        let base = tension - micro(self.wire.friction_offset_un) + viscous - ripples;
        let winding_in = (base + c0) / (gain - c1);
        let paying_out = (base - c0) / (gain + c1);
        let half = (winding_in - paying_out) / 2.0 * share;
        let middle = (winding_in + paying_out) / 2.0;
        (
            middle + self.direction * half * (1.0 + self.level.excess),
            half,
        )
    }

    /// The travel that the host foretells for this sample, where it is believed.
    fn foretold(
        &mut self,
        input: &Input,
        travel_nm: f64,
        spans: f64,
        margin: &mut f64,
    ) -> Option<f64> {
        self.doubt = self.doubt.saturating_sub(1);
        let Some(speed) = input.setpoint.reel else {
            self.lead_nm -= self.lead_nm / 128.0;
            return None;
        };
        let expected_nm = f64::from(speed.nm_q8()) / 256.0 * spans;
        self.lead_nm = (self.lead_nm + expected_nm - travel_nm).clamp(-2e6, 2e6);
        self.lead_nm -= self.lead_nm / 128.0;
        // Fixed point rounds up to a 256th of a nanometre away in each of the 128 samples that
        // count.
        let most = if self.doubt == 0 { 5e5 } else { 2.5e5 };
        if (self.lead_nm.abs() - most).abs() < 1.0 {
            *margin = 0.0;
        }
        if self.lead_nm.abs() > most {
            self.doubt = 255;
        }
        (self.doubt == 0).then_some(expected_nm)
    }

    pub fn step(&mut self, input: &Input) -> Answer {
        let w = self.wire;
        let mut margin = f64::INFINITY;
        let code = input.adc_code.get();
        let force = f64::from(code - w.zero_code) * f64::from(w.scale_pn_per_count) * 1e-12;
        let straight = self.spike_gate(force, &mut margin);
        let (from, dt) = match self.last {
            Some((counts, at)) => (counts, f64::from(input.at.0.wrapping_sub(at))),
            None => (input.encoder_counts.0, PERIOD_US),
        };
        self.last = Some((input.encoder_counts.0, input.at.0));
        let dt_us = dt.clamp(1_000.0, 12_500.0);
        let gated = self.without_creep(straight, dt_us);
        let inv_cos = q16(input.setpoint.inv_cos.q16());
        let tension = self.filter(gated) * inv_cos;
        let rise = tension - self.tension;
        self.tension = tension;

        // Periods that the differences span.
        let spans = if dt_us < 4_687.0 {
            1.0
        } else if dt_us < 9_375.0 {
            2.0
        } else {
            4.0
        };
        let largest = 4_194_304.0;
        let moved = ((input.encoder_counts.0 - from) as f64 * f64::from(w.travel_nm_per_count))
            .clamp(-largest, largest);
        // A position that jumps, by more than a millimetre a sample in a sample.
        let jumped = (moved - self.travel_nm).abs() > 1e6 && dt < 4_687.0;
        let travel = if jumped { self.travel_nm } else { moved };
        self.travel_nm = (travel / spans).floor();

        self.viscous_nm += ((travel / spans).floor() - self.viscous_nm) / 8.0;

        // Direction.
        let play = f64::from(w.travel_nm_per_count).abs();
        // (The half play is a whole number of nanometres.)
        let half = (play / 2.0).floor();
        let fine = self.fine_nm + travel;
        self.fine_nm = fine.clamp(-half, half);
        let steady = fine - self.fine_nm;
        self.pace_nm += (steady.abs().min(65_536.0) - self.pace_nm) / 4.0;
        let still = (1.0 - self.pace_nm / 4_096.0).max(0.0);
        let position = self.slack_nm + travel;
        self.slack_nm = position.clamp(-play, play);
        let error = if self.closed {
            self.setpoint - tension
        } else {
            0.0
        };
        let beyond = (error - error.clamp(-0.01, 0.01)).clamp(-4.0, 4.0);
        let used_up = position - self.slack_nm;
        let intent = 154.0 / 256.0 * beyond * still;
        let foretold_nm = self.foretold(input, travel, spans, &mut margin);
        if let Some(foretold_nm) = foretold_nm {
            let weight = (8.0 * still).min(1.0);
            let used = used_up + weight * (foretold_nm.clamp(-largest, largest) - used_up);
            let mut elements = self.elements.unwrap_or([self.direction; 4]);
            for (n, element) in elements.iter_mut().enumerate() {
                // Quarters of 0.7 times half of the configured reversal.
                let slips_nm = 0.35 * f64::from(w.reversal_nm) * (n + 1) as f64 / 4.0;
                let change = (used / slips_nm).clamp(-1.0, 1.0) + intent.clamp(-1.0, 1.0);
                let change = change.clamp(-1.0, 1.0);
                *element = (*element + change).clamp(-1.0, 1.0);
            }
            self.elements = Some(elements);
            self.direction = elements.iter().sum::<f64>() / 4.0;
        } else {
            self.elements = None;
            let change = 2.0 * used_up / f64::from(w.reversal_nm) + intent;
            self.direction = (self.direction + change.clamp(-1.0, 1.0)).clamp(-1.0, 1.0);
        }

        // Trips.
        let direct = gated.max(straight) * inv_cos;
        let mut over = micro(w.over_tension_un);
        if input.drive != Drive::Off {
            over = over.min((micro(w.tension_max_un) + 1.0).max(13.0));
        }
        margin = margin.min((direct - over).abs());
        self.over = if direct > over { self.over + 1 } else { 0 };
        self.saturated = if code == 8_388_607 || code == -8_388_608 {
            self.saturated + 1
        } else {
            0
        };
        margin = margin.min((tension - 1.0).abs());
        self.lost_nm = if tension > 1.0 || input.drive == Drive::Off {
            0.0
        } else {
            (self.lost_nm + travel).max(0.0)
        };
        let tripped = self.over >= 2
            || self.saturated >= 2
            || self.lost_nm > 150e6
            || jumped && input.drive != Drive::Off;

        let limit = micro(w.force_limit_un);
        let slew = f64::from(w.slew_un_per_s) * 1e-12 * dt_us;
        let requested = input.setpoint.tension.to_f64().clamp(0.0, limit);
        let drive = match input.drive {
            _ if tripped => Drive::Off,
            Drive::Follow if requested == 0.0 => Drive::Ramp,
            drive => drive,
        };
        let mut answer = Answer {
            tension,
            direction: self.direction,
            margin,
            tripped,
            ..Answer::default()
        };
        match drive {
            Drive::Off => {
                self.command = 0.0;
                self.closed = false;
            }
            Drive::Ramp => {
                self.command += (0.0 - self.command).clamp(-slew / 8.0, slew / 8.0);
                self.closed = false;
            }
            Drive::Follow => {
                let start = if self.closed {
                    self.setpoint
                } else {
                    tension.clamp(0.0, limit)
                };
                let target = if tension < 1.0 && self.travel_nm > 62_500.0 {
                    requested.min(2.0)
                } else {
                    requested
                };
                self.setpoint = start + (target - start).clamp(-slew / 8.0, slew / 8.0);
                let ramps = (target - start).abs() > slew / 8.0;
                let error = self.setpoint - tension;
                let margin_share = control::friction::REVERSAL_SHARE_Q16 as f64 / 65_536.0;
                let foretold_share = control::friction::FORETOLD_SHARE_Q16 as f64 / 65_536.0;
                let share_of = |foretold| {
                    if foretold {
                        foretold_share
                    } else {
                        margin_share
                    }
                };
                let share = share_of(foretold_nm.is_some());
                let (feedforward, half) =
                    self.friction(self.setpoint, input.encoder_counts.0, share);
                if foretold_nm.is_some() != self.foretold {
                    // The command goes on without a jump.
                    let before = half * share_of(self.foretold) / share;
                    let more = (1.0 + self.level.excess) * (half - before);
                    self.integral -= self.direction * more;
                    // The means are of a reel that slid, one in each direction.
                    let of_mean = if self.level.inwards { more } else { -more };
                    self.level.mean -= of_mean;
                    self.level.before = self.level.before.map(|before| before + of_mean);
                    self.foretold = foretold_nm.is_some();
                }
                let p = q16(w.kp_q16) * error;
                let derivative = if self.closed {
                    -q16(w.kd_q16) * RATE * rise / spans
                } else {
                    0.0
                };
                let speed = steady / spans;
                self.slow_nm += (speed - self.slow_nm) * 768.0 / 65_536.0;
                let d = derivative - q16(w.damping_q16) * RATE * 1e-9 * (speed - self.slow_nm);
                if !self.closed {
                    self.level = Level {
                        excess: self.level.excess,
                        ..Level::default()
                    };
                    self.integral = (self.command - feedforward - p - d).clamp(-limit, limit);
                    self.leaky = 0.0;
                }
                let i = self.integral + self.leaky;
                let slack = (self.setpoint / 2.0).min(1.0);
                let missing = slack - tension.clamp(0.0, slack);
                let brake = 268.0 / 4_194_304.0 * (travel - 93_750.0).max(0.0) * missing;
                let unlimited = feedforward + p + i + d;
                // The most that the friction model needs for the setpoint, and the authority over
                // it.
                let gain_in = q16(w.friction_gain_q16) - q16(w.coulomb_load_q16);
                let winding_in =
                    (self.setpoint - micro(w.friction_offset_un) + micro(w.coulomb_un)) / gain_in;
                let most = (winding_in + micro(w.authority_un)).clamp(0.0, limit);
                let limited = (unlimited - brake).clamp(0.0, most);
                let before = self.command;
                self.command += (limited - before).clamp(-slew, slew);
                let boost = if w.friction_feedforward {
                    1.0
                } else {
                    1.0 + 4.0 * still
                };
                let gain = (q16(w.ki_q16) * dt_us * 1e-6 * boost).min(2.0);
                let excess = unlimited - self.command;
                let addition = |gain: f64| match gain * error {
                    addition if excess > 0.0 && addition > 0.0 => (addition - excess).max(0.0),
                    addition if excess < 0.0 && addition < 0.0 => (addition - excess).min(0.0),
                    addition => addition,
                };
                self.integral = (self.integral + addition(gain)).clamp(-limit, limit);
                let leaky_gain = if ramps {
                    0.0
                } else {
                    q16(w.leaky_ki_q16) / RATE
                };
                self.leaky += addition(leaky_gain) - self.leaky * 3_001.0 / 65_536.0;
                self.closed = true;
                let short = 1.0 - self.direction.abs() - 2f64.powi(-10);
                // Fixed point may see it the other way round where the reel nearly slides. The
                // direction's scale goes in steps of 1/256, which adds up over a reversal.
                let rounding = 1e-8 + 4.0 * f64::from(w.reversal_nm) * 2f64.powi(-39);
                if w.friction_feedforward && short < rounding && still < 0.5 + 3e-6 {
                    answer.margin = answer.margin.min((still - 0.5).abs());
                    if short.abs() < rounding {
                        answer.margin = 0.0;
                    }
                }
                if short >= 0.0 || still >= 0.5 {
                    self.level.pause();
                } else {
                    let inwards = self.direction > 0.0;
                    self.integral -= self.level.slid(inwards, self.integral, half, share);
                }
                answer = Answer {
                    p,
                    i,
                    d,
                    feedforward,
                    ..answer
                };
            }
        }
        answer.command = self.command;
        answer
    }
}
