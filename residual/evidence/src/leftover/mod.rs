//! What is left after the search: structure that no effect of the catalogue explains.
//!
//! Free forms without a name (`nameless`) are tried on the final residual. They are never chosen;
//! they show that something is left. An effect that fits in too few places counts as left too, and
//! so does switching between levels.

pub(crate) mod nameless;
mod structure;

pub use nameless::Nameless;
pub use structure::Structure;

use crate::one_alone;
use residual_columns::error::Error;
use residual_columns::format::{num, percent};
use residual_columns::frame::Frame;
use residual_columns::stats;
use residual_effects::{lines_of_inputs, Context};
use residual_fit::diagnostics::{
    levels, switching, unlike_noise, Along, Growth, Sort, UnlikeNoise,
};
use residual_log::finding::Finding;
use residual_search::model::{Chosen, Fitted};
use residual_search::ranking::{Acceptance, Step, RANDOM_WALK};
use residual_search::scan::{Candidate, Offer};
use residual_search::{Outcome, Search, Weight};

/// Share of what the named effects explain above which nameless structure makes them stand-ins.
pub const STAND_IN: f64 = 0.25;

/// Share of what the named effects explain by which one nameless form must do better in their place
/// to make them stand-ins.
const BETTER_ALONE: f64 = 0.01;

/// Fall of the RMSE by means of sequences that nothing explains from which on the verdict says so.
/// Less is usual: the zero of a load cell drifts a little from one log to the next.
const BETWEEN_LOGS: f64 = 0.1;

/// Name of the check that lines of the inputs carry much of what is left.
pub const LINE_OF_INPUT: &str = "line of an input";

/// Share of the squared error that is left from which a line that an input has too is noted:
/// without it the RMSE would be a tenth lower.
const LINE_SHARE: f64 = 0.19;

/// Share of the variance that the steps of the reading make, from which they can be a narrow band.
const STEPS: f64 = 0.3;

/// Most nameless forms that a report lists.
const LISTED: usize = 6;

/// Blocks of time that an effect needs before too few places can be the reason to doubt it.
const FEW_BLOCKS: usize = 8;

/// Nameless forms on top of a model, the one that explains most first.
pub struct Forms {
    all: Vec<Candidate<Nameless>>,
    /// How many were tested again: up to the first that counts.
    tested: usize,
}

impl Forms {
    /// Tries all of them on top of the model.
    pub fn new(search: &mut Search, on: &Fitted) -> Result<Forms, Error> {
        let mut all = search.scan(on, &offers)?;
        all.sort_by(|x, y| y.gain.total_cmp(&x.gain));
        let acceptance = search.acceptance();
        let mut tested = 0;
        while let Some(next) = all.get_mut(tested..tested + 1) {
            search.retest(next, on);
            if acceptance.accepts(&next[0]) {
                break;
            }
            tested += 1;
        }
        Ok(Forms { all, tested })
    }

    /// What the one that explains most depends on, for readers, and the held-out squared error that
    /// it explains.
    pub fn strongest(&self) -> Option<(&str, f64)> {
        let first = self.all.get(self.tested)?;
        Some((&first.origin.depends_on, first.base - first.held))
    }

    /// Those that count.
    fn counting(mut self, search: &Search, on: &Fitted) -> Vec<Candidate<Nameless>> {
        self.all.drain(..self.tested);
        if let Some(others) = self.all.get_mut(1..) {
            search.retest(others, on);
        }
        let acceptance = search.acceptance();
        self.all.retain(|c| acceptance.accepts(c));
        self.all
    }
}

/// What is left.
pub struct Leftover {
    /// Structure without a name, strongest first.
    pub structure: Vec<Structure>,
    /// Whether it puts what was named in doubt.
    pub unexplained: bool,
    /// The nameless form that explains most.
    pub largest: Option<Nameless>,
    /// Squared error that the named effects explain, held out.
    pub explained: f64,
    /// Whether what is left shows against time only.
    pub when: bool,
    /// What else is to be known of the noise.
    pub notes: Vec<Finding>,
}

/// Nameless forms on offer.
fn offers(_: &Search, ctx: &Context) -> Vec<Offer<Nameless>> {
    nameless::offers(ctx)
}

