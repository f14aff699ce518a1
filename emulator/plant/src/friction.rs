//! Dry friction with stiction and presliding: a Maxwell-slip model.
//!
//! Four spring-and-slider elements in parallel (generalised Maxwell-slip: Al-Bender, Lampaert,
//! Swevers, IEEE Trans. Automatic Control 50(11), 2005; the sliders are Jenkins elements). Each
//! element's spring takes up the motion until its share of the friction level is reached, then
//! slides. This gives
//!
//! - a band in which the reel holds any force at rest, without the slow drift of a LuGre bristle,
//! - hysteresis in presliding, with memory of the turning points,
//! - breakaway above kinetic friction, since the level falls as speed rises,
//!
//! and is numerically harmless: the slider is a clip (a return mapping), not a stiff equation.

/// Number of parallel elements.
pub const ELEMENTS: usize = 4;

/// Slip distances of the elements as fractions of the presliding distance. Equal shares of the
/// level and evenly spaced distances make the virgin curve a parabola-like rise.
const SLIP_AT: [f64; ELEMENTS] = [0.25, 0.5, 0.75, 1.0];
const SHARE: f64 = 1.0 / ELEMENTS as f64;

/// State and stiffness of one friction contact.
#[derive(Clone, Debug)]
pub struct MaxwellSlip {
    /// Spring force of each element, N.
    force_n: [f64; ELEMENTS],
    stiffness_n_per_m: [f64; ELEMENTS],
    stuck: f64,
}

impl MaxwellSlip {
    /// A relaxed contact that holds `reference_level_n` when displaced by `presliding_m` (both >
    /// 0).
    pub fn new(reference_level_n: f64, presliding_m: f64) -> Self {
        Self {
            force_n: [0.0; ELEMENTS],
            stiffness_n_per_m: SLIP_AT.map(|d| SHARE * reference_level_n / (d * presliding_m)),
            stuck: 1.0,
        }
    }

    /// Moves the contact by `displacement_m` while its friction level is `level_n` >= 0; returns
    /// the friction force in N, positive against positive motion, never above `level_n`.
    #[inline]
    pub fn slide(&mut self, displacement_m: f64, level_n: f64) -> f64 {
        let limit = SHARE * level_n;
        let mut sum = 0.0;
        let mut stuck = 0.0;
        for (force, stiffness) in self.force_n.iter_mut().zip(self.stiffness_n_per_m) {
            let trial = *force + stiffness * displacement_m;
            *force = trial.clamp(-limit, limit);
            stuck += if trial.abs() < limit { SHARE } else { 0.0 };
            sum += *force;
        }
        self.stuck = stuck;
        sum
    }

    /// Friction force now, N.
    #[inline]
    pub fn force_n(&self) -> f64 {
        self.force_n.iter().sum()
    }

    /// Share of the elements that stick: 1 at rest inside the band, 0 in gross sliding.
    #[inline]
    pub fn stuck_share(&self) -> f64 {
        self.stuck
    }

    /// Stiffness of the virgin contact, N/m.
    pub fn stiffness_n_per_m(&self) -> f64 {
        self.stiffness_n_per_m.iter().sum()
    }

    /// Energy in the springs, J.
    pub fn energy_j(&self) -> f64 {
        self.force_n
            .iter()
            .zip(self.stiffness_n_per_m)
            .map(|(f, k)| 0.5 * f * f / k)
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reaches_the_level_at_the_presliding_distance_and_not_before() {
        let mut contact = MaxwellSlip::new(2.0, 30e-6);
        let half = contact.slide(15e-6, 2.0);
        assert!(half > 1.0 && half < 2.0, "{half}");
        assert!((contact.slide(15e-6, 2.0) - 2.0).abs() < 1e-12);
        assert_eq!(contact.slide(1.0, 2.0), 2.0);
        assert_eq!(contact.stuck_share(), 0.0);
    }

    #[test]
    fn small_loops_close_and_dissipate() {
        let mut contact = MaxwellSlip::new(2.0, 30e-6);
        let loop_work = |c: &mut MaxwellSlip| {
            let mut work = 0.0;
            for step in 0..400 {
                let dx = if step < 200 { 1e-7 } else { -1e-7 };
                let before = c.force_n();
                let after = c.slide(dx, 2.0);
                work += 0.5 * (before + after) * dx;
            }
            work
        };
        loop_work(&mut contact);
        let start = contact.force_n();
        assert!(loop_work(&mut contact) > 0.0);
        assert!((contact.force_n() - start).abs() < 1e-12);
    }

    #[test]
    fn a_falling_level_lets_go() {
        let mut contact = MaxwellSlip::new(2.0, 30e-6);
        contact.slide(1.0, 2.0);
        assert!((contact.slide(0.0, 0.9) - 0.9).abs() < 1e-12);
    }
}
