//! Direction of the reel, and the command that produces a given tension in spite of friction.
//!
//! Measured on the rig: F = offset + gain cmd - dir (c0 + c1 cmd), with dir = +1 winding in. Solved
//! for the command that produces a given F:
//!
//! * winding in: cmd = (F - offset + c0) / (gain - c1)
//! * paying out: cmd = (F - offset - c0) / (gain + c1)
//!
//! For a direction estimate between -1 and 1 the command is interpolated linearly between the two,
//! less a margin ([`REVERSAL_SHARE_Q16`]).
//!
//! Two more terms, off unless configured, count like an offset: viscous friction (F falls by b v)
//! and ripples over the reel's angle. The speed for the former is the mean of the travel over about
//! 25 ms, for two reasons. One count in a sample is 1.35 mm/s already. And compensation of viscous
//! friction is positive feedback of the speed, which must not act at the frequency of the cable's
//! swing (16 to 25 Hz). See [`ReelSpeed`] and [`Ripples`].

use crate::limits::clamp_abs;
use crate::units::{EncoderCounts, Newton};
use wire::message::{UnitConfig, RIPPLES};

/// Direction of the reel, -1 (paying out) to +1 (winding in), times 2^30.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Direction(i32);

impl Direction {
    /// Times 2^30.
    pub const ONE: i32 = 1 << 30;

    /// From a number times 2^30; brought into -1 to 1.
    #[must_use]
    pub fn from_q30(q30: i64) -> Self {
        Self(q30.clamp(-i64::from(Self::ONE), i64::from(Self::ONE)) as i32)
    }

    /// Times 2^30.
    #[must_use]
    pub const fn q30(self) -> i32 {
        self.0
    }
}

/// Tension that a cable must come down to after 0 V, where no more friction is declared than that
/// of the example rig: what it holds at rest, 1.1 N, and a margin.
pub const LET_GO: Newton = Newton::from_un(1_700_000);

/// The same over what the declared friction holds at 0 V, times 32: [`LET_GO`] over the 1.064 N of
/// the example rig. Its share of the load, breakaway and what the robot's motion adds grow with
/// it: a reel that holds 1.85 N by this model was seen to hold 2.84 N (closed loop, seed 13).
const LET_GO_SHARE_Q5: i64 = 51;

/// Swing of tension less command that no resting reel allows, where no more friction is declared
/// than that of the example rig. A reel that stands holds what friction lets it: from
/// 0.91 + 0.154 T below the command to as much above, which is 5.5 N at 12 N. More than that moves
/// the reel, by 1 mm in 24 N of an elastic cable and so by dozens of counts. The tension alone says
/// nothing: with a robot that moves away while the command rises it goes from 0 to 12 N, and the
/// reel rests.
pub const STILL_SWING: Newton = Newton::from_un(6_000_000);

/// The same over what the declared friction holds from one side to the other, times 32: as far
/// beyond as [`STILL_SWING`] is beyond the 5.5 N of the example rig, which keeps it.
const STILL_SHARE_Q5: i64 = 34;

/// A part of a force, in 32nds.
fn share(force: Newton, q5: i64) -> Newton {
    Newton::from_wide((i64::from(force.to_bits()) * q5) >> 5)
}

/// The inverse friction model and the direction estimate's scale, precomputed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Model {
    enabled: bool,
    offset: i32,
    coulomb: i32,
    /// 1 / (gain - c1), times 2^24.
    inv_in_q24: i32,
    /// 1 / (gain + c1), times 2^24.
    inv_out_q24: i32,
    /// gain - c1 and gain + c1, times 65,536.
    gain_in_q16: i32,
    gain_out_q16: i32,
    /// Direction (times 2^30) per nanometre, times 256.
    per_nm_q8: i32,
    /// The same for the last element to slide of [`Presliding`].
    presliding_q8: i32,
    /// Play that the travel must use up before it counts, in nanometres: one encoder count.
    play_nm: i32,
    /// Force steps per nanometre a nominal sample, times 65,536.
    viscous: i32,
    ripples: Ripples,
}