impl Leftover {
    /// Looks for what is left on top of the final model, beside the nameless forms on top of it.
    pub fn new(search: &mut Search, outcome: &Outcome, forms: Forms) -> Result<Leftover, Error> {
        let fitted = &outcome.fitted;
        let forms = forms.counting(search, fitted);
        let acceptance = search.acceptance();
        let held = fitted.squares();
        let before = search.declared.fit.scores.held_total(0);
        let mut out = Leftover {
            structure: vec![],
            unexplained: false,
            largest: None,
            explained: (before - held).max(0.0),
            when: false,
            notes: vec![],
        };
        if search.is_rounding(held) {
            return Ok(out);
        }
        out.structure = forms.iter().take(LISTED).map(structure).collect();
        out.largest = forms.first().map(|c| c.origin.clone());
        out.unexplained = match forms.first() {
            None => false,
            Some(c) if out.large(c.base - c.held) => true,
            Some(_) if outcome.chosen.is_empty() => false,
            Some(_) => out.better_alone(search, held)?,
        };
        out.few_places(&outcome.last, |c| {
            !c.steady
                && acceptance.fits(c)
                && !acceptance.refused_between(c)
                && !acceptance.refused_slow(c)
        });
        out.between_logs(&outcome.last, &acceptance);
        out.slow_noise(&outcome.last, &acceptance);
        out.by_sequence(search, fitted)?;
        out.one_alone(search, fitted);
        out.lines_of_inputs(search, fitted);
        let frame = search.problem.kept_frame();
        out.switching(search, &fitted.fit.residual, &frame, held);
        out.levels(search, &fitted.fit.residual, &frame, held);
        out.unlike_noise(search, &fitted.fit.residual, &frame, held);
        Ok(out)
    }

    /// Whether a squared error is large beside what the named effects explain.
    fn large(&self, squares: f64) -> bool {
        squares > STAND_IN * self.explained
    }

    /// Whether one nameless form in place of all named effects does better: then they only stand in
    /// for it. Better by something that counts beside what they explain: a free curve that contains
    /// an effect takes a last hundredth more on any real log.
    fn better_alone(&self, search: &mut Search, held: f64) -> Result<bool, Error> {
        let acceptance = search.acceptance();
        let declared = search.declared.clone();
        let alone = search.scan(&declared, &offers)?;
        let most = held * (1.0 - search.spec.selection.material).powi(2);
        Ok(alone.iter().any(|c| {
            c.held < most && held - c.held > BETTER_ALONE * self.explained && acceptance.accepts(c)
        }))
    }

    /// Adds an effect that fits, but in so few places that nothing confirms it: it is reported
    /// as structure without a name.
    fn few_places(&mut self, last: &Step, doubtful: impl Fn(&Candidate) -> bool) {
        let found = last
            .ranked
            .iter()
            .find(|c| doubtful(c) && c.local_in_time && c.losses.len() > FEW_BLOCKS);
        if let Some(c) = found {
            self.structure.push(Structure {
                depends_on: format!(
                    "few places, too few to be sure; {} would fit",
                    c.origin.name()
                ),
                gain: c.gain,
                p_value: c.p,
            });
            self.unexplained |= self.large(c.base - c.held);
        }
    }

    /// Adds an effect that would fit the means of the sequences, of which there are too few to tell
    /// it from zeros that differ by chance.
    fn between_logs(&mut self, last: &Step, acceptance: &Acceptance) {
        let refused = |c: &&Candidate| acceptance.refused_between(c);
        let found = last
            .ranked
            .iter()
            .find(|c| refused(c) && acceptance.fits(c) && c.steady);
        if let Some((c, b)) = found.and_then(|c| Some((c, c.between?))) {
            self.structure.push(Structure {
                depends_on: format!(
                    "which sequence it is, and too few sequences to say why (an effective number of {:.1}); {} would fit",
                    b.sequences,
                    c.origin.name()
                ),
                gain: c.gain,
                p_value: b.p,
            });
            self.unexplained |= c.gain > BETWEEN_LOGS && self.large(c.base - c.held);
        }
    }

