//! A narrow band in a residual whose frequency need not stay: peaks of the spectra of short
//! stretches.

use super::colour::Colour;
use super::imitations::Imitations;
use residual_columns::fourier::{Complex, Planner};
use residual_columns::frame::Frame;
use residual_columns::stats::{self, Rng};

/// Rows of the stretches.
const WIDTHS: [usize; 3] = [64, 128, 256];

/// Lines of a stretch below which the motion and slow drifts are.
const SLOW: usize = 4;

/// Least number of stretches.
const LEAST: usize = 12;

/// A narrow band.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Narrow {
    /// Share of the power of the whitened residual that is in it, above what noise of that colour
    /// shows.
    pub share: f64,
    /// The share in standard deviations of that of noise.
    pub z: f64,
    /// Where it is in most stretches, in cycles per row.
    pub between: (f64, f64),
}

/// Looks for a narrow band in the innovations of a residual against the same in other orders.
pub(super) fn narrow(
    colour: &mut Colour,
    frame: &Frame,
    rng: &mut Rng,
    imitations: &Imitations,
) -> Narrow {
    let mut best = Narrow {
        share: 0.0,
        z: 0.0,
        between: (0.0, 0.0),
    };
    let mut noises = [const { Vec::new() }; WIDTHS.len()];
    for _ in 0..imitations.count {
        let other = colour.shuffled(rng, &imitations.frame);
        for (noise, width) in noises.iter_mut().zip(WIDTHS) {
            noise.extend(peaks(&other, &imitations.frame, width).map(|p| p.0));
        }
    }
    for (noise, width) in noises.iter().zip(WIDTHS) {
        let Some((found, mut at)) = peaks(&colour.innovations, frame, width) else {
            break;
        };
        // Few sequences may be long enough for such stretches.
        if noise.len() < imitations.count {
            continue;
        }
        let (m, error) = (stats::mean(noise), imitations.error(noise));
        let z = (found - m) / error.max(1e-6);
        // As a share: noise alone has the share m, a pure line all.
        let share = (found - m) / (1.0 - m);
        if z > best.z {
            at.sort_by(f64::total_cmp);
            let q = |q| stats::quantile_sorted(&at, q);
            best = Narrow {
                share,
                z,
                between: (q(0.2), q(0.8)),
            };
        }
    }
    best
}

/// Mean share of the largest peak in the power of a stretch, and where the peaks are in cycles per
/// row.
fn peaks(e: &[f64], frame: &Frame, width: usize) -> Option<(f64, Vec<f64>)> {
    let mut planner = Planner::default();
    let fft = planner.forward(width);
    let window: Vec<f64> = (0..width)
        .map(|i| {
            let x = std::f64::consts::PI * (i as f64 + 0.5) / width as f64;
            x.sin().powi(2)
        })
        .collect();
    let lines = width / 2;
    let mut spectra: Vec<Vec<f64>> = Vec::new();
    for range in frame.sequences() {
        for s in e[range.clone()].chunks_exact(width) {
            let mut z: Vec<Complex<f64>> = s
                .iter()
                .zip(&window)
                .map(|(x, w)| Complex::new(x * w, 0.0))
                .collect();
            fft.process(&mut z);
            spectra.push(z[SLOW..lines].iter().map(Complex::norm_sqr).collect());
        }
    }
    if spectra.len() < LEAST {
        return None;
    }
    // What the autoregression leaves is not quite white: the smooth spectrum of all stretches is
    // taken out.
    let count = lines - SLOW;
    let mean: Vec<f64> = (0..count)
        .map(|k| spectra.iter().map(|s| s[k]).sum::<f64>() / spectra.len() as f64)
        .collect();
    let reach = width / 16;
    let level: Vec<f64> = (0..count)
        .map(|k| {
            let part = &mean[k.saturating_sub(reach)..(k + reach + 1).min(count)];
            stats::mean(part)
        })
        .collect();
    let (mut share, mut at) = (0.0, Vec::new());
    for s in &spectra {
        let flat: Vec<f64> = s
            .iter()
            .zip(&level)
            .map(|(p, l)| if *l > 0.0 { p / l } else { 0.0 })
            .collect();
        let all: f64 = flat.iter().sum();
        let peak = |k: usize| {
            flat[k.saturating_sub(1)..(k + 2).min(count)]
                .iter()
                .sum::<f64>()
        };
        let best = (0..count).max_by(|a, b| peak(*a).total_cmp(&peak(*b)));
        if let (Some(k), true) = (best, all > 0.0) {
            share += peak(k) / all;
            at.push((k + SLOW) as f64 / width as f64);
        }
    }
    Some((share / spectra.len() as f64, at))
}
