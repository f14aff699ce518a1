//! What an effect may know about the data when it proposes its forms.

use super::ratio;
use residual_columns::expr::Expr;
use residual_columns::linalg::dot;
use residual_columns::stats;
use residual_columns::units::radians;
use residual_fit::problem::{Direction, Problem};
use residual_log::spec::Spec;

/// Largest factor for what a slope loses of an acceleration.
const MOST_LOST: f64 = 1.25;

/// Longest window of a slope times the rate at which the velocity changes (for a sine its angular
/// frequency).
const WINDOW: f64 = 1.5;

/// Energy of fourth differences over that of second ones above which a column changes in steps. It
/// is 10 for single steps, 12 for white noise, and below 1 where rows resolve the motion but for
/// some corners.
const STEPPED: f64 = 2.0;

/// Squares of the rows' distances from the middle of a slope over 2 `half` + 1 rows, summed.
fn spread(half: f64) -> f64 {
    half * (half + 1.0) * (2.0 * half + 1.0) / 3.0
}

/// Fourth differences at distance 1 and 2 of white noise have the same variance. It is not white
/// where the ratio is outside of these.
const WHITE: std::ops::Range<f64> = 0.7..1.5;

/// The same ratio above which it is that of a motion, whose fourth differences grow by up to 256.
/// Usual filters of noise stay below.
const MOTION: f64 = 60.0;

/// Share of the energy of the narrowest slope up to which white noise with the fourth differences
/// of the velocity does not matter. That of filtered noise is larger: fourth differences see its
/// high frequencies only.
const SMALL: f64 = 0.001;

/// Noise in a slope, over the rest of its energy, up to which the slope shows what it loses.
const CLEAR: f64 = 0.1;

/// What the second slope loses beside the narrowest, over what the third loses: for a motion that
/// rows resolve, and for steps of the acceleration. Others lie between the two.
const LOSSES: [f64; 2] = [2.0 / 5.0, 0.565];

/// How far outside of these it may be: of a sine with eight rows in a period it is 0.29.
const OUTSIDE: f64 = 0.12;

/// By how much the share that the narrowest slope loses falls with that ratio, for sines with few
/// rows in a period.
const FEW_ROWS: f64 = 0.5;

/// The factor for what the narrowest slope loses of the acceleration beside one of half width
/// `half`, from what the second and the third lose beside the narrowest.
///
/// Over 2 n + 1 rows a slope loses (3 n² + 3 n - 1) / 30 times the same small number where rows
/// resolve the motion: the narrowest one 5/12 of what the second loses beside it. The means over
/// all places of a step between two rows give 25/34 · 3 / (2 n + 1) of it instead.
fn narrowest(second: f64, third: f64, half: f64) -> f64 {
    let [smooth, steps] = LOSSES;
    let ratio = second / third;
    if third <= 0.0 || !(smooth - OUTSIDE..steps + OUTSIDE).contains(&ratio) {
        return 1.0;
    }
    let [least, most] = [5.0 / 12.0, 25.0 / 34.0 * 3.0 / (2.0 * half + 1.0)];
    let slope = if ratio < smooth {
        FEW_ROWS
    } else {
        (most - least) / (steps - smooth)
    };
    1.0 + (least + slope * (ratio - smooth).min(steps - smooth)) * second
}

/// Half widths, in rows, of slopes of the angle that may show the direction of a motion.
const SLOPES_OF_ANGLE: [f64; 4] = [1.0, 2.0, 4.0, 8.0];

/// Bands of rest of such a slope over the deadband of the velocity. A slope over three rows is a
/// quarter of that of the next row where a motion sets out evenly: one of these lies between.
const NARROWER: [f64; 5] = [1.0 / 32.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0, 1.0 / 2.0];

/// Share of the difference between the slope of the angle and the velocity that is along the
/// acceleration where the velocity is late.
const SURELY_LATE: f64 = 0.05;

/// Share of the steps of time that may be longer or shorter than the usual one by a quarter.
const UNEVEN: f64 = 0.1;

