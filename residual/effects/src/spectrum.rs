//! Where to look for ripples: peaks of the residual's spectrum over time or angle.

use super::Context;
use rayon::prelude::*;
use residual_columns::fourier::{Complex, Fft, Planner};
use residual_fit::problem::Problem;
use std::ops::Range;
use std::sync::Arc;

/// Highest frequency (cycles per unit of `u`) that rows this far apart can carry: half the inverse
/// of the step that `share` of the steps are below. 0.5 is right for steps that are all alike.
/// Where the steps differ, as those of an angle that turns at changing speed, the small ones carry
/// what is too fast for the median, and no alias fits them.
pub fn highest_frequency(p: &Problem, u: &[f64], share: f64) -> f64 {
    let mut steps: Vec<f64> = p
        .blocks
        .iter()
        .flat_map(|b| u[b.range.clone()].windows(2).map(|w| (w[1] - w[0]).abs()))
        .filter(|d| *d > 0.0)
        .collect();
    if steps.is_empty() {
        return 0.0;
    }
    0.5 / residual_columns::stats::quantile(&mut steps, share)
}

/// How often the power of a line exceeds the median around it. The highest of a few hundred random
/// peaks of a smooth spectrum stands nine times above (its logarithm over that of 2), less with
/// powers added.
const LINE: f64 = 15.0;

/// Which peaks of a spectrum to look for.
pub struct Look {
    /// Lowest and highest frequency.
    pub lowest: f64,
    /// See `lowest`.
    pub highest: f64,
    /// Whether the runs are added with their phases; else their powers are added.
    pub coherent: bool,
    /// Whether to leave out peaks that don't stand alone: a hump of the spectrum is no tone.
    pub lines: bool,
}

/// Decoys whose peaks are tried as well.
const DECOYS: usize = 6;

/// Frequencies worth trying: the largest peaks of the residual's spectrum over `u`, and those of a
/// few decoys, so that decoys may search as the real residual does. `weight` (empty: 1) multiplies
/// the residual.
pub fn proposals(ctx: &Context, u: &[f64], weight: &[f64], look: &Look) -> Vec<f64> {
    let p = ctx.problem;
    let mut out = Vec::new();
    if u.len() != ctx.residual.len()
        || (look.highest - look.lowest).is_nan()
        || look.highest <= look.lowest
    {
        return out;
    }
    let Some(cells) = Cells::new(p, u, look.highest, look.coherent) else {
        return out;
    };
    let decoys: Vec<Option<&Vec<f64>>> = std::iter::once(None)
        .chain(p.flips.iter().take(DECOYS).map(Some))
        .collect();
    // An effect with a spectrum takes longest to say what it offers: other threads would wait.
    out.par_extend(decoys.par_iter().flat_map_iter(|signs| {
        let mut r: Vec<f64> = ctx.residual.to_vec();
        if !weight.is_empty() {
            r.iter_mut().zip(weight).for_each(|(r, w)| *r *= w);
        }
        if let Some(signs) = signs {
            for (b, s) in p.blocks.iter().zip(*signs) {
                r[b.range.clone()].iter_mut().for_each(|x| *x *= s);
            }
        }
        peaks_of(
            &cells.spectrum(&r),
            look,
            if signs.is_none() { 5 } else { 2 },
        )
    }));
    out.sort_by(f64::total_cmp);
    out.dedup();
    out
}

/// Largest share of the variance of one of `xs` within its runs that a sine of frequency `f` over
/// `u` explains, runs weighted by their variance.
pub fn share(p: &Problem, u: &[f64], xs: &[Vec<f64>], f: f64) -> f64 {
    let w = f * std::f64::consts::TAU;
    let mut lines = vec![(0.0, 0.0); xs.len()];
    for run in p.rows_of_runs() {
        let wave: Vec<(f64, f64)> = u[run.clone()].iter().map(|u| (w * u).sin_cos()).collect();
        for (x, (line, total)) in xs.iter().zip(&mut lines) {
            let x = &x[run.clone()];
            let mean = residual_columns::stats::mean(x);
            let (mut c, mut s, mut v) = (0.0, 0.0, 0.0);
            for (x, (sin, cos)) in x.iter().zip(&wave) {
                let d = x - mean;
                c += d * cos;
                s += d * sin;
                v += d * d;
            }
            *line += 2.0 * (c * c + s * s) / run.len() as f64;
            *total += v;
        }
    }
    lines
        .iter()
        .map(|(line, total)| if *total > 0.0 { line / total } else { 0.0 })
        .fold(0.0, f64::max)
}

/// Power over frequency of values over `u`, the powers or the values of the runs added.
pub struct Spectrum {
    power: Vec<f64>,
    /// Frequency from one value to the next.
    bin: f64,
    /// Longest run.
    span: f64,
    /// Runs whose powers were added.
    runs: usize,
}

/// Where values over `u` go before they are transformed, and how: the same for all values on the
/// same rows.
pub struct Cells<'a> {
    u: &'a [f64],
    /// Runs and the lowest `u` of each.
    runs: Vec<(Range<usize>, f64)>,
    /// Longest run.
    span: f64,
    /// Width of a cell.
    width: f64,
    fft: Arc<dyn Fft<f64>>,
}

