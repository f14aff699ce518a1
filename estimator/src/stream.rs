//! An estimator on a stream of rows: forces, how sure they are, and whether they can be used.
//!
//! Where a stream begins, and after a gap, the state of the friction is not known. Each estimate
//! says so: its interval is wide, and it is marked invalid until the interval is no wider than
//! those of a stream without breaks.

use crate::estimator::Estimator;
use crate::interval::Live;
use crate::model::{Fit, Stepper};
use crate::motion::Motion;
use crate::sequence::Sequence;
use robot::random::Random;

/// How sure a force is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sure {
    /// Half width of the 90 % interval, N; of the length of the error vector where several
    /// components are estimated. `None`: the model has no intervals.
    pub half_n: Option<f64>,
    /// Whether the state of the friction is known. After a start or a gap it is not, until the
    /// motion has told it.
    pub valid: bool,
    /// Whether the motors' balances say that the model no longer fits this robot: see
    /// [`crate::misfit`]. Of a model with intervals and balances.
    pub misfits: bool,
}

impl Sure {
    /// Whether the estimate can be used: its state is known, and the model fits the robot.
    #[must_use]
    pub const fn usable(&self) -> bool {
        self.valid && !self.misfits
    }
}

/// Half width of the 90 % interval of a normal distribution per its standard deviation.
pub(crate) const NORMAL_90: f64 = 1.645;

/// See the module's page.
pub struct Stream<'a> {
    estimator: &'a Estimator,
    stepper: Box<dyn Stepper + 'a>,
    width: Width<'a>,
    force: Vec<f32>,
}

/// What tells how sure an estimate is.
enum Width<'a> {
    Interval(Box<Live<'a>>),
    /// The motion alone tells whether the friction's state is known.
    Motion(Box<Motion>),
}

impl<'a> Stream<'a> {
    /// A stream without a past.
    #[must_use]
    pub fn new(estimator: &'a Estimator) -> Self {
        let step_s = estimator.step_s;
        Self {
            estimator,
            stepper: estimator.model().stepper(),
            width: match estimator.interval_now() {
                Some(interval) => Width::Interval(Box::new(interval.live(step_s))),
                None => Width::Motion(Box::new(Motion::new(step_s))),
            },
            force: vec![0.0; estimator.axes.len()],
        }
    }

    /// The model.
    #[must_use]
    pub const fn estimator(&self) -> &'a Estimator {
        self.estimator
    }

    /// Force of the last row, N, a value for each component.
    #[must_use]
    pub fn force(&self) -> &[f32] {
        &self.force
    }

    /// Forgets the past: the next row begins a sequence.
    pub fn reset(&mut self) {
        self.stepper.reset();
        match &mut self.width {
            Width::Interval(live) => live.reset(),
            Width::Motion(motion) => motion.reset(),
        }
    }

    /// The next row comes `elapsed_s` after the one before it: rows are missing between them.
    pub fn gap(&mut self, elapsed_s: f64) {
        self.stepper.gap(elapsed_s);
        match &mut self.width {
            Width::Interval(live) => live.gap(elapsed_s),
            Width::Motion(motion) => motion.gap(elapsed_s),
        }
    }

    /// Takes a row of inputs, SI units; the force is in [`Self::force`].
    pub fn step(&mut self, input: &[f32]) -> Sure {
        self.stepper.step(input, &mut self.force);
        let sure = match &mut self.width {
            Width::Interval(live) => live.step(input),
            Width::Motion(motion) => Sure {
                half_n: None,
                valid: motion.step(input).settled(),
                misfits: false,
            },
        };
        let (Some(interval), Some(fit)) = (&self.estimator.interval, self.stepper.fit()) else {
            return sure;
        };
        let unsure_n = fit.unsure_n(&self.estimator.axes);
        Sure {
            half_n: sure.half_n.map(|half_n| half_n.hypot(NORMAL_90 * unsure_n)),
            misfits: !interval.fits(&fit.misfit),
            ..sure
        }
    }

    /// How the model fits its robot at the last row; `None`: it cannot tell.
    #[must_use]
    pub fn fit(&self) -> Option<Fit> {
        self.stepper.fit()
    }
}

/// What is before a row of a replay.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Before {
    /// The row before it in the log.
    Row,
    /// Nothing: the stream begins here.
    Start,
    /// Rows are missing: the time from the last row, s.
    Gap(f64),
}

/// A break in a log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Break {
    /// First row after it.
    at: usize,
    /// Rows before it that are missing; 0: the stream begins anew.
    missing: usize,
}

/// Breaks of a log, in order: where a replay begins anew, and where rows are missing.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Breaks(Vec<Break>);

/// Shortest and longest gap that is drawn, s.
const GAPS_S: [f64; 2] = [0.06, 3.0];

impl Breaks {
    /// So many starts and gaps at random places of `rows` rows, gaps of 0.06 to 3 s, log-uniform.
    #[must_use]
    pub fn drawn(
        rows: usize,
        step_s: f64,
        starts: usize,
        gaps: usize,
        random: &mut Random,
    ) -> Self {
        let draw = |random: &mut Random| (random.unit() * rows as f64) as usize;
        let mut breaks: Vec<Break> = (0..starts)
            .map(|_| Break {
                at: draw(random),
                missing: 0,
            })
            .collect();
        breaks.extend((0..gaps).map(|_| {
            let seconds = random.log_uniform(GAPS_S[0], GAPS_S[1]);
            Break {
                at: draw(random),
                missing: ((seconds / step_s).round() as usize).max(1),
            }
        }));
        Self::sorted(breaks, rows)
    }