impl Model {
    /// From a configuration that was checked.
    #[must_use]
    pub fn new(wire: &UnitConfig) -> Self {
        let gain = f64::from(wire.friction_gain_q16) / 65_536.0;
        let c1 = f64::from(wire.coulomb_load_q16) / 65_536.0;
        let inverse = |x: f64| {
            // The ranges keep x >= 0.25, so the inverse is at most 4. (0.1: no division by zero,
            // whatever comes.)
            crate::units::rounded(f64::from(1u32 << 24) / if x < 0.1 { 0.1 } else { x })
        };
        // -1 to +1 over the reversal travel.
        let per_nm = 2.0 * f64::from(Direction::ONE) / f64::from(wire.reversal_nm.max(1));
        Self {
            enabled: wire.friction_feedforward,
            offset: Newton::from_un(wire.friction_offset_un).to_bits(),
            coulomb: Newton::from_un(wire.coulomb_un).to_bits(),
            inv_in_q24: inverse(gain - c1),
            inv_out_q24: inverse(gain + c1),
            gain_in_q16: wire.friction_gain_q16.saturating_sub(wire.coulomb_load_q16),
            gain_out_q16: wire.friction_gain_q16.saturating_add(wire.coulomb_load_q16),
            per_nm_q8: crate::units::rounded(per_nm * 256.0),
            presliding_q8: crate::units::rounded(per_nm / PRESLIDING_SHARE * 256.0),
            play_nm: wire.travel_nm_per_count.saturating_abs(),
            viscous: crate::units::rounded(
                f64::from(wire.viscous_q16)
                    * f64::from(crate::NOMINAL_SPS)
                    * 1e-9
                    * f64::from(1u32 << Newton::FRAC_BITS),
            ),
            ripples: Ripples::new(wire),
        }
    }

    /// What viscous friction takes at this speed, at most [`VISCOUS_LIMIT`].
    fn viscous(&self, speed: ReelSpeed) -> Newton {
        if self.viscous == 0 {
            return Newton::ZERO;
        }
        // 27,487 steps a nanometre at most, and 31 bits of speed.
        let wide = (i64::from(self.viscous) * i64::from(speed.nm_q8())) >> 24;
        Newton::from_wide(wide).clamp_abs(VISCOUS_LIMIT)
    }

    /// Whether the compensation is switched on.
    #[must_use]
    pub const fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// The command that holds `tension` while the reel winds in, compensation on or off, without
    /// viscous friction and ripples: the most that the model ever needs for it.
    #[must_use]
    pub const fn winding_in(&self, tension: Newton) -> Newton {
        let base = tension.to_bits() as i64 - self.offset as i64 + self.coulomb as i64;
        Newton::from_wide((base * self.inv_in_q24 as i64) >> 24)
    }

    /// The least tension that `command` can make: winding in. A resting reel holds any tension from
    /// here to [`Self::most`].
    #[must_use]
    pub const fn least(&self, command: Newton) -> Newton {
        let pull = (command.to_bits() as i64 * self.gain_in_q16 as i64) >> 16;
        Newton::from_wide(pull + self.offset as i64 - self.coulomb as i64)
    }

    /// The most tension that `command` can hold: paying out.
    #[must_use]
    pub const fn most(&self, command: Newton) -> Newton {
        let pull = (command.to_bits() as i64 * self.gain_out_q16 as i64) >> 16;
        Newton::from_wide(pull + self.offset as i64 + self.coulomb as i64)
    }

    /// Tension that the cable must come down to once its motor is at 0 V: what the declared
    /// friction holds then, and a margin.
    #[must_use]
    pub fn let_go(&self) -> Newton {
        LET_GO.max(share(self.most(Newton::ZERO), LET_GO_SHARE_Q5))
    }

    /// Swing of tension less command that the resting reel may hold up to a `largest` tension:
    /// friction changes sides.
    #[must_use]
    pub fn still_swing(&self, largest: Newton) -> Newton {
        let sides = self.most(largest).saturating_sub(self.least(largest));
        STILL_SWING.max(share(sides, STILL_SHARE_Q5))
    }

