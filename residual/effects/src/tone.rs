//! A sine of constant frequency: mains, a fan, an alias of something faster.

use super::{
    spectrum, with_amplitude_phase, Build, Context, Effect, EffectKind, Estimate, Piece, Psi,
    Variant,
};
use residual_columns::format::num;
use residual_columns::stats;
use residual_columns::units::radians;

pub struct Tone;

impl Effect for Tone {
    fn kind(&self) -> EffectKind {
        EffectKind::Tone
    }
    fn against(&self, _: &Context) -> String {
        "elapsed".into()
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let ripple = || {
            let frequency = e.get("frequency")?;
            let turn = SteadyTurn::new(ctx, &ctx.values("time"))?;
            turn.has(frequency).then(|| {
                format!(
                    "at {} turns per second it is a ripple of order {}; record at another speed to tell",
                    num(turn.speed),
                    num((frequency / turn.speed).round())
                )
            })
        };
        e.vague("frequency").or_else(ripple)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let time = ctx.values("time");
        let highest = highest(ctx, &time);
        let mut others = Others::new(ctx, &time, highest);
        let mut out = Vec::new();
        for (label, local) in [("one phase for all", false), ("a phase for each run", true)] {
            let mut grid = spectrum::proposals(
                ctx,
                &time,
                &[],
                &spectrum::Look {
                    lowest: lowest(ctx, highest),
                    highest,
                    coherent: !local,
                    lines: true,
                },
            );
            grid.retain(|f| !others.has(*f));
            if grid.is_empty() {
                continue;
            }
            let unit = ctx.unit().to_string();
            out.push(
                Variant::profiled(
                    label,
                    Psi::new("frequency", "Hz", grid).within(0.6 / ctx.span),
                    move |f| {
                        let w = f * std::f64::consts::TAU;
                        let pieces = vec![
                            Piece::new("sine", unit.clone(), format!("sin({w} * time)")),
                            Piece::new("cosine", unit.clone(), format!("cos({w} * time)")),
                        ];
                        if local {
                            Build::Local(pieces)
                        } else {
                            Build::Add(pieces)
                        }
                    },
                )
                .with(with_amplitude_phase),
            );
        }
        out
    }
}

/// What else a sine of a frequency can be.
struct Others<'a> {
    ctx: &'a Context<'a>,
    time: &'a [f64],
    highest: f64,
    steady: Option<SteadyTurn>,
    inputs: Vec<Vec<f64>>,
    /// Made where a line needs them.
    driven: Option<Vec<Driven>>,
}

impl<'a> Others<'a> {
    fn new(ctx: &'a Context<'a>, time: &'a [f64], highest: f64) -> Others<'a> {
        let names = ctx.velocity.iter().cloned();
        Others {
            inputs: names
                .chain(ctx.has_command().then(|| "command".to_string()))
                .chain(ctx.spec.roles.pose.keys().cloned())
                .map(|e| ctx.values(&e))
                .filter(|v| !v.is_empty())
                .collect(),
            steady: SteadyTurn::new(ctx, time),
            ctx,
            time,
            highest,
            driven: None,
        }
    }

    /// Whether a sine of this frequency may be something else than a tone.
    fn has(&mut self, f: f64) -> bool {
        // At constant speed a ripple is a sine in time. Of a whole order it is the likelier cause.
        self.steady.as_ref().is_some_and(|turn| turn.has(f))
            // At a frequency at which the rig itself is driven, a tone cannot be told from an
            // answer.
            || spectrum::share(self.ctx.problem, self.time, &self.inputs, f) >= 0.1
            // Neither at a harmonic of a motion that repeats, however small it is there.
            || {
                let (ctx, time, highest) = (self.ctx, self.time, self.highest);
                let driven = self
                    .driven
                    .get_or_insert_with(|| driven_lines(ctx, time, highest));
                driven.iter().any(|d| d.has(f))
            }
    }
}

/// Lines of the residual that are not looked for as tones, as an input has them too: frequency in
/// Hz and share of the squared residual within the runs, the largest first. Those with a share of
/// `least` or more.
pub fn lines_of_inputs(ctx: &Context, least: f64) -> Vec<(f64, f64)> {
    let time = ctx.values("time");
    let highest = highest(ctx, &time);
    let lowest = lowest(ctx, highest);
    if time.len() != ctx.residual.len() || highest <= lowest || highest.is_nan() {
        return vec![];
    }
    let look = spectrum::Look {
        lowest,
        highest,
        coherent: false,
        lines: true,
    };
    let residual = [ctx.residual.to_vec()];
    let mut lines: Vec<(f64, f64)> =
        spectrum::peaks(ctx.problem, &time, ctx.residual, &look, LINES)
            .into_iter()
            .map(|f| (f, spectrum::share(ctx.problem, &time, &residual, f)))
            .filter(|(_, share)| *share >= least)
            .collect();
    if !lines.is_empty() {
        let mut others = Others::new(ctx, &time, highest);
        lines.retain(|(f, _)| others.has(*f));
    }
    lines.sort_by(|a, b| b.1.total_cmp(&a.1));
    lines
}

/// Lines of the residual that are looked at.
const LINES: usize = 5;

/// The lowest frequency of a tone: five periods in the longest run.
fn lowest(ctx: &Context, highest: f64) -> f64 {
    (5.0 / ctx.span).min(0.2 * highest)
}

/// The highest frequency that the rows can carry. That of the values where rows repeat them: above
/// half of their rate a held tone has images, which are none.
fn highest(ctx: &Context, time: &[f64]) -> f64 {
    let of_values = ctx.problem.values_per_s.map_or(f64::INFINITY, |r| 0.5 * r);
    spectrum::highest_frequency(ctx.problem, time, 0.5).min(of_values)
}

/// Pieces of each sequence whose speeds are compared: a ripple changes the speed within a turn.
const PIECES: usize = 5;

/// An angle that turns at one speed most of the time.
struct SteadyTurn {
    /// Turns per second.
    speed: f64,
    /// RMS of the angle about its line in a piece of a sequence, in turns.
    uneven: f64,
    /// Turns of the longest sequence.
    turns: f64,
}

impl SteadyTurn {
    /// Relative distance from the usual speed up to which a piece of a sequence has it.
    const ONE_SPEED: f64 = 0.05;

