//! The converters' decimation filter: a sinc4, whose impulse response at a fine grid is the cubic
//! B-spline.
//!
//! A sinc4 decimator is four boxcars, each one conversion period T long. Convolved they are the
//! cubic B-spline with support 4 T (de Boor's recursion), symmetric about 2 T: the group delay is
//! exactly two conversion periods, 6.25 ms at 320 SPS, and -3 dB falls at 0.227 / T, the figure in
//! the NAU7802's datasheet. All six converters take their weights from one history of the bridges,
//! so that the plant is stepped on one grid whatever the converters' clocks do.

/// Spacing of the history's grid in nanoseconds. Below a fifteenth of the shortest conversion
/// period, so that the sum below is the integral to better than 1e-3 of full scale for anything a
/// cable can do.
pub const GRID_NS: u64 = 200_000;

/// Cubic B-spline with support [0, 4] and unit area.
#[must_use]
pub fn bspline(x: f64) -> f64 {
    let x = (x - 2.0).abs();
    if x < 1.0 {
        2.0 / 3.0 - x * x + x * x * x / 2.0
    } else if x < 2.0 {
        let y = 2.0 - x;
        y * y * y / 6.0
    } else {
        0.0
    }
}

/// What the six bridges did, sampled every [`GRID_NS`], for as long as the slowest filter reaches
/// back.
#[derive(Debug, Clone)]
pub struct History<const N: usize> {
    rows: Vec<[f64; N]>,
    /// Grid points pushed so far; row k of the run sits at index k modulo the capacity.
    pushed: u64,
}

impl<const N: usize> History<N> {
    /// A history that reaches `reach_ns` back.
    #[must_use]
    pub fn new(reach_ns: u64) -> Self {
        let capacity = reach_ns / GRID_NS + 2;
        Self {
            rows: vec![[0.0; N]; usize::try_from(capacity).expect("fits")],
            pushed: 0,
        }
    }

    /// The instant of the next row.
    #[must_use]
    pub fn next_ns(&self) -> u64 {
        self.pushed * GRID_NS
    }

    /// Appends the row of the instant [`History::next_ns`].
    pub fn push(&mut self, row: [f64; N]) {
        let at = (self.pushed % self.rows.len() as u64) as usize;
        self.rows[at] = row;
        self.pushed += 1;
    }

    /// Output of the sinc4 of channel `column` with period `period_ns` for a conversion that ends
    /// at `end_ns`. Before the first row the input counts as the first row.
    #[must_use]
    pub fn sinc4(&self, column: usize, end_ns: u64, period_ns: f64) -> f64 {
        if self.pushed == 0 {
            return 0.0;
        }
        let newest = (end_ns / GRID_NS).min(self.pushed - 1);
        let span = (4.0 * period_ns / GRID_NS as f64) as u64 + 1;
        let oldest_kept = self.pushed.saturating_sub(self.rows.len() as u64);
        let (mut sum, mut weight) = (0.0, 0.0);
        let mut back = 0;
        while back <= span {
            let k = newest.saturating_sub(back).max(oldest_kept);
            let age = end_ns as f64 - (newest as f64 - back as f64) * GRID_NS as f64;
            let w = bspline(age / period_ns);
            sum += w * self.rows[(k % self.rows.len() as u64) as usize][column];
            weight += w;
            back += 1;
        }
        if weight > 0.0 {
            sum / weight
        } else {
            self.rows[(newest % self.rows.len() as u64) as usize][column]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 3_125_000.0;

    fn filtered(input: impl Fn(f64) -> f64, end_ns: u64) -> f64 {
        let mut history = History::<1>::new(20_000_000);
        while history.next_ns() <= end_ns {
            let t = history.next_ns() as f64 * 1e-9;
            history.push([input(t)]);
        }
        history.sinc4(0, end_ns, PERIOD)
    }

    #[test]
    fn a_ramp_comes_out_two_periods_late() {
        for end in [100_000_000, 100_000_001, 100_123_456, 100_199_999] {
            let delay = end as f64 * 1e-9 - filtered(|t| t, end);
            assert!((delay - 6.25e-3).abs() < 2e-6, "{delay} at {end}");
        }
    }

    #[test]
    fn minus_three_decibels_at_0_227_of_the_rate() {
        let f = 0.227 * 320.0;
        let w = 2.0 * std::f64::consts::PI * f;
        let mut peak: f64 = 0.0;
        for k in 0..200 {
            peak = peak.max(filtered(|t| (w * t).sin(), 100_000_000 + k * 137_000).abs());
        }
        let db = 20.0 * peak.log10();
        assert!((db + 3.0).abs() < 0.15, "{db} dB");
    }

    #[test]
    fn the_rate_itself_is_notched_out() {
        let w = 2.0 * std::f64::consts::PI * 320.0;
        for k in 0..20 {
            let out = filtered(|t| (w * t).sin(), 100_000_000 + k * 71_000);
            assert!(out.abs() < 1e-4, "{out}");
        }
    }

    #[test]
    fn a_step_settles_within_four_periods() {
        let step = |t: f64| if t >= 0.05 { 1.0 } else { 0.0 };
        assert_eq!(filtered(step, 50_000_000 - 1), 0.0);
        assert!(filtered(step, 56_250_000) > 0.4 && filtered(step, 56_250_000) < 0.6);
        assert!((filtered(step, 62_700_000) - 1.0).abs() < 1e-12);
    }
}