    /// The command that makes `tension` while the reel moves in `direction`, with the reel `speed`
    /// and the position `at` for the viscous term and the ripples. With the compensation switched
    /// off it is the tension itself.
    #[must_use]
    pub fn command(
        &self,
        tension: Newton,
        direction: Direction,
        speed: ReelSpeed,
        at: EncoderCounts,
        level: &Level,
    ) -> Feedforward {
        if !self.enabled {
            return Feedforward {
                command: tension,
                half: Newton::ZERO,
            };
        }
        let base = tension
            .saturating_sub(Newton::from_bits(self.offset))
            .saturating_add(self.viscous(speed))
            .saturating_sub(self.ripples.at(at, tension));
        let coulomb = Newton::from_bits(self.coulomb);
        let times =
            |force: Newton, inv_q24: i32| (i64::from(force.to_bits()) * i64::from(inv_q24)) >> 24;
        // 30 bits each at most (94 N within the ranges).
        let winding_in = times(base.saturating_add(coulomb), self.inv_in_q24) as i32;
        let paying_out = times(base.saturating_sub(coulomb), self.inv_out_q24) as i32;
        let middle = (winding_in + paying_out) >> 1;
        let half = i64::from((winding_in - paying_out) >> 1) * i64::from(level.share.q16());
        let half = Newton::from_bits((half >> 16) as i32);
        let taken = i64::from(level.times(half).to_bits()) * i64::from(direction.q30());
        Feedforward {
            command: Newton::from_bits(middle)
                .saturating_add(Newton::from_bits((taken >> 30) as i32)),
            half,
        }
    }
}

/// What the friction model adds to the controller's terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Feedforward {
    /// The command that it makes of the setpoint.
    pub command: Newton,
    /// Part of it that changes sign with the direction, without [`Level`]: half of what the
    /// feedforward jumps by in a reversal.
    pub half: Newton,
}

/// How much larger the friction is than the model's, as the integral shows it at reversals.
///
/// What the model lacks of the friction ends in the integral, with one sign while the reel winds in
/// and with the other while it pays out. What it lacks of offset, gain or ripples is the same just
/// before a reversal and just after it. Half of the difference is therefore friction. The
/// feedforward takes it over, so that the next reversal does not have to wait for the integral. It
/// moves from one to the other: the command does not change by it.
///
/// The numbers below were found with the example `tension_loop`: friction 20 % below and above the
/// declared one (`level=0.8`, `1.2`), and the plants of `control/tests/tension_loop.rs` besides,
/// none of which may get worse. Means over whole slides instead of the pair at a reversal learned
/// as much, and took a ripple of the motor for friction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Level {
    /// Friction over that of the model, less one, times 2^24.
    excess_q24: i32,
    inwards: bool,
    /// Mean of the integral while the reel slides in this direction, and its samples.
    mean: Newton,
    samples: u8,
    /// The mean before the reversal.
    before: Option<Newton>,
    /// Samples since the reel slid.
    rested: u8,
    share: Share,
}

/// First-order mean of the integral over some 16 samples, 50 ms.
const MEAN_SHIFT: u32 = 4;

/// Samples in one direction until the mean is that direction's, 0.2 s: three times what the
/// integral (33 ms) and the mean take together, with a margin.
const WHOLE: u8 = 64;

/// Longest rest within a reversal in samples, 0.8 s. With 96 (0.3 s) a third of what is learned was
/// not: many reels rest longer where the robot turns.
const LONGEST_REST: u8 = 250;

/// Most that the friction is taken to differ from the model's: 40 %, times 2^24. A rig file that is
/// wrong by more is for `forcectl identify`, and a load cell that reads wrong must not make the
/// feedforward pull by more than this.
const LEVEL_LIMIT_Q24: i32 = 6_710_886;

/// Friction with less than this says nothing about its level, 0.25 N: some 10 mN of noise in the
/// mean are 4 % of it.
const LEAST_FRICTION: Newton = Newton::from_un(250_000);

/// What [`REVERSAL_SHARE_Q16`] leaves to the integral, over what it takes, times 65,536: 1/9.
const LEFT_Q16: i64 = (1 << 32) / REVERSAL_SHARE_Q16 - (1 << 16);

/// How much of the friction the feedforward takes over.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Share {
    /// [`REVERSAL_SHARE_Q16`]: the encoder alone shows a reversal.
    #[default]
    Encoder,
    /// [`FORETOLD_SHARE_Q16`]: the host has foretold it.
    Foretold,
}

impl Share {
    /// Times 65,536.
    const fn q16(self) -> i32 {
        match self {
            Self::Encoder => REVERSAL_SHARE_Q16 as i32,
            Self::Foretold => FORETOLD_SHARE_Q16 as i32,
        }
    }