/// Variance of the white noise of a column, from its fourth differences at a distance in rows: a
/// motion that rows resolve is smooth to them. Corners of the motion are few, and the median leaves
/// them out.
fn white_noise(values: &[f64], distance: usize) -> f64 {
    let fourth = |w: &[f64]| {
        let at = |k: usize| w[k * distance];
        (at(0) - 4.0 * at(1) + 6.0 * at(2) - 4.0 * at(3) + at(4)).abs()
    };
    let windows = values.windows(4 * distance + 1);
    let mut sizes: Vec<f64> = windows.map(fourth).collect();
    let all = sizes.len().max(1) as f64;
    // At rest a speed has no noise.
    sizes.retain(|s| *s > 0.0);
    let share = sizes.len() as f64 / all;
    let usual = stats::median(&mut sizes).unwrap_or(0.0) / 0.6745;
    share * usual.powi(2) / 70.0
}

/// Slopes of a velocity over several rows, each with the factor with which a fit gives the
/// coefficient of the acceleration: what the slope loses of the acceleration would make an inertia
/// too large, the noise of the velocity too small. Where the noise of the velocity is neither small
/// nor white, as that of a difference of angles, there is no factor.
#[derive(Debug, Clone)]
pub struct Slopes(Vec<(f64, String)>);

impl Slopes {
    /// Half widths, in rows.
    pub fn widths(&self) -> Vec<f64> {
        self.0.iter().map(|(half, _)| *half).collect()
    }

    /// The slope with about this half width, as an expression.
    pub fn text(&self, half: f64) -> String {
        let off = |(own, _): &&(f64, String)| (own - half).abs();
        let nearest = self.0.iter().min_by(|a, b| off(a).total_cmp(&off(b)));
        nearest.map_or_else(String::new, |(_, text)| text.clone())
    }
}

/// What an effect may know about the data when it proposes variants.
pub struct Context<'a> {
    /// The rows that are fitted.
    pub problem: &'a Problem,
    /// The model file.
    pub spec: &'a Spec,
    /// The declared model's prediction as an expression: what the rig is loaded with.
    pub load: String,
    /// Whether the load is the command with a fitted coefficient that is not clearly different from
    /// zero: shares of such a load say nothing.
    pub load_is_vague: bool,
    /// All force that the declared terms predict, as an expression, where friction and other forces
    /// make it differ from the load.
    pub all_force: Option<String>,
    /// Residual of the current model on fitted rows.
    pub residual: &'a [f64],
    /// Columns that the current model uses, effects found so far included.
    pub columns: Vec<String>,
    /// Whether the current model has dry friction already.
    pub friction: bool,
    /// Velocity expression (the role, or the derivative of the angle).
    pub velocity: Option<String>,
    /// Standstill band of the velocity.
    pub deadband: f64,
    /// What shows the direction of the motion, which dry friction follows: the velocity outside of
    /// its deadband, or what shows more of slow motion; `None` without a velocity.
    pub direction: Option<Direction>,
    /// Position expression (the angle role, or the integral of the velocity).
    pub position: Option<String>,
    /// Median step of time, s.
    pub dt: f64,
    /// Longest sequence, s.
    pub span: f64,
}

/// What friction grows with: the load, or the command where the size of the load is not known.
pub struct Measure {
    /// Expression of its magnitude.
    pub text: String,
    /// End of the name of a coefficient.
    pub suffix: &'static str,
    /// Unit of a coefficient.
    pub unit: String,
}