    /// Breaks close to each other, for the calibration of intervals: 1 to 8 s of rows after each,
    /// starts and gaps in turn.
    #[must_use]
    pub(crate) fn dense(rows: usize, step_s: f64, random: &mut Random) -> Self {
        let mut breaks = Vec::new();
        let mut at = 0;
        let mut start = true;
        loop {
            let missing = if start {
                0
            } else {
                let seconds = random.log_uniform(GAPS_S[0], GAPS_S[1]);
                ((seconds / step_s).round() as usize).max(1)
            };
            at += missing + (random.log_uniform(1.0, 8.0) / step_s).round() as usize;
            if at >= rows {
                return Self::sorted(breaks, rows);
            }
            breaks.push(Break { at, missing });
            start = !start;
        }
    }

    /// In order, without those that reach beyond the rows or over another break.
    fn sorted(mut breaks: Vec<Break>, rows: usize) -> Self {
        breaks.sort_by_key(|b| b.at);
        let mut free = 1;
        breaks.retain(|b| {
            let fits = b.at < rows && b.at >= free + b.missing;
            if fits {
                free = b.at + 1;
            }
            fits
        });
        Self(breaks)
    }

    /// Number of breaks.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The rows of a log that are there, in order, each with what is before it. The first one has
    /// `first` before it.
    pub fn rows(&self, rows: usize, step_s: f64, first: Before) -> Vec<(usize, Before)> {
        let mut out = Vec::with_capacity(rows);
        let mut next = self.0.iter().peekable();
        for k in 0..rows {
            let Some(b) = next.peek() else {
                out.push((k, if k == 0 { first } else { Before::Row }));
                continue;
            };
            if k < b.at - b.missing {
                out.push((k, if k == 0 { first } else { Before::Row }));
            } else if k == b.at {
                let before = if b.missing == 0 {
                    Before::Start
                } else {
                    Before::Gap((b.missing + 1) as f64 * step_s)
                };
                out.push((k, before));
                next.next();
            }
        }
        out
    }
}

/// What is before the first row of a stretch that follows another one of the same log, or nothing
/// does.
#[must_use]
pub fn between(before: Option<&Sequence>, sequence: &Sequence) -> Before {
    let Some(last) = before.filter(|last| last.trial == sequence.trial) else {
        return Before::Start;
    };
    let end_s = last.start_s + (last.rows() as f64 - 1.0) * last.step_s;
    let elapsed_s = sequence.start_s - end_s;
    if elapsed_s > 0.0 {
        Before::Gap(elapsed_s)
    } else {
        Before::Start
    }
}

/// A replay: each row with its force and how sure it is.
pub fn replay(
    stream: &mut Stream<'_>,
    sequence: &Sequence,
    breaks: &Breaks,
    first: Before,
    mut row: impl FnMut(usize, Before, &[f32], Sure),
) {
    for (k, before) in breaks.rows(sequence.rows(), sequence.step_s, first) {
        match before {
            Before::Row => {}
            Before::Start => stream.reset(),
            Before::Gap(elapsed_s) => stream.gap(elapsed_s),
        }
        let sure = stream.step(sequence.input_row(k));
        row(k, before, stream.force(), sure);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn breaks_take_out_their_rows_and_no_others() {
        let breaks = Breaks::sorted(
            vec![
                Break { at: 9, missing: 3 },
                Break { at: 4, missing: 0 },
                Break { at: 5, missing: 4 },
                Break { at: 99, missing: 1 },
            ],
            12,
        );
        assert_eq!(breaks.len(), 2);
        let rows = breaks.rows(12, 0.5, Before::Start);
        let taken: Vec<usize> = rows.iter().map(|(k, _)| *k).collect();
        assert_eq!(taken, [0, 1, 2, 3, 4, 5, 9, 10, 11]);
        let before: Vec<Before> = rows.iter().map(|(_, b)| *b).collect();
        assert_eq!(before[0], Before::Start);
        assert_eq!(before[4], Before::Start);
        assert_eq!(before[6], Before::Gap(2.0));
        let others = [1, 2, 3, 5, 7, 8].map(|n: usize| before[n]);
        assert!(others.iter().all(|b| *b == Before::Row));
    }

    #[test]
    fn drawn_breaks_have_the_numbers_that_were_asked_for() {
        let mut random = Random::stream(3, "breaks", 0);
        let breaks = Breaks::drawn(60_000, 0.02, 20, 20, &mut random);
        let starts = breaks.0.iter().filter(|b| b.missing == 0).count();
        // One that falls into another is left out.
        assert!(starts >= 18 && breaks.len() >= 36, "{}", breaks.len());
        let dense = Breaks::dense(10_000, 0.02, &mut random);
        assert!(dense.len() > 30, "{}", dense.len());
    }
}