    /// What it leaves to the integral, over what it takes, times 65,536.
    const fn left_q16(self) -> i64 {
        const FORETOLD: i64 = (1 << 32) / FORETOLD_SHARE_Q16 - (1 << 16);
        match self {
            Self::Encoder => LEFT_Q16,
            Self::Foretold => FORETOLD,
        }
    }

    /// What it takes more than the other, over what it takes, times 2^30: finer than the share's
    /// own bits, because the errors of many exchanges add up in the integral.
    const fn more_q30(self) -> i64 {
        const fn more(than: i64, share: i64) -> i64 {
            (1 << 30) - (than << 30) / share
        }
        const ENCODER: i64 = more(FORETOLD_SHARE_Q16, REVERSAL_SHARE_Q16);
        const FORETOLD: i64 = more(REVERSAL_SHARE_Q16, FORETOLD_SHARE_Q16);
        match self {
            Self::Encoder => ENCODER,
            Self::Foretold => FORETOLD,
        }
    }
}

impl Level {
    /// Friction over that of the model, less one.
    #[must_use]
    pub fn excess(&self) -> f64 {
        f64::from(self.excess_q24) / f64::from(1 << 24)
    }

    /// The friction's part of the feedforward with this level.
    const fn times(&self, half: Newton) -> Newton {
        let factor_q24 = (1 << 24) + self.excess_q24;
        Newton::from_bits(((half.to_bits() as i64 * factor_q24 as i64) >> 24) as i32)
    }

    /// The integral begins anew: its means so far are of another one. What was learned stays.
    pub fn begin(&mut self) {
        *self = Self {
            excess_q24: self.excess_q24,
            share: self.share,
            ..Self::default()
        };
    }

    /// Whether the host foretells the reel's travel; returns whether that is new. The next
    /// [`Model::command`] takes over another share of the friction then, and the integral is to
    /// give up [`Self::exchanged`].
    pub fn foretell(&mut self, foretold: bool) -> bool {
        let share = if foretold {
            Share::Foretold
        } else {
            Share::Encoder
        };
        let is_new = self.share != share;
        self.share = share;
        is_new
    }

    /// What a new share has moved from the integral to the feedforward, with the sign of the
    /// command; `half` is [`Feedforward::half`] with it. The means of the integral move as much,
    /// each in its direction: a host that foretells now and then does not keep the level from being
    /// learned.
    #[inline(never)]
    #[must_use]
    pub fn exchanged(&mut self, half: Newton, direction: Direction) -> Newton {
        // 30 bits of force, 27 of the share.
        let more = (i64::from(self.times(half).to_bits()) * self.share.more_q30()) >> 30;
        let of_mean = Newton::from_wide(self.inward(more));
        self.mean = self.mean.saturating_sub(of_mean);
        self.before = self.before.map(|before| before.saturating_add(of_mean));
        Newton::from_wide((more * i64::from(direction.q30())) >> 30)
    }

    /// The reel does not slide: the integral says nothing about friction.
    pub fn pause(&mut self) {
        if self.samples == 0 && self.before.is_none() {
            return;
        }
        self.rested = self.rested.saturating_add(1);
        if self.rested > LONGEST_REST {
            self.samples = 0;
            self.before = None;
        }
    }

    /// A sample of a sliding reel, with the integral and [`Feedforward::half`]. What the integral
    /// has to give up, with the sign of the command, where a reversal has shown it.
    pub fn slid(&mut self, inwards: bool, integral: Newton, half: Newton) -> Option<Newton> {
        self.rested = 0;
        if inwards != self.inwards {
            self.before = (self.samples >= WHOLE).then_some(self.mean);
            self.inwards = inwards;
            self.samples = 0;
        }
        // Newtons are 31 bits: their difference does not wrap once it is shifted.
        let step = (integral.to_bits() >> MEAN_SHIFT) - (self.mean.to_bits() >> MEAN_SHIFT);
        self.mean = Newton::from_bits(self.mean.to_bits().wrapping_add(step));
        if self.samples >= WHOLE {
            return None;
        }
        self.samples += 1;
        let before = self.before.filter(|_| self.samples == WHOLE)?;
        self.before = None;
        self.learn(before, half)
    }