    /// Adds an effect that would fit, and explains no more than slow noise of the same sensor does
    /// by chance.
    fn slow_noise(&mut self, last: &Step, acceptance: &Acceptance) {
        let refused = |c: &&Candidate| acceptance.refused_slow(c) && !acceptance.refused_between(c);
        let found = last
            .ranked
            .iter()
            .find(|c| refused(c) && acceptance.fits(c));
        if let Some((c, p_value)) = found.and_then(|c| Some((c, c.slow?))) {
            self.structure.push(Structure {
                depends_on: format!(
                    "a slow wander, too short to say whether it is noise; {} would fit",
                    c.origin.name()
                ),
                gain: c.gain,
                p_value,
            });
        }
    }

    /// Adds a coefficient that each sequence has for itself: offset, gain, damping or dry friction.
    fn by_sequence(&mut self, search: &mut Search, on: &Fitted) -> Result<(), Error> {
        if search.problem.runs().len() < 2 {
            return Ok(());
        }
        let mut all = search.scan(on, &|_, ctx| nameless::by_sequence(ctx))?;
        search.retest(&mut all, on);
        // These are few, and tried once.
        let acceptance = Acceptance {
            tests: all.len(),
            ..search.acceptance()
        };
        let counting = all.iter().filter(|c| acceptance.accepts(c));
        if let Some(c) = counting.max_by(|a, b| a.gain.total_cmp(&b.gain)) {
            self.structure.push(structure(c));
            self.structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
            self.unexplained |= c.gain > BETWEEN_LOGS && self.large(c.base - c.held);
        }
        Ok(())
    }

    /// Notes lines that an input has as well, so that they were not looked for as tones, where they
    /// carry much of what is left.
    fn lines_of_inputs(&mut self, search: &Search, on: &Fitted) {
        let lines = lines_of_inputs(&search.scan_on(on).context(), LINE_SHARE);
        if lines.is_empty() {
            return;
        }
        let each: Vec<String> = lines
            .iter()
            .map(|(f, share)| format!("{} Hz ({})", num(*f), percent(*share)))
            .collect();
        self.notes.push(Finding {
            check: LINE_OF_INPUT.into(),
            count: search.problem.y.len(),
            first: "whole record".into(),
            what: format!(
                "lines that carry much of the squared error that is left, and that an input or its slope has too: {}. They were not \
                 looked for as tones, as the answer to an input looks the same",
                each.join(", ")
            ),
        });
    }

    /// Adds what one sequence has and all others do not.
    fn one_alone(&mut self, search: &Search, on: &Fitted) {
        let scan = search.scan_on(on);
        let ctx = scan.context();
        let Some(found) = one_alone::find(&ctx, &on.fit.residual) else {
            return;
        };
        let total: f64 = on.fit.residual.iter().map(|r| r * r).sum();
        let gain = 1.0
            - (1.0 - found.squares / total.max(f64::MIN_POSITIVE))
                .max(0.0)
                .sqrt();
        if search.acceptance().material(gain) {
            self.structure.push(Structure {
                depends_on: found.words,
                gain,
                p_value: found.p,
            });
            self.structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
            self.unexplained |= self.large(found.squares);
        }
    }

    /// Adds switching between levels.
    fn switching(&mut self, search: &Search, residual: &[f64], frame: &Frame, held: f64) {
        let switching = switching(residual, frame);
        let gain = 1.0 - (1.0 - switching.share).sqrt();
        if switching.z < -5.0 && switching.kurtosis < -0.5 && search.acceptance().material(gain) {
            self.structure.push(Structure {
                depends_on: "no column: it switches between levels".into(),
                gain,
                p_value: stats::normal_tail(-switching.z),
            });
            self.structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
            self.unexplained |= self.large(switching.share * held);
        }
    }

