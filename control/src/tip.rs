//! The force at the tip as the board knows it: its own six tensions times the cable directions that
//! came with the setpoints. The board compares it with a limit of its own, whatever the host
//! believes.
//!
//! In `f32`, which the core computes in hardware: directions are exact to 6e-5, tensions to 1e-6 N.

use crate::units::Newton;
use nalgebra::{Matrix3x6, Vector3, Vector6};
use wire::message::DIRECTION_ONE;
use wire::{UnitIndex, UNITS};

/// Samples in a row above the limit that make a fault: 10 ms at six units, longer than the spike
/// gate holds.
pub const TRIP_SAMPLES: u8 = 20;

/// Largest difference between the square of a direction's length and 1, in 1/64: 1.6 %.
const LENGTH_SHIFT: u32 = 6;

/// Whether this is a unit vector, or zero for a direction that is not known.
#[must_use]
pub fn is_direction(q14: [i16; 3]) -> bool {
    let one = i64::from(DIRECTION_ONE) * i64::from(DIRECTION_ONE);
    let square: i64 = q14.iter().map(|&v| i64::from(v) * i64::from(v)).sum();
    square == 0 || (square - one).abs() <= one >> LENGTH_SHIFT
}

/// Sum of the cables' forces, and the watch on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TipGuard {
    directions: Matrix3x6<f32>,
    tensions: Vector6<f32>,
    /// 1 for a cable whose direction is not known.
    unknown: Vector6<f32>,
    limit_n: f32,
    force: Vector3<f32>,
    /// Sum of the tensions without a direction.
    unknown_n: f32,
    over: u8,
}

impl TipGuard {
    /// Without directions: every tension counts in full.
    #[must_use]
    pub fn new(limit_un: i32) -> Self {
        Self {
            directions: Matrix3x6::zeros(),
            tensions: Vector6::zeros(),
            unknown: Vector6::repeat(1.0),
            limit_n: limit_un as f32 * 1e-6,
            force: Vector3::zeros(),
            unknown_n: 0.0,
            over: 0,
        }
    }

    /// Another limit is in force.
    pub fn set_limit(&mut self, limit_un: i32) {
        self.limit_n = limit_un as f32 * 1e-6;
    }

    /// The cables' directions of new setpoints.
    pub fn set_directions(&mut self, q14: &[[i16; 3]; UNITS]) {
        let scale = 1.0 / f32::from(DIRECTION_ONE);
        for (n, (direction, unknown)) in q14.iter().zip(&mut self.unknown).enumerate() {
            let [x, y, z] = direction.map(|v| f32::from(v) * scale);
            self.directions.set_column(n, &Vector3::new(x, y, z));
            *unknown = if *direction == [0; 3] { 1.0 } else { 0.0 };
        }
        self.force = self.directions * self.tensions;
        self.unknown_n = self.unknown.dot(&self.tensions);
    }

    /// One sample: this unit's cable has this tension now. Returns the force in millinewton, at
    /// most 65,535.
    pub fn sample(&mut self, unit: UnitIndex, tension: Newton) -> u16 {
        const PER_BIT: f32 = 1.0 / (1u32 << Newton::FRAC_BITS) as f32;
        self.set(unit, tension.to_bits() as f32 * PER_BIT);
        let size = self.size_n();
        self.over = if size > self.limit_n {
            self.over.saturating_add(1)
        } else {
            0
        };
        // A cast of f32 to an integer ends at the integer's ends.
        (size * 1_000.0) as u16
    }

    /// Forgets the tension of a unit whose load cell does not measure.
    pub fn forget(&mut self, unit: UnitIndex) {
        self.set(unit, 0.0);
    }

    /// A cable's tension changes: the sums change by its part. Rounding errors end with the next
    /// directions.
    fn set(&mut self, unit: UnitIndex, tension_n: f32) {
        let unit = unit as usize;
        if let Some(slot) = self.tensions.get_mut(unit) {
            let change = tension_n - core::mem::replace(slot, tension_n);
            // By element: a column as a matrix of its own is a copy whose size nalgebra checks with
            // a panic.
            for (sum, direction) in (self.force.iter_mut()).zip(&self.directions.column(unit)) {
                *sum += direction * change;
            }
            self.unknown_n += self.unknown.get(unit).map_or(0.0, |one| one * change);
        }
    }

    /// The force in millinewton once it has been above the limit for [`TRIP_SAMPLES`] samples.
    #[must_use]
    pub fn exceeded(&self) -> Option<u32> {
        (self.over >= TRIP_SAMPLES).then_some((self.size_n() * 1_000.0) as u32)
    }

    /// The force in micronewton, robot base frame.
    #[must_use]
    pub fn force_un(&self) -> [i32; 3] {
        self.force.map(|n| (n * 1e6) as i32).into()
    }

    /// Size of the force in newton, with what has no known direction added to it.
    fn size_n(&self) -> f32 {
        let square = self.force.dot(&self.force);
        // micromath's root is right to 6 %; a step of Heron's method makes that 0.2 %.
        let root = micromath::F32Ext::sqrt(square);
        0.5 * (root + square / root) + self.unknown_n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const X: [i16; 3] = [DIRECTION_ONE, 0, 0];
    const MINUS_X: [i16; 3] = [-DIRECTION_ONE, 0, 0];

    fn newton(n: i32) -> Newton {
        Newton::from_un(n * 1_000_000)
    }

    #[test]
    fn opposite_cables_cancel_and_one_alone_trips() {
        let mut guard = TipGuard::new(10_000_000);
        guard.set_directions(&[X, MINUS_X, X, MINUS_X, X, MINUS_X]);
        for unit in UnitIndex::ALL {
            guard.sample(unit, newton(12));
        }
        let [x, ..] = guard.force_un();
        assert!(x.abs() < 10, "{x} uN");
        for _ in 0..TRIP_SAMPLES - 1 {
            let mn = guard.sample(UnitIndex::Unit2, newton(0));
            assert!((11_976..12_024).contains(&mn), "{mn} mN");
            assert_eq!(guard.exceeded(), None);
        }
        guard.sample(UnitIndex::Unit2, newton(0));
        assert!(guard.exceeded().is_some());
        guard.sample(UnitIndex::Unit2, newton(12));
        assert_eq!(guard.exceeded(), None);
    }

    #[test]
    fn a_cable_without_a_direction_counts_in_full() {
        let mut guard = TipGuard::new(10_000_000);
        guard.set_directions(&[X, MINUS_X, [0; 3], X, MINUS_X, X]);
        assert_eq!(guard.sample(UnitIndex::Unit3, newton(7)), 7_000);
        guard.sample(UnitIndex::Unit3, newton(-7));
        guard.forget(UnitIndex::Unit3);
        assert_eq!(guard.sample(UnitIndex::Unit1, newton(0)), 0);
    }

    #[test]
    fn directions_are_unit_vectors_or_zero() {
        assert!(is_direction(X) && is_direction([0; 3]));
        assert!(is_direction([9_459, 9_459, -9_459]));
        assert!(!is_direction([i16::MIN; 3]) && !is_direction([8_192, 0, 0]));
        assert!(!is_direction([1, 0, 0]));
    }
}