    /// With the sign that friction has in this direction.
    const fn inward(&self, value: i64) -> i64 {
        if self.inwards {
            value
        } else {
            -value
        }
    }

    /// Takes over what the mean shows after a reversal.
    #[inline(never)]
    fn learn(&mut self, before: Newton, half: Newton) -> Option<Newton> {
        if half < LEAST_FRICTION {
            return None;
        }
        let change = i64::from(self.mean.to_bits()) - i64::from(before.to_bits());
        let shown = self.inward(change) >> 1;
        let left = (i64::from(self.times(half).to_bits()) * self.share.left_q16()) >> 16;
        let missing = clamp_abs(shown - left, 2 << Newton::FRAC_BITS);
        // At most 8, times 2^24. Once a reversal: the wide division costs nothing.
        let ratio_q24 = (missing << 24) / i64::from(half.to_bits());
        let learned = self.excess_q24.saturating_add(ratio_q24 as i32);
        let learned = clamp_abs(learned, LEVEL_LIMIT_Q24);
        let more = i64::from(learned - self.excess_q24) * i64::from(half.to_bits());
        self.excess_q24 = learned;
        let moved = Newton::from_wide(self.inward(more) >> 24);
        self.mean = self.mean.saturating_sub(moved);
        Some(moved)
    }
}

/// Part of the friction between winding in and paying out that the feedforward takes over, times
/// 65,536: 0.9.
///
/// The rest is left to the integral. A reversal that is compensated too early or by too much pulls
/// the cable the wrong way, which costs more than one that is compensated too little. Found with
/// the example `tension_loop` on the plant with its presliding distance, breakaway, cable and
/// friction changed both ways, which `control/tests/tension_loop.rs` holds.
pub const REVERSAL_SHARE_Q16: i64 = 58_982;

/// The same where the host foretells the reversal ([`crate::preview`]): 0.98. With all of it the
/// largest error as declared is smaller still, but larger than without the host where friction is a
/// fifth below the declared one.
pub const FORETOLD_SHARE_Q16: i64 = 64_225;

/// Largest viscous friction that is compensated: 3 N, twice what the reel's dry friction is at 4 N.
pub const VISCOUS_LIMIT: Newton = Newton::from_un(3_000_000);

/// Part of the difference that [`ReelSpeed`] takes over in a sample: 1/8, a mean over some eight
/// samples (25 ms).
const REEL_SPEED_SHIFT: u32 = 3;

/// The reel's speed for the viscous term: first-order mean of the travel a sample, in nanometres
/// times 256.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReelSpeed(i32);

impl ReelSpeed {
    /// From micrometres a second, within 1 m/s.
    #[must_use]
    pub fn from_um_per_s(um_per_s: i32) -> Self {
        const Q8_PER_UM: i32 = 1_000 * 256 / crate::NOMINAL_SPS as i32;
        Self(clamp_abs(um_per_s, 1_000_000) * Q8_PER_UM)
    }

    /// Takes a nominal sample's travel in nanometres.
    pub fn step(&mut self, travel_nm: i32) {
        let travel = travel_nm.clamp(-MAX_TRAVEL_NM, MAX_TRAVEL_NM) << 8;
        // Rounded to the nearest, so that a speed dies out on both sides alike. 31 bits each, their
        // difference 32.
        let difference = i64::from(travel) - i64::from(self.0);
        let half = 1 << (REEL_SPEED_SHIFT - 1);
        self.0 = self
            .0
            .saturating_add(((difference + half) >> REEL_SPEED_SHIFT) as i32);
    }

    /// Nanometres a nominal sample, times 256.
    #[must_use]
    pub const fn nm_q8(self) -> i32 {
        self.0
    }
}