    /// Adds a slow part that keeps to levels which single rows and blocks don't show.
    fn levels(&mut self, search: &Search, residual: &[f64], frame: &Frame, held: f64) {
        // What its share must be for its gain to be material.
        let least = 1.0 - (1.0 - search.spec.selection.material).powi(2);
        let Some(found) = levels(residual, frame, least) else {
            return;
        };
        let rate = 1.0 / frame.step();
        let share = found.share.min(1.0);
        self.structure.push(Structure {
            depends_on: format!(
                "no column: a slow part, mostly from {} to {} Hz, that keeps to levels as noise does not",
                num(found.between.0 * rate),
                num(found.between.1 * rate)
            ),
            gain: 1.0 - (1.0 - share).sqrt(),
            p_value: found.p,
        });
        self.structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
        self.unexplained |= self.large(share * held);
    }

    /// Adds what distinguishes the residual from the noise of a sensor: something acts that these
    /// columns do not show.
    fn unlike_noise(&mut self, search: &Search, residual: &[f64], frame: &Frame, held: f64) {
        let found = unlike_noise(residual, frame, &sorts(search, frame), &columns(search));
        self.notes.extend(found.growth.iter().map(|g| {
            let unit = &search.spec.roles.target.unit;
            growth_note(g, unit)
        }));
        let mut add = |depends_on: String, share: f64, least: f64| {
            let gain = 1.0 - (1.0 - share).max(0.0).sqrt();
            if search.acceptance().material(gain) {
                self.structure.push(Structure {
                    depends_on,
                    gain,
                    p_value: 0.0,
                });
                self.unexplained |= gain > least && self.large(share * held);
                self.when = true;
            }
        };
        add(burst_words(&found).into(), found.burst_share, 0.0);
        for (share, words) in found.excess.iter().zip(LOUDER) {
            add(words.into(), *share, 0.0);
        }
        if let Some(walk) = found.random_walk {
            add(
                format!(
                    "something that these columns do not show: it wanders slowly within the logs (means of neighbouring twentieths \
                     of a log are alike, correlation {:.2})",
                    walk.alike
                ),
                walk.share,
                RANDOM_WALK,
            );
        }
        let mean = stats::rms(residual).powi(2);
        let steps = stats::quantum(&search.problem.y).map_or(0.0, |q| q * q / 12.0);
        if let Some(band) = found.narrow.filter(|_| steps < STEPS * mean) {
            let rate = 1.0 / search.problem.frame.step();
            add(
                format!(
                    "something that these columns do not show: a narrow band of frequencies, mostly from {} to {} Hz",
                    num(band.between.0 * rate),
                    num(band.between.1 * rate)
                ),
                band.share,
                0.0,
            );
        }
        self.structure.sort_by(|x, y| y.gain.total_cmp(&x.gain));
        // Last: it names no variable.
        if found.follows_itself() {
            self.structure.push(Structure {
                depends_on: format!(
                    "something that these columns do not show: from row to row the residual follows itself (correlation {:.3})",
                    found.lag_one
                ),
                gain: 1.0 - (1.0 - found.lag_one.powi(2)).sqrt(),
                p_value: 0.0,
            });
            self.unexplained |= self.large(found.lag_one.powi(2) * held);
            self.when = true;
        }
    }

    /// Notes that the only effects that fit, `chosen` with what each is worth, have names that the
    /// data do not support.
    pub fn only_unsupported(&mut self, chosen: &[Chosen], weights: &[Weight]) {
        if self.structure.is_empty() {
            let names: Vec<&str> = chosen.iter().map(|c| c.effect.name()).collect();
            let gain = |w: &Weight| 1.0 - w.rmse / w.rmse_without;
            self.structure.push(Structure {
                depends_on: format!(
                    "what {} would fit; their names are not supported",
                    names.join(", ")
                ),
                gain: weights.first().map_or(0.0, gain),
                p_value: f64::NAN,
            });
        }
        self.unexplained = true;
    }

    /// Adds a doubt about what was named, before everything else.
    pub fn doubt(&mut self, structure: Structure) {
        self.structure.insert(0, structure);
        self.unexplained = true;
    }
}

/// Seconds after a start in which motion counts as just started.
const START_S: f64 = 0.7;

/// Shortest rest, in seconds and in rows.
const REST_S: f64 = 0.1;
const REST_ROWS: usize = 3;

/// Share of the bursts in rows of one sort from which they belong to it.
const BELONG: f64 = 0.6;

