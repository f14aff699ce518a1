//! Which way the reel goes, and what command makes a wanted tension in spite of friction.
//!
//! Measured on the rig: F = offset + gain cmd - dir (c0 + c1 cmd), with dir = +1 winding in. Solved for the
//! command that makes a wanted F:
//!
//! * winding in: cmd = (F - offset + c0) / (gain - c1)
//! * paying out: cmd = (F - offset - c0) / (gain + c1)
//!
//! and in between, for a direction that is not sure of itself, straight between the two.

use crate::units::{Counts, Newton};
use force_wire::message::UnitConfig;

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
    /// Direction (times 2^30) per nanometre, times 256.
    per_nm_q8: i32,
    /// Play that the travel must use up before it counts, in nanometres: one encoder count.
    play_nm: i32,
}

impl Model {
    /// From a configuration that was checked.
    #[must_use]
    pub fn new(wire: &UnitConfig) -> Self {
        let gain = f64::from(wire.friction_gain_q16) / 65_536.0;
        let c1 = f64::from(wire.coulomb_load_q16) / 65_536.0;
        let inverse = |x: f64| {
            // The ranges keep x >= 0.1, so the inverse needs at most 4 bits above the point.
            crate::config::rounded(f64::from(1u32 << 24) / if x < 0.1 { 0.1 } else { x })
        };
        // -1 to +1 over the reversal travel.
        let per_nm = 2.0 * f64::from(Direction::ONE) / f64::from(wire.reversal_nm.max(1));
        Self {
            enabled: wire.friction_feedforward,
            offset: Newton::from_un(wire.friction_offset_un).to_bits(),
            coulomb: Newton::from_un(wire.coulomb_un).to_bits(),
            inv_in_q24: inverse(gain - c1),
            inv_out_q24: inverse(gain + c1),
            per_nm_q8: crate::config::rounded(per_nm * 256.0),
            play_nm: wire.travel_nm_per_count.saturating_abs(),
        }
    }

    /// The command that makes `tension` while the reel goes in `direction`. With the compensation switched
    /// off it is the tension itself.
    #[must_use]
    pub fn command(&self, tension: Newton, direction: Direction) -> Newton {
        if !self.enabled {
            return tension;
        }
        let base = i64::from(tension.to_bits()) - i64::from(self.offset);
        let coulomb = i64::from(self.coulomb);
        let winding_in = ((base + coulomb) * i64::from(self.inv_in_q24)) >> 24;
        let paying_out = ((base - coulomb) * i64::from(self.inv_out_q24)) >> 24;
        let middle = (winding_in + paying_out) >> 1;
        let half = (winding_in - paying_out) >> 1;
        Newton::from_wide(middle + ((half * i64::from(direction.q30())) >> 30))
    }
}

/// Follows the direction from travel alone, as presliding does: it changes in proportion to the travel and
/// is full after the reversal travel. No speed enters, so there is no zero speed to chatter around; at rest
/// the direction stays. One count of play keeps an encoder that jitters on an edge from moving anything.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tracker {
    direction: Direction,
    /// Travel that has not used up the play, -play to +play, in nanometres.
    slack_nm: i32,
}

impl Tracker {
    /// Most that the direction changes in one sample: half of a whole reversal. Whatever the reel does, the
    /// feedforward takes two samples at least from one side to the other.
    pub const LARGEST_STEP: i64 = Direction::ONE as i64;

    /// Takes a sample's travel in nanometres (positive: winding in).
    pub fn step(&mut self, model: &Model, travel_nm: i32) -> Direction {
        let position = self.slack_nm.saturating_add(travel_nm);
        self.slack_nm = position.clamp(-model.play_nm, model.play_nm);
        let effective = i64::from(position) - i64::from(self.slack_nm);
        let change = ((effective * i64::from(model.per_nm_q8)) >> 8)
            .clamp(-Self::LARGEST_STEP, Self::LARGEST_STEP);
        self.direction = Direction::from_q30(i64::from(self.direction.0) + change);
        self.direction
    }

    /// The direction now.
    #[must_use]
    pub const fn direction(&self) -> Direction {
        self.direction
    }
}

/// Largest travel of a sample that is believed, in nanometres: 4.2 mm in 3.1 ms is 1.3 m/s, twice what the
/// motor reaches at the amplifier's voltage. Longer ones are cut.
pub const LARGEST_TRAVEL_NM: i32 = 1 << 22;

/// Travel between two encoder positions in nanometres, positive winding in.
#[must_use]
pub fn travel(from: Counts, to: Counts, nm_per_count: i32) -> i32 {
    let counts = to.0.wrapping_sub(from.0).clamp(-(1 << 22), 1 << 22);
    let nm = counts * i64::from(nm_per_count);
    nm.clamp(-i64::from(LARGEST_TRAVEL_NM), i64::from(LARGEST_TRAVEL_NM)) as i32
}