/// Sine of an angle in turns times 2^32, times 2^30.
///
/// The angle is folded to a quarter turn; there sin(pi/2 z) = z (c1 + c3 z^2 + c5 z^4 + c7 z^6),
/// the coefficients of a least-squares fit over Chebyshev points. Off by less than 1e-6 (tested).
#[must_use]
pub fn sin_q30(turns_q32: u32) -> i32 {
    const C1: i64 = 1_686_623_980;
    const C3: i64 = -693_521_966;
    const C5: i64 = 85_291_577;
    const C7: i64 = -4_652_396;
    let angle = turns_q32 as i32;
    // Past a quarter turn either way: mirrored there (half a turn less the angle).
    let z = if !(-(1 << 30)..=1 << 30).contains(&angle) {
        i32::MIN.wrapping_sub(angle)
    } else {
        angle
    };
    let z = i64::from(z);
    let square = (z * z) >> 30;
    let mut sum = C7;
    for coefficient in [C5, C3, C1] {
        sum = coefficient + ((sum * square) >> 30);
    }
    let sine = (z * sum) >> 30;
    clamp_abs(sine, 1 << 30) as i32
}

/// One ripple, precomputed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Ripple {
    /// Periods per count, times 2^32.
    rate: i32,
    /// Phase in turns, times 2^32.
    phase: i32,
    amplitude: i32,
    load_q16: i32,
}

/// The ripples of a unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Ripples([Ripple; RIPPLES]);

impl Ripples {
    fn new(wire: &UnitConfig) -> Self {
        Self(wire.ripples.map(|r| Ripple {
            rate: r.periods_per_count_q32,
            phase: r.phase_q32,
            amplitude: Newton::from_un(r.amplitude_un).to_bits(),
            load_q16: r.amplitude_load_q16,
        }))
    }

    /// Their force at a position while the cable is to hold `tension`.
    #[must_use]
    pub fn at(&self, counts: EncoderCounts, tension: Newton) -> Newton {
        let mut sum = 0;
        for r in self
            .0
            .iter()
            .filter(|r| r.amplitude != 0 || r.load_q16 != 0)
        {
            // Whole turns drop out of the 32 bits. The rate is off by half a 2^32nd of a period a
            // count: a thousandth of a turn after eight million counts, 36 m of cable.
            let turns = (counts.0 as u32)
                .wrapping_mul(r.rate as u32)
                .wrapping_add(r.phase as u32);
            let load = (i64::from(tension.to_bits()) * i64::from(r.load_q16)) >> 16;
            // 30 bits of amplitude at most, and 30 of sine.
            sum += ((i64::from(r.amplitude) + load) * i64::from(sin_q30(turns))) >> 30;
        }
        Newton::from_wide(sum)
    }
}

/// How much the reel rests, 0 (it moves) to 1 (it stands), times 2^24.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Stillness(i32);

impl Stillness {
    /// 1, times 2^24.
    pub const ONE: i64 = 1 << 24;

    /// From a number times 2^24; brought into 0 to 1.
    #[must_use]
    pub fn from_q24(q24: i32) -> Self {
        Self(q24.clamp(0, Self::ONE as i32))
    }

    /// Times 2^24.
    #[must_use]
    pub const fn q24(self) -> i32 {
        self.0
    }
}

/// Speed at which a reel no longer counts as resting, in nanometres a sample: 4,096, which are
/// 1.3 mm/s, one count a sample, and the smallest speed distinguishable from rest within 10 ms.
pub const MOVING_NM: i32 = 1 << 12;

/// Error that does not move the direction of a resting reel: 10 mN, two to six times the measured
/// noise (1.7 to 5 mN). A wider band leaves the cable that far off for as long as the integral
/// takes to cross the friction.
pub const REST_DEAD_BAND: Newton = Newton::from_un(10_000);

/// How fast the direction of a resting reel follows the error: 0.6 a newton and sample (192 a
/// newton and second), in steps of direction a step of force (2^30 / 2^22 * 0.6).
const REST_STEPS: i32 = 154;

/// Presliding distance at which the last element slides, over half of the configured reversal
/// travel ([`UnitConfig::reversal_nm`]), while the host foretells the travel. The nominal contact's
/// own is 0.6 (30 um, at 100 um configured). 0.7 costs less where the distance is twice as long.
const PRESLIDING_SHARE: f64 = 0.7;

/// Presliding friction as four elements of equal parts that slide after a quarter, a half, three
/// quarters and all of the presliding distance (Maxwell-slip, Al-Bender, Lampaert, Swevers 2005),
/// each -1 to 1 times 2^30. Most of the friction reverses early, and a small turn back is a small
/// loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Presliding([i32; 4]);