impl<'a> Cells<'a> {
    /// Cells for spectra up to `highest`; `None` if `u` does not move.
    pub fn new(p: &Problem, u: &'a [f64], highest: f64, coherent: bool) -> Option<Cells<'a>> {
        // Runs of rows: whole sequences for powers, everything at once when phases count.
        let mut runs = p.rows_of_runs();
        if coherent {
            let (start, end) = (runs.first()?.start, runs.last()?.end);
            runs.truncate(1);
            runs[0] = start..end;
        }
        let mut span = 0.0f64;
        let runs = runs.into_iter().map(|run| {
            let s = &u[run.clone()];
            let lo = s.iter().copied().fold(f64::MAX, f64::min);
            let hi = s.iter().copied().fold(f64::MIN, f64::max);
            span = span.max(hi - lo);
            (run, lo)
        });
        let runs = runs.collect();
        if span <= 0.0 {
            return None;
        }
        // Nearest-cell gridding, four cells per shortest period, doubled length for finer bins.
        let cells = ((4.0 * highest * span).ceil() as usize)
            .clamp(64, 1 << 21)
            .next_power_of_two();
        Some(Cells {
            u,
            runs,
            span,
            width: (1.0 / (4.0 * highest)).max(span / cells as f64),
            fft: Planner::default().forward(cells * 2),
        })
    }

    /// The spectrum of values.
    pub fn spectrum(&self, r: &[f64]) -> Spectrum {
        let n = self.fft.len();
        let mut power = vec![0.0; n / 2];
        let mut buf = vec![Complex::new(0.0, 0.0); n];
        let mut scratch = vec![Complex::new(0.0, 0.0); self.fft.get_inplace_scratch_len()];
        for (run, lo) in &self.runs {
            let mean = residual_columns::stats::mean(&r[run.clone()]);
            buf.fill(Complex::new(0.0, 0.0));
            for i in run.clone() {
                let k = (((self.u[i] - lo) / self.width) as usize).min(n - 1);
                buf[k].re += r[i] - mean;
            }
            self.fft.process_with_scratch(&mut buf, &mut scratch);
            power
                .iter_mut()
                .zip(&buf)
                .for_each(|(p, z)| *p += z.norm_sqr());
        }
        Spectrum {
            power,
            bin: 1.0 / (n as f64 * self.width),
            span: self.span,
            runs: self.runs.len(),
        }
    }
}

impl Spectrum {
    /// Whether the power in bin `k` stands alone: so many times above the median around it.
    fn stands_alone(&self, k: usize, coherent: bool) -> bool {
        // Resolution in bins; neighbours are two to twelve of them away on either side.
        let one = (1.0 / (self.span * self.bin)).ceil() as usize;
        let runs = if coherent { 1.0 } else { self.runs as f64 };
        let mut near: Vec<f64> = (2 * one..=12 * one)
            .flat_map(|d| [k.checked_sub(d), k.checked_add(d)])
            .flatten()
            .filter_map(|i| self.power.get(i).copied())
            .collect();
        residual_columns::stats::median(&mut near)
            .is_some_and(|m| self.power[k] > LINE / runs.sqrt() * m)
    }

    /// Whether a frequency is a multiple of that of the strongest line, which stands alone.
    pub fn is_harmonic(&self, frequency: f64) -> bool {
        let one = (1.0 / (self.span * self.bin)).ceil() as usize;
        let Some(top) =
            (one..self.power.len()).max_by(|a, b| self.power[*a].total_cmp(&self.power[*b]))
        else {
            return false;
        };
        let first = top as f64 * self.bin;
        let order = (frequency / first).round();
        order >= 2.0
            && (frequency - order * first).abs() <= 1.0 / self.span
            && self.stands_alone(top, false)
    }

    /// Whether there is a line within the resolution of a frequency.
    pub fn line_at(&self, frequency: f64) -> bool {
        let one = (1.0 / (self.span * self.bin)).ceil() as usize;
        let k = (frequency / self.bin).round() as usize;
        let near = k.saturating_sub(one)..(k + one + 1).min(self.power.len());
        near.max_by(|a, b| self.power[*a].total_cmp(&self.power[*b]))
            .is_some_and(|top| self.stands_alone(top, false))
    }
}

/// The `count` largest peaks of values between `lowest` and `highest`.
pub fn peaks(p: &Problem, u: &[f64], r: &[f64], look: &Look, count: usize) -> Vec<f64> {
    Cells::new(p, u, look.highest, look.coherent)
        .map_or(vec![], |cells| peaks_of(&cells.spectrum(r), look, count))
}

fn peaks_of(spectrum: &Spectrum, look: &Look, count: usize) -> Vec<f64> {
    let (power, bin) = (&spectrum.power, spectrum.bin);
    let lo = ((look.lowest / bin) as usize).max(1);
    let hi = ((look.highest / bin) as usize).min(power.len().saturating_sub(2));
    let mut tops: Vec<usize> = (lo..hi)
        .filter(|&k| power[k] >= power[k - 1] && power[k] > power[k + 1])
        .collect();
    let larger = |a: &usize, b: &usize| power[*b].total_cmp(&power[*a]).then(a.cmp(b));
    if tops.len() > count {
        tops.select_nth_unstable_by(count, larger);
        tops.truncate(count);
    }
    tops.sort_unstable_by(larger);
    if look.lines {
        tops.retain(|&k| spectrum.stands_alone(k, look.coherent));
    }
    // Parabola through three bins for the top.
    tops.into_iter()
        .map(|k| {
            let (a, b, c) = (power[k - 1], power[k], power[k + 1]);
            let d = a - 2.0 * b + c;
            let shift = if d < 0.0 { 0.5 * (a - c) / d } else { 0.0 };
            (k as f64 + shift.clamp(-0.5, 0.5)) * bin
        })
        .collect()
}