    /// Share of the pieces that must have it.
    const MOST: f64 = 0.8;

    /// Phase error, in turns of the ripple, up to which a ripple looks like a sine in time.
    const PHASE: f64 = 0.1;

    /// Largest distance of an order from a whole number.
    const WHOLE: f64 = 0.15;

    /// `None` without an angle, or where its speed is not one.
    fn new(ctx: &Context, time: &[f64]) -> Option<SteadyTurn> {
        let scale = radians(&ctx.position_unit())? / std::f64::consts::TAU;
        let angle = ctx.values(ctx.position.as_ref()?);
        if angle.len() != time.len() {
            return None;
        }
        let of = |rows: std::ops::Range<usize>| {
            let (slope, rest) = stats::line(&time[rows.clone()], &angle[rows.clone()])?;
            let uneven = (rest / rows.len() as f64).sqrt();
            Some(((slope * scale).abs(), uneven * scale))
        };
        let runs = ctx.problem.rows_of_runs().into_iter();
        let at = |rows: &std::ops::Range<usize>, k: usize| rows.start + rows.len() * k / PIECES;
        let pieces = runs.flat_map(|rows| (0..PIECES).map(move |k| at(&rows, k)..at(&rows, k + 1)));
        let (speeds, mut uneven): (Vec<f64>, Vec<f64>) = pieces.filter_map(of).unzip();
        let speed = stats::median(&mut speeds.clone())?;
        let usual = |s: &&f64| (*s - speed).abs() <= SteadyTurn::ONE_SPEED * speed;
        let share = speeds.iter().filter(usual).count() as f64 / speeds.len() as f64;
        (speed > 0.0 && share >= SteadyTurn::MOST).then(|| SteadyTurn {
            speed,
            uneven: stats::median(&mut uneven).unwrap_or(0.0),
            turns: speed * ctx.span,
        })
    }

    /// Whether a sine of this frequency may be a ripple of a whole order.
    fn has(&self, frequency: f64) -> bool {
        let order = frequency / self.speed;
        let tolerance = (0.5 / self.turns).min(SteadyTurn::WHOLE);
        let whole = order.round();
        whole >= 1.0
            && (order - whole).abs() <= tolerance
            && order * self.uneven < SteadyTurn::PHASE
    }
}

/// The spectrum of an input.
struct Driven {
    spectrum: spectrum::Spectrum,
    /// Whether a closed loop can have put the line there: only a harmonic of the input's own
    /// repetition counts then.
    answers: bool,
}

impl Driven {
    /// Whether the rig is driven at a frequency.
    fn has(&self, frequency: f64) -> bool {
        self.spectrum.line_at(frequency) && (!self.answers || self.spectrum.is_harmonic(frequency))
    }
}

/// Spectra of the inputs that say when the rig is driven: command, load, velocity, poses, their
/// slopes, and the sign of the velocity. A tone of the mains that a channel picks up as well is no
/// drive, so channels are not among them.
fn driven_lines(ctx: &Context, time: &[f64], highest: f64) -> Vec<Driven> {
    // In a closed loop the command answers to the tone; the setpoint, where it is logged, says what
    // drives the rig.
    let mut texts: Vec<(String, bool)> = if ctx.spec.roles.setpoint.is_some() {
        vec![("setpoint".into(), false)]
    } else if ctx.has_command() {
        vec![(ctx.load.clone(), true), ("command".into(), true)]
    } else {
        vec![(ctx.load.clone(), false)]
    };
    texts.extend(ctx.velocity.iter().cloned().map(|v| (v, false)));
    texts.extend(ctx.spec.roles.pose.keys().cloned().map(|q| (q, false)));
    let slopes: Vec<(String, bool)> = texts
        .iter()
        .map(|(t, answers)| (format!("deriv({t}, 1)"), *answers))
        .collect();
    texts.extend(slopes);
    texts.extend(
        ctx.velocity
            .iter()
            .map(|v| (format!("sgn({v}, {})", ctx.deadband), false)),
    );
    let Some(cells) = spectrum::Cells::new(ctx.problem, time, highest, false) else {
        return vec![];
    };
    texts
        .iter()
        .map(|(t, answers)| (ctx.values(t), *answers))
        .filter(|(v, _)| v.len() == time.len())
        .map(|(v, answers)| Driven {
            spectrum: cells.spectrum(&v),
            answers,
        })
        .collect()
}