impl Presliding {
    /// Moves every element by a travel that moves the last one to slide by `last`, and by
    /// `further`; each at most by [`Direction::ONE`], and so both together. All in 32 bits: this is
    /// most of what a foretold sample costs.
    fn step(&mut self, last: i32, further: i32) -> Direction {
        const ONE: i32 = Direction::ONE;
        let [a, b, c, d] = self.0;
        let within = |step: i32| clamp_abs(step, ONE);
        let moved = |element: i32, step: i32| {
            within(element.saturating_add(within(step.saturating_add(further))))
        };
        // The third one: four thirds of it. 1/3 is 0.0101 0101.. binary.
        let third = ((i64::from(last) * 21_845) >> 16) as i32;
        let third = third + (third >> 16);
        self.0 = [
            moved(a, clamp_abs(last, ONE / 4) << 2),
            moved(b, clamp_abs(last, ONE / 2) << 1),
            moved(c, within(last.saturating_add(third))),
            moved(d, last),
        ];
        let [a, b, c, d] = self.0;
        // Each is a whole number of halves and a remainder: no sum of two wraps.
        Direction((((a >> 1) + (b >> 1)) >> 1) + (((c >> 1) + (d >> 1)) >> 1))
    }
}

/// Estimates the reel's direction.
///
/// *While the reel moves*, the estimate follows the travel alone, as presliding friction does: it
/// changes in proportion to the travel and is complete after the reversal travel. It does not use
/// the speed, so it cannot chatter around zero speed. One count of play suppresses the jitter of an
/// encoder that stands on an edge.
///
/// *While it rests*, friction can have any value inside its band, and the motor's force does not
/// reach the cable until the band is crossed. The estimate then depends on the direction in which
/// the reel has to move: winding in for too little tension, paying out for too much. It moves to
/// that side as long as the error is outside [`REST_DEAD_BAND`], and stays constant otherwise. So
/// the feedforward is at the edge of the band when the reel starts to move, and does not jump a
/// second time when the travel confirms the direction. (Measured on the plant of the emulated rig:
/// without this the compensation acts after the integral has crossed the band, and makes the error
/// larger.)
///
/// *Where the host foretells the travel* ([`crate::preview`]), a reel at rest takes that in place
/// of its own, which friction holds back until the estimate lets it go, and the estimate is that of
/// `Presliding`. A reel that moves keeps its own travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DirectionEstimator {
    direction: Direction,
    /// Travel that has not used up the play, -play to +play, in nanometres.
    slack_nm: i32,
    /// The same for half the play, which is enough against a jitter of one count.
    fine_slack_nm: i32,
    /// Travel of the last sample past half the play, in nanometres.
    steady_nm: i32,
    /// Mean of it without its sign, times 4,096; first order over four samples.
    speed_q12: i32,
    /// What the direction is the mean of while the host foretells the travel.
    presliding: Option<Presliding>,
}

/// Stillness from which the foretold travel counts in full: an eighth, as a shift. Found as the
/// other numbers.
const FORETOLD_SHIFT: u32 = 3;

impl DirectionEstimator {
    /// Most that the direction changes in one sample: half of a whole reversal. Whatever the reel
    /// does, the feedforward takes two samples at least from one side to the other.
    pub const MAX_STEP: i64 = Direction::ONE as i64;

    /// Takes a sample's travel in nanometres (positive: winding in) and the tension error (setpoint
    /// less tension; zero while the loop is open). `foretold_q8`: the travel that the host
    /// foretells, in nanometres times 256 ([`crate::preview::Preview::step`]).
    pub fn step(
        &mut self,
        model: &Model,
        travel_nm: i32,
        error: Newton,
        foretold_q8: Option<i32>,
    ) -> Direction {
        let travel_nm = travel_nm.clamp(-MAX_TRAVEL_NM, MAX_TRAVEL_NM);
        let fine = self.fine_slack_nm.saturating_add(travel_nm);
        self.fine_slack_nm = clamp_abs(fine, model.play_nm / 2);
        self.steady_nm = fine - self.fine_slack_nm;
        // Sixteen times the moving speed is as good as any speed, and keeps the sum within 32 bits.
        let speed = self.steady_nm.abs().min(MOVING_NM << 4) << 12;
        self.speed_q12 += (speed - self.speed_q12) >> 2;
        let position = self.slack_nm.saturating_add(travel_nm);
        self.slack_nm = clamp_abs(position, model.play_nm);
        // Both are far from 31 bits, unless a bit of the play has flipped.
        let effective = position.saturating_sub(self.slack_nm);
        let beyond = error.saturating_sub(error.clamp_abs(REST_DEAD_BAND));
        // 4 N give more than the largest step. 25 bits of it, and 31 of the rate and stillness.
        let beyond = clamp_abs(beyond.to_bits(), 4 << Newton::FRAC_BITS);
        let rate = self.stillness().0 * (REST_STEPS / 2);
        let intent = (i64::from(beyond) * i64::from(rate)) >> 23;

        self.direction = if let Some(foretold) = foretold_q8 {
            self.follow(model, effective, foretold, intent)
        } else {
            self.presliding = None;
            let presliding = (i64::from(effective) * i64::from(model.per_nm_q8)) >> 8;
            let change = (presliding + intent).clamp(-Self::MAX_STEP, Self::MAX_STEP);
            Direction::from_q30(i64::from(self.direction.0) + change)
        };
        self.direction
    }