/// Columns on which the size of noise may depend: load and velocity.
fn columns(search: &Search) -> Vec<Along> {
    let ctx = search.scan_on(&search.declared).context();
    let of = |name: &str, expression: &str| Along {
        name: name.into(),
        values: ctx.values(expression),
    };
    let velocity = ctx.velocity.as_ref().map(|v| of("velocity", v));
    let mut out = vec![of("load", &ctx.load)];
    out.extend(velocity);
    out.retain(|c| c.values.len() == search.problem.y.len());
    out
}

/// That the noise grows with a column, for the table of the data.
fn growth_note(growth: &Growth, unit: &str) -> Finding {
    let (small, large) = growth.sizes;
    Finding {
        check: "noise".into(),
        count: growth.rows,
        first: String::new(),
        what: format!(
            "the noise grows with the {}: about {} {unit} in the fifth of the rows with the smallest values, {} {unit} in that with the largest",
            growth.name,
            num(small),
            num(large)
        ),
    }
}

/// Rows in which something of its own may act: at rest, and in motion that began less than
/// [`START_S`] ago, after a rest. None without a velocity.
fn sorts(search: &Search, frame: &Frame) -> [Sort; 2] {
    let ctx = search.scan_on(&search.declared).context();
    let resting = ctx.velocity.as_ref().map_or(vec![], |v| {
        ctx.values(&format!("sgn({v}, {}) == 0", ctx.deadband))
    });
    let rows = frame.len();
    if resting.len() != rows {
        let none = || vec![false; rows];
        return std::array::from_fn(|_| Sort {
            rows: none(),
            others: none(),
        });
    }
    let still: Vec<bool> = resting.iter().map(|x| *x != 0.0).collect();
    let (rest, started) = rest_and_start(&still, frame);
    [
        Sort {
            others: still.iter().map(|still| !still).collect(),
            rows: rest,
        },
        Sort {
            others: (0..rows).map(|i| !still[i] && !started[i]).collect(),
            rows: started,
        },
    ]
}

/// Rows of rests, and those of the motion just after one, from rows without motion. An encoder that
/// moves slowly has rows without motion between its steps, so a short time is no rest.
fn rest_and_start(still: &[bool], frame: &Frame) -> (Vec<bool>, Vec<bool>) {
    let (mut rest, mut started) = (vec![false; still.len()], vec![false; still.len()]);
    for sequence in frame.sequences() {
        let mut at = sequence.start;
        let mut since = f64::NEG_INFINITY;
        for part in still[sequence.clone()].chunk_by(|a, b| a == b) {
            let rows = at..at + part.len();
            at = rows.end;
            let time = &frame.time()[rows.clone()];
            if !part[0] {
                let new = time.iter().map(|t| t - since < START_S);
                new.zip(&mut started[rows])
                    .for_each(|(new, row)| *row = new);
            } else if part.len() >= REST_ROWS && time[part.len() - 1] - time[0] >= REST_S {
                since = time[part.len() - 1];
                rest[rows].fill(true);
            }
        }
    }
    (rest, started)
}

/// A residual that is louder at rest, or when motion begins, in words: in the order of [`sorts`].
const LOUDER: [&str; 2] = [
    "what acts at rest (contact, or friction that holds), which these columns do not show: the residual is larger there than in slow \
     motion",
    "what acts when the motion begins (breaking loose), which these columns do not show: the residual is larger there than later at \
     the same speed",
];

/// Bursts in words, by the rows that they fall on: in the order of [`sorts`].
fn burst_words(found: &UnlikeNoise) -> &'static str {
    let belong = |k: usize| {
        found
            .within
            .get(k)
            .is_some_and(|(bursts, rows)| *bursts > BELONG && *bursts > 1.5 * rows)
    };
    if belong(0) {
        "contact: bursts at rest, which these columns do not show"
    } else if belong(1) {
        "bursts when the motion begins, which these columns do not show"
    } else {
        "something that these columns do not show: it comes in bursts"
    }
}

fn structure(c: &Candidate<Nameless>) -> Structure {
    Structure {
        depends_on: c.origin.depends_on.clone(),
        gain: c.gain,
        p_value: c.p,
    }
}