impl Context<'_> {
    /// What a friction that grows with the load is measured by.
    pub fn measure(&self) -> Measure {
        if self.load_is_vague {
            Measure {
                text: "abs(command)".into(),
                suffix: "_per_command",
                unit: self.per(&self.spec.roles.unit("command")),
            }
        } else {
            Measure {
                text: format!("abs({})", self.load),
                suffix: "_per_load",
                unit: "1".into(),
            }
        }
    }

    /// What the characteristic of a sensor may act on, with its name: the load alone, and all force
    /// that is predicted.
    pub fn sensed(&self) -> Vec<(&'static str, String)> {
        let all = self.all_force.iter().map(|f| ("all force", f.clone()));
        let load = std::iter::once(("load", self.load.clone()));
        load.chain(all).collect()
    }

    /// Unit of the target.
    pub fn unit(&self) -> &str {
        &self.spec.roles.target.unit
    }

    /// `target unit / x`, for coefficients.
    pub fn per(&self, x: &str) -> String {
        if x.is_empty() {
            self.unit().to_string()
        } else if x == self.unit() {
            "1".into()
        } else {
            ratio(self.unit(), x)
        }
    }

    /// Whether the log has a command.
    pub fn has_command(&self) -> bool {
        self.spec.roles.command.is_some()
    }

    /// Whether the load has a term whose coefficient is declared, so that its scale may be wrong.
    pub fn scale_is_declared(&self) -> bool {
        let declared: Vec<_> = self
            .spec
            .terms
            .iter()
            .filter(|t| t.effect.is_empty() && t.per.is_empty())
            .filter_map(|t| Some((t.fixed, Expr::parse(&t.expr).ok()?)))
            .collect();
        let of_command = |e: &Expr| e.names().contains("command");
        let any = declared.iter().any(|(_, e)| of_command(e));
        declared
            .iter()
            .any(|(fixed, e)| fixed.is_some() && (!any || of_command(e)))
    }

    /// Slopes of a velocity that stand for its acceleration: a compromise between noise and lost
    /// detail.
    pub fn slopes(&self, velocity: &str) -> Slopes {
        let speed = self.values(velocity);
        let size = stats::deviation(&speed).max(f64::MIN_POSITIVE);
        let text = |half: f64| format!("deriv({velocity}, {half})");
        let steps = self.values(&text(1.0));
        let product = |a: &[f64], b: &[f64]| dot(a, b) / b.len().max(1) as f64;
        let (near, far) = (white_noise(&speed, 1), white_noise(&speed, 2));
        // What noise of the velocity adds to the product of a slope with itself or with a narrower
        // one.
        let added = |half: f64| near / self.dt.powi(2) / spread(half);
        let small = added(1.0) <= SMALL * product(&steps, &steps);
        let white_or_motion = |ratio: f64| WHITE.contains(&ratio) || ratio > MOTION;
        let known = (small || white_or_motion(far / near)) && self.is_even();
        // What a slope loses beside the narrowest one.
        let lost = |half: f64| {
            let slope = self.values(&text(half));
            let rest = product(&slope, &slope) - added(half);
            let clear = added(half) <= CLEAR * rest;
            clear.then(|| (product(&steps, &slope) - added(half)) / rest - 1.0)
        };
        let losses = lost(2.0).zip(lost(3.0));
        let written = |half: f64, slope: &[f64]| {
            let own = product(slope, slope);
            let narrowest = losses.map_or(1.0, |(second, third)| narrowest(second, third, half));
            let factor =
                narrowest * (product(&steps, slope) - added(half)) / own.max(f64::MIN_POSITIVE);
            let factor = factor.clamp(1.0 / MOST_LOST, MOST_LOST);
            if !known || (factor - 1.0).abs() < 0.0005 {
                (half, text(half))
            } else {
                (half, format!("{factor:.3} * {}", text(half)))
            }
        };
        let mut out = Slopes(vec![written(1.0, &steps)]);
        for half in [2.0, 3.0, 5.0, 8.0, 12.0, 18.0] {
            let slope = self.values(&text(half));
            let own = product(&slope, &slope);
            // A slope over 2 `half` + 1 rows follows the acceleration where that window is short
            // beside the time in which the velocity changes. A sine keeps nine tenths of its
            // acceleration at the limit. Far wider ones see no change at all, so the first that
            // does not follow ends the list. So does one that loses more than can be made up for:
            // over short pulses it is smooth itself, and noise does not make it look so, as that is
            // in both products.
            if (2.0 * half + 1.0) * self.dt * own.sqrt() / size >= WINDOW
                || product(&steps, &slope) > MOST_LOST * own
            {
                break;
            }
            out.0.push(written(half, &slope));
        }
        out
    }

    /// By how many seconds the velocity column follows the slope of the angle: a velocity from an
    /// encoder is often filtered. `None` without both columns in units that fit, and where it is
    /// not surely late.
    pub fn velocity_is_late(&self) -> Option<f64> {
        let roles = &self.spec.roles;
        let (velocity, angle) = (roles.velocity.as_ref()?, roles.angle.as_ref()?);
        if velocity.unit != format!("{}/s", angle.unit) {
            return None;
        }
        let [speed, slope, change] =
            ["velocity", "deriv(angle, 1)", "deriv(velocity, 1)"].map(|text| self.values(text));
        if speed.is_empty() || slope.len() != speed.len() || change.len() != speed.len() {
            return None;
        }
        let ahead: Vec<f64> = slope.iter().zip(&speed).map(|(s, v)| s - v).collect();
        let (own, product) = (dot(&change, &change), dot(&ahead, &change));
        let late = product / own.max(f64::MIN_POSITIVE);
        // Most of a real lateness is along the acceleration, in many rows; noise of the two columns
        // is not.
        let sure = product.powi(2) > SURELY_LATE * own * dot(&ahead, &ahead);
        (late > 0.1 * self.dt && sure).then_some(late)
    }

    /// Slopes of the angle that may show the direction of motion within the deadband of the
    /// velocity, each with bands of rest from three times its noise on. None without both columns.
    ///
    /// A slope is under way before the motion is, by half its rows: a wider band takes that out.
    pub fn slopes_of_angle(&self) -> Vec<Direction> {
        if self.spec.roles.angle.is_none() || self.deadband <= 0.0 {
            return vec![];
        }
        let noise = white_noise(&self.values("angle"), 1);
        let slope = |half: f64| {
            let least = 3.0 * (noise / spread(half)).sqrt() / self.dt;
            let wider = NARROWER.map(|share| share * self.deadband);
            let bands = std::iter::once(least).chain(wider.into_iter().filter(move |b| *b > least));
            bands.map(move |band| Direction {
                of: format!("deriv(angle, {half})"),
                band,
            })
        };
        SLOPES_OF_ANGLE.into_iter().flat_map(slope).collect()
    }

    /// Whether the rows are evenly spaced in time.
    pub fn is_even(&self) -> bool {
        let frame = &self.problem.frame;
        let sequences = frame.sequences().iter();
        let steps: Vec<f64> = sequences
            .flat_map(|r| frame.time()[r.clone()].windows(2).map(|w| w[1] - w[0]))
            .collect();
        let odd = |step: &&f64| (*step / self.dt - 1.0).abs() > 0.25;
        steps.iter().filter(odd).count() as f64 <= UNEVEN * steps.len() as f64
    }

    /// Whether enough of the fitted rows are at rest to show what friction does there.
    pub fn rests(&self) -> bool {
        let at_rest = |d: &Direction| self.values(&format!("{} == 0", d.sign()));
        let rests = self.direction.as_ref().map(at_rest);
        rests.is_some_and(|rests| stats::mean(&rests) > 0.005)
    }

    /// Whether the motion has both directions: each in a hundredth of the rows that move.
    pub fn turns_round(&self) -> bool {
        let signs = self.direction.as_ref().map(|d| self.values(&d.sign()));
        let signs = signs.unwrap_or_default();
        let share = |sign: f64| signs.iter().filter(|s| **s == sign).count() as f64;
        let (forth, back) = (share(1.0), share(-1.0));
        forth.min(back) >= 0.01 * (forth + back) && forth > 0.0
    }

    /// Values of an expression on fitted rows; empty if it cannot be evaluated.
    pub fn values(&self, text: &str) -> Vec<f64> {
        self.problem
            .eval_text(&self.problem.plain, text, true)
            .map_or_else(|_| vec![], |v| v.to_vec())
    }

    /// 2 % and 98 % quantiles of an expression; `None` if it is constant or cannot be evaluated.
    pub fn range(&self, text: &str) -> Option<(f64, f64)> {
        self.problem.range(text)
    }

    /// Step of a column that moves in steps; 0 if it does not, or is not there.
    pub fn step_of(&self, column: &str) -> f64 {
        let frame = &self.problem.frame;
        let step = frame.column(column).and_then(stats::quantum);
        step.unwrap_or(0.0)
    }

    /// Width of the range of an expression between its 2 % and 98 % quantiles; 0 if it is constant.
    pub fn width(&self, text: &str) -> f64 {
        self.range(text).map_or(0.0, |(lo, hi)| hi - lo)
    }

    /// Turns over which the position moves, between its 2 % and 98 % quantiles; `None` if it is no
    /// angle.
    pub fn turns(&self) -> Option<f64> {
        let k = radians(&self.position_unit())?;
        Some(self.width(self.position.as_ref()?) * k / std::f64::consts::TAU)
    }

    /// Largest range of an expression within one sequence, between its 2 % and 98 % quantiles
    /// there.
    pub fn excursion(&self, text: &str) -> f64 {
        let v = self.values(text);
        if v.is_empty() {
            return 0.0;
        }
        let of = |rows: std::ops::Range<usize>| {
            let mut own = v[rows].to_vec();
            own.sort_unstable_by(f64::total_cmp);
            stats::quantile_sorted(&own, 0.98) - stats::quantile_sorted(&own, 0.02)
        };
        self.problem
            .rows_of_runs()
            .into_iter()
            .map(of)
            .fold(0.0, f64::max)
    }

    /// Name of the velocity's unit.
    pub fn velocity_unit(&self) -> String {
        match &self.spec.roles.velocity {
            Some(v) => v.unit.clone(),
            None => format!("{}/s", self.spec.roles.unit("angle")),
        }
    }

    /// Name of the position's unit.
    pub fn position_unit(&self) -> String {
        match &self.spec.roles.angle {
            Some(a) => a.unit.clone(),
            None => {
                let v = self.velocity_unit();
                v.strip_suffix("/s")
                    .map_or(format!("{v}·s"), str::to_string)
            }
        }
    }

    /// Angles in the data: (name for reports, expression in radians, total range in radians).
    pub fn angles(&self) -> Vec<(String, String, f64)> {
        let mut all: Vec<(String, String)> = self
            .spec
            .roles
            .pose
            .iter()
            .map(|(n, c)| (n.clone(), c.unit.clone()))
            .collect();
        if let Some(a) = &self.spec.roles.angle {
            all.push(("angle".into(), a.unit.clone()));
        }
        all.into_iter()
            .filter_map(|(n, unit)| {
                let k = radians(&unit)?;
                let (lo, hi) = self.range(&n)?;
                let text = if k == 1.0 {
                    n.clone()
                } else {
                    format!("({n} * {k})")
                };
                Some((n, text, (hi - lo) * k))
            })
            .collect()
    }

    /// Time-varying columns that the declared terms use.
    pub fn declared_columns(&self) -> Vec<String> {
        let mut out = std::collections::BTreeSet::new();
        for t in self.spec.terms.iter().filter(|t| t.effect.is_empty()) {
            if let Ok(e) = Expr::parse(&t.expr) {
                out.extend(e.names());
            }
        }
        out.into_iter()
            .filter(|n| {
                !["time", "elapsed", "file"].contains(&n.as_str()) && self.range(n).is_some()
            })
            .collect()
    }

    /// Whether a column changes in steps from row to row, so that what it is between two rows is
    /// not on the straight line between them.
    pub fn is_stepped(&self, column: &str) -> bool {
        let frame = &self.problem.frame;
        let Some(values) = frame.column(column) else {
            return false;
        };
        let (mut second, mut fourth) = (0.0, 0.0);
        for run in frame.sequences() {
            for w in values[run.clone()].windows(5) {
                second += (w[1] - 2.0 * w[2] + w[3]).powi(2);
                fourth += (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).powi(2);
            }
        }
        fourth > STEPPED * second
    }

    /// Time in which an expression changes by its own size (for a sine a radian of its period); 0
    /// if it does not change.
    pub fn changes_in(&self, text: &str) -> f64 {
        let size = stats::deviation(&self.values(text));
        let slope = stats::rms(&self.values(&format!("deriv({text}, 2)")));
        if slope > 0.0 {
            size / slope
        } else {
            0.0
        }
    }

    /// Logarithmic grid from `lo` to `hi`, neighbours at most a factor of `ratio` apart.
    pub fn grid_by_ratio(lo: f64, hi: f64, ratio: f64) -> Vec<f64> {
        let steps = ((hi / lo).ln() / ratio.ln()).ceil().max(1.0);
        Context::log_grid(lo, hi, steps as usize + 1)
    }

    /// Logarithmic grid.
    pub fn log_grid(lo: f64, hi: f64, n: usize) -> Vec<f64> {
        (0..n)
            .map(|i| lo * (hi / lo).powf(i as f64 / (n - 1).max(1) as f64))
            .collect()
    }
}