    /// The direction where the host foretells the travel. Apart from [`Self::step`], so that a
    /// sample without it does not pay for it.
    #[inline(never)]
    fn follow(
        &mut self,
        model: &Model,
        effective_nm: i32,
        foretold_q8: i32,
        intent: i64,
    ) -> Direction {
        // Stillness is 25 bits.
        let weight = (self.stillness().0 << FORETOLD_SHIFT).min(Stillness::ONE as i32);
        // 30 bits each, their difference 31, and 24 of the weight.
        const MOST: i32 = (MAX_TRAVEL_NM << 8) - 1;
        let travel = clamp_abs(effective_nm, MAX_TRAVEL_NM - 1) << 8;
        let foretold = clamp_abs(foretold_q8, MOST);
        let nearer = (i64::from(foretold - travel) * i64::from(weight)) >> 24;
        let used = travel + nearer as i32;
        let last = (i64::from(used) * i64::from(model.presliding_q8)) >> 16;
        let last = clamp_abs(last, i64::from(Direction::ONE)) as i32;
        let further = clamp_abs(intent, Self::MAX_STEP) as i32;
        let start = Presliding([self.direction.0; 4]);
        self.presliding.get_or_insert(start).step(last, further)
    }

    /// The direction now.
    #[must_use]
    pub const fn direction(&self) -> Direction {
        self.direction
    }

    /// Travel of the last sample in nanometres, without the jitter of an encoder that stands on an
    /// edge. For terms that depend on the speed: one count in a sample is 1.4 mm/s already.
    #[must_use]
    pub const fn steady_travel_nm(&self) -> i32 {
        self.steady_nm
    }

    /// Whether the reel winds in (`true`) or pays out, where it slides: past the reversal travel,
    /// but for a thousandth of it, and faster than half of the speed at which it counts as moving.
    #[must_use]
    pub fn slides(&self) -> Option<bool> {
        // Times 4,096, and half of it: the stillness is below a half.
        let moves = self.speed_q12 > MOVING_NM << 11;
        let direction = self.direction.q30();
        let past = direction.abs() > Direction::ONE - Direction::ONE / 1024;
        (moves && past).then_some(direction > 0)
    }

    /// How much the reel rests.
    #[must_use]
    pub fn stillness(&self) -> Stillness {
        // MOVING_NM times 4,096 is 2^24: the speed is the share already.
        Stillness::from_q24((MOVING_NM << 12) - self.speed_q12)
    }
}

/// Largest travel of a sample that is accepted, in nanometres: 4.2 mm in 3.1 ms is 1.3 m/s, twice
/// what the motor reaches at the amplifier's voltage. Longer ones are limited to it.
pub const MAX_TRAVEL_NM: i32 = 1 << 22;

/// Travel between two encoder positions in nanometres, positive winding in.
#[must_use]
pub fn travel(from: EncoderCounts, to: EncoderCounts, nm_per_count: i32) -> i32 {
    let counts = to.0.wrapping_sub(from.0).clamp(-(1 << 22), 1 << 22);
    let nm = i64::from(counts as i32) * i64::from(nm_per_count);
    nm.clamp(-i64::from(MAX_TRAVEL_NM), i64::from(MAX_TRAVEL_NM)) as i32
}
