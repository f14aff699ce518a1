//! `calibrate gain`.

use super::super::connection::Connection;
use super::super::exit::{Failure, Reply, Result};
use super::super::Context;
use super::series::{Plan, Series};
use super::standards::{Standards, Traced};
use super::{picture, read, Bench, ByHand};
use calibrate::cells;
use calibrate::certificate;
use calibrate::picture::{bars, Bar};
use calibrate::standin::{Cells, Weights};
use calibrate::weights::{self, Fitted};
use calibration::gain::{iso376, Gain as Fit, Options, Term, WEIGHTS_G};
use clap::{Args, Parser};
use known::{base, checks, serials};
use rig::Rig;
use serde_json::json;
use session::link::RigLink;
use session::Session;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Arguments of `calibrate gain`.
#[derive(Debug, Args)]
pub struct Gain {
    /// Units to calibrate [default: all that are enabled]
    #[arg(long, value_name = "N", num_args = 1..)]
    unit: Vec<u8>,
    /// Readings of one unit (CSV: weight_g, code, standard_error, ...) instead of reading the rig;
    /// `-`: standard input
    #[arg(long, value_name = "FILE")]
    readings: Option<PathBuf>,
    /// Serial number of the cell that is weighed: has to be that of the store, or is entered where
    /// the store has none
    #[arg(long, value_name = "SERIAL", value_parser = serials::parse)]
    cell: Option<String>,
    /// Weights that are hung, g
    /// [default: 10 20 50 100 200 500 1000; with --iso-376 100 200 300 500 600 700 800 1000]
    #[arg(long, value_name = "GRAM", num_args = 1.., value_parser = weight)]
    weights: Vec<f64>,
    /// The procedure of ISO 376: three preloads, two rising series, a rising and a falling one in
    /// each of two further mountings of the cell, creep over 300 s; 40 minutes for each cell.
    /// Prints its figures and the class
    #[arg(long = "iso-376", conflicts_with_all = ["rounds", "creep"])]
    iso376: bool,
    /// Times that the weights are put on and taken off
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=20))]
    rounds: u8,
    /// Time for which the largest weight is left on at the end, and off again, to see creep; 0: not
    /// at all
    #[arg(long, value_name = "SECONDS", default_value = "30", value_parser = super::super::values::seconds_or_zero)]
    creep: f64,
    /// Accept gains that are far from the stored ones: units or cells were exchanged
    #[arg(long)]
    replace: bool,
    /// Correct the weight of a line of the readings, as in 5=50; repeatable
    #[arg(long, value_name = "LINE=GRAM", value_parser = correction)]
    correct: Vec<(usize, f64)>,
    /// Leave out a line of the readings; repeatable
    #[arg(long, value_name = "LINE")]
    leave_out: Vec<usize>,
    #[command(flatten)]
    standards: Standards,
    #[command(flatten)]
    traced: Traced,
    #[command(flatten)]
    by_hand: ByHand,
}

fn correction(text: &str) -> std::result::Result<(usize, f64), String> {
    let parsed = text
        .split_once('=')
        .and_then(|(line, gram)| Some((line.parse().ok()?, gram.parse().ok()?)));
    parsed.ok_or_else(|| format!("`{text}` is not LINE=GRAM, for example 5=50"))
}

/// A weight that can be hung, g.
pub(super) fn weight(text: &str) -> std::result::Result<f64, String> {
    let parsed = text.parse().ok().filter(|g: &f64| *g > 0.0 && *g <= 3000.0);
    parsed.ok_or_else(|| {
        format!("`{text}` is not a weight; give gram, above 0 and up to 3000, for example 50")
    })
}

/// The command's own words, for [`Gain::of_units`].
#[derive(Debug, Parser)]
struct Words {
    #[command(flatten)]
    gain: Gain,
}

impl Gain {
    /// `calibrate gain` of these units, with all other options as they are by default.
    pub fn of_units(units: &[u8], yes: bool, out: &Path) -> Result<Self> {
        let mut words: Vec<OsString> = vec!["gain".into(), "--out".into(), out.into()];
        words.extend(yes.then(|| "--yes".into()));
        words.push("--unit".into());
        words.extend(units.iter().map(|unit| unit.to_string().into()));
        let words = Words::try_parse_from(words).map_err(Failure::usage)?;
        Ok(words.gain)
    }

    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let connection = &self.by_hand.connection;
        self.on(connection, |rig| connection.open(rig, context), context)
    }

    /// Runs it on the rig of a connection, which `open` opens.
    pub fn on(
        &self,
        connection: &Connection,
        open: impl FnOnce(&Rig) -> Result<Box<dyn RigLink>>,
        context: &Context,
    ) -> Result<Reply> {
        self.standards.check()?;
        if self.iso376 && self.readings.is_none() {
            let mut loads = self.weights();
            loads.sort_by(f64::total_cmp);
            loads.dedup();
            if loads.len() < iso376::LEAST_LOADS {
                let found = loads.len();
                return Err(Failure::usage(iso376::Missing::Loads { found }));
            }
        }
        let mut bench = Bench::tested(connection, context)?;
        let enabled = bench.rig.units.iter().filter(|unit| unit.enabled);
        let units: Vec<u8> = if self.unit.is_empty() {
            enabled.map(|unit| unit.number).collect()
        } else {
            self.unit.clone()
        };
        if let Some(wrong) = units
            .iter()
            .find(|u| !bench.rig.units.iter().any(|unit| unit.number == **u))
        {
            return Err(Failure::usage(format!("there is no unit {wrong}")));
        }
        if let Some(serial) = &self.cell {
            let [unit] = units[..] else {
                return Err(Failure::usage(
                    "--cell is the serial number of one cell: name its unit with --unit N",
                ));
            };
            serials::check_cell(&mut bench.record, unit, serial)?;
        }
        if let Some(path) = &self.readings {
            let [unit] = units[..] else {
                return Err(Failure::usage(
                    "--readings has the readings of one unit: name it with --unit N",
                ));
            };
            let (name, text) = read(path)?;
            let fitted = self.fit(&bench, unit, &name, &text)?;
            if self.iso376 && fitted.iso376.is_none() {
                return Err(Failure::usage(format!(
                    "--iso-376: {name} has no column `series`; add it (0 preload, 1 to 6, 7 creep), or leave --iso-376 out"
                )));
            }
            return self.finish(&mut bench, vec![(unit, fitted)], false, context);
        }
        let _controlled_stop = context.interrupt.controlled_stop();
        let rig = bench.calibrated();
        let mut link = open(&rig)?;
        let mut session = Session::connect(link.as_mut())?;
        cells::prepare(&mut session, &rig)?;
        let seed = session.link().controls().map(|controls| controls.seed());
        let file = ("--readings", "hangs weights on a real rig");
        self.by_hand.check(seed.is_some(), file)?;
        let inject = &self.by_hand.inject;
        let cells_of = |seed| self.iso376.then(|| Cells::new(seed, inject));
        let mut standin = seed.map(|seed| (Weights::new(seed, inject), cells_of(seed)));
        let groups: Vec<Vec<u8>> = if self.by_hand.yes {
            vec![units.clone()]
        } else {
            units.iter().map(|unit| vec![*unit]).collect()
        };
        for group in &groups {
            Series::begin(&self.plan(), &bench, group, &mut session, context)?.run(
                &mut session,
                &mut standin,
                context,
            )?;
        }
        let mut fitted = Vec::new();
        for unit in units {
            let draft = bench.store.draft(&format!("{}-unit{unit}", self.step()));
            let text = draft.text()?.unwrap_or_default();
            let name = draft.path().display().to_string();
            fitted.push((unit, self.fit(&bench, unit, &name, &text)?));
        }
        let reply = self.finish(&mut bench, fitted, true, context)?;
        cells::push(&mut session, &bench.calibrated(), &[])?;
        Ok(reply)
    }

    /// What is to be read, and how.
    fn plan(&self) -> Plan {
        let hold = Duration::from_secs_f64(self.creep);
        let weights = self.weights();
        let largest_g = weights.iter().copied().fold(0.0, f64::max);
        Plan {
            loads: if self.iso376 {
                weights::iso376_plan(&weights)
            } else {
                weights::plan(&weights, usize::from(self.rounds), hold)
            },
            step: self.step(),
            drift_n: weights::drift_limit_n(largest_g, self.iso376 || self.creep > 0.0),
            yes: self.by_hand.yes,
            restart: self.by_hand.restart,
        }
    }

    /// Name of the drafts.
    const fn step(&self) -> &'static str {
        if self.iso376 {
            "iso376"
        } else {
            "gain"
        }
    }

    /// The weights that are hung, g.
    fn weights(&self) -> Vec<f64> {
        match (self.weights.is_empty(), self.iso376) {
            (false, _) => self.weights.clone(),
            (true, true) => iso376::WEIGHTS_G.to_vec(),
            (true, false) => WEIGHTS_G.to_vec(),
        }
    }

    fn options(&self, bench: &Bench, unit: u8) -> Options {
        let nominal = bench.rig.units.iter().find(|u| u.number == unit);
        let mut weights_g = WEIGHTS_G.to_vec();
        weights_g.extend(self.weights().iter().filter(|w| !WEIGHTS_G.contains(w)));
        Options {
            weights_g,
            nominal_n_per_code: nominal.map(|unit| unit.scale_n_per_count),
            left_out: self.leave_out.clone(),
            corrections_g: self.correct.iter().copied().collect(),
            ..self.standards.options()
        }
    }

    fn fit(&self, bench: &Bench, unit: u8, name: &str, text: &str) -> Result<Fitted> {
        Ok(weights::fit(name, text, &self.options(bench, unit))?)
    }

    /// Stores gains, writes their pictures and prints them.
    fn finish(
        &self,
        bench: &mut Bench,
        fitted: Vec<(u8, Fitted)>,
        drafted: bool,
        context: &Context,
    ) -> Result<Reply> {
        let before = bench.record.clone();
        if let Some(note) = self.standards.note() {
            context.output.note(note);
        }
        let gains: Vec<(u8, &Fit)> = fitted.iter().map(|(u, found)| (*u, &found.gain)).collect();
        // Gravity is the same for all units.
        if let Some((first, _)) = gains.first() {
            let options = self.options(bench, *first);
            if !self.replace {
                weights::check_changes(&bench.record, &gains, &options)?;
            }
            bench.record.valid_days = self.traced.valid_days();
            let found: Vec<(u8, &Fitted)> = fitted.iter().map(|(u, f)| (*u, f)).collect();
            for note in weights::apply(
                &mut bench.record,
                &found,
                &options,
                &self.traced.of_gains(&self.standards),
            )? {
                context.output.note(&note);
            }
        }
        let kept = bench.keep(context)?;
        let mut text = "unit      N per code    +- 95 %   to 12 N   readings   weights   gravity    beyond   linearity   hysteresis   change\n".to_owned();
        let mut rows = Vec::new();
        for (unit, found) in &fitted {
            let g = &found.gain;
            let old = before
                .units
                .iter()
                .find(|u| u.number == *unit)
                .map_or(f64::NAN, |u| u.n_per_code);
            let change = 100.0 * (g.n_per_code / old - 1.0);
            let hysteresis = found.shape.hysteresis.map(|h| 1e3 * h.largest_n);
            row!(
                text,
                "{unit:>4} {:>15.6e} {:>8.3} % {:>7.3} % {:>8.3} % {:>7.3} % {:>7.3} % {:>7.3} % {:>8.1} mN {:>9} mN {change:>+7.2} %",
                g.n_per_code,
                100.0 * g.within_half_95 / g.n_per_code.abs(),
                100.0 * g.n_per_code_half_95 / g.n_per_code.abs(),
                100.0 * g.relative_parts.readings,
                100.0 * g.relative_parts.weights,
                100.0 * g.relative_parts.gravity,
                100.0 * g.relative_parts.beyond,
                1e3 * found.shape.linearity_n,
                hysteresis.map_or_else(|| "-".to_owned(), |h| format!("{h:.1}")),
            );
            row!(
                text,
                "       repeatability {:.2} mN; chi-squared {:.1} with {} degrees of freedom",
                1e3 * g.repeatability_codes * g.n_per_code.abs(),
                g.chi_square,
                g.degrees_of_freedom
            );
            if g.relative_parts.remounting > 0.0 || g.relative_parts.pulley > 0.0 {
                row!(
                    text,
                    "       next mounting {:.3} %, pulley {:.3} %",
                    100.0 * g.relative_parts.remounting,
                    100.0 * g.relative_parts.pulley
                );
            }
            let kept_gain = bench.record.units.iter().find(|u| u.number == *unit);
            let kept_gain = kept_gain.and_then(|u| u.gain.as_ref());
            if let Some(figures) = &found.iso376 {
                describe_iso376(&mut text, figures);
            }
            if let Some(warm) = kept_gain.and_then(|gain| gain.temperature) {
                row!(text, "       {}", certificate::temperature(&warm));
            }
            let in_force = conversion_of(bench, *unit);
            describe_conversion(&mut text, g, &in_force);
            let of_mounting =
                |term: &Term| matches!(term, Term::MountingZero(_) | Term::MountingSlope(_));
            for (term, c) in g.terms.iter().filter(|(term, _)| !of_mounting(term)) {
                row!(
                    text,
                    "       {term:?}: {:.4e} +- {:.1e} (p {:.1e})",
                    c.value,
                    c.standard_error,
                    c.p
                );
            }
            if drafted {
                bench
                    .store
                    .draft(&format!("{}-unit{unit}", self.step()))
                    .finish(&kept.version)?;
            }
            let svg = residual_picture(*unit, found);
            let path = picture(
                &self.by_hand.out,
                &format!("calibrate-gain-unit{unit}.svg"),
                &svg,
            )?;
            context
                .output
                .note(&format!("residuals: {}", path.display()));
            rows.push(json!({"unit": unit, "n_per_code": g.n_per_code, "n_per_code_half_95": g.n_per_code_half_95, "within_half_95": g.within_half_95,
                "n_per_code2": g.conversion().n_per_code2,
                "curve_per_n": g.terms.get(&Term::Quadratic).map(|curve| curve.value / g.codes_per_n), "creep": g.creep.map(|c| c.share),
                "creep_s": g.creep.map(|c| c.time_s), "curve_on_board": in_force.curve.pays, "creep_on_board": in_force.creep.pays,
                "linearity_n": found.shape.linearity_n,
                "repeatability_n": g.repeatability_codes * g.n_per_code.abs(), "chi_square": g.chi_square, "degrees_of_freedom": g.degrees_of_freedom,
                "parts_relative": {"readings": g.relative_parts.readings, "weights": g.relative_parts.weights, "gravity": g.relative_parts.gravity, "beyond": g.relative_parts.beyond,
                    "remounting": g.relative_parts.remounting, "pulley": g.relative_parts.pulley},
                "iso376": kept_gain.and_then(|gain| gain.iso376.as_ref()), "temperature": kept_gain.and_then(|gain| gain.temperature),
                "hysteresis_n": found.shape.hysteresis.map(|h| h.largest_n), "readings": found.readings}));
        }
        if let Some(void) = checks::geometry_void(&bench.record) {
            row!(text, "{void}");
        }
        row!(text, "version {}", kept.version);
        Ok(Reply::new(
            text,
            json!({"version": kept.version, "gains": rows}),
        ))
    }
}

fn conversion_of(bench: &Bench, unit: u8) -> base::Conversion {
    let unit = bench.record.units.iter().find(|u| u.number == unit);
    base::conversion(unit.unwrap_or(&bench.record.units[0]))
}

/// The figures of ISO 376 with the class that results.
fn describe_iso376(text: &mut String, figures: &iso376::Figures) {
    match figures.class() {
        Some(found) => row!(
            text,
            "       ISO 376: class {} from {:.2} to {:.2} N",
            found.class,
            found.from_n,
            found.to_n
        ),
        None => row!(text, "       ISO 376: no class"),
    }
    let in_the_way = figures.in_the_way();
    if !in_the_way.is_empty() {
        row!(
            text,
            "       beyond the next better class: {}",
            in_the_way.join(", ")
        );
    }
    row!(
        text,
        "       f0 {:+.4} %   c {} %   resolution {:.2} mN",
        100.0 * figures.zero,
        figures
            .creep
            .map_or_else(|| "-".to_owned(), |c| format!("{:.4}", 100.0 * c)),
        1e3 * figures.resolution_n
    );
    row!(
        text,
        "       force, N        b %       b' %       fc %        v %    U force %        U %"
    );
    for load in &figures.loads {
        row!(
            text,
            "       {:>8.3} {:>10.4} {:>10.4} {:>+10.4} {:>10.4} {:>12.4} {:>10.4}",
            load.force_n,
            100.0 * load.reproducibility,
            100.0 * load.repeatability,
            100.0 * load.interpolation,
            100.0 * load.reversibility,
            100.0 * load.force_95,
            200.0 * load.u
        );
    }
}

/// What the board's conversion takes from a curve and creep that were found, and what it is worth.
fn describe_conversion(text: &mut String, gain: &Fit, found: &base::Conversion) {
    let mut line = |what: String, part: base::Correction| {
        let verdict = if part.pays {
            "the board corrects it"
        } else {
            "it does not pay, and the board does not correct it"
        };
        row!(
            text,
            "       {what}: up to {:.1} +- {:.1} mN; {verdict}",
            1e3 * part.worth_n,
            1e3 * part.sd_n
        );
    };
    if gain.terms.contains_key(&Term::Quadratic) {
        line("curve, against a straight scale".to_owned(), found.curve);
    }
    if let Some(creep) = gain.creep {
        let (low, high) = creep.time_95_s;
        let what = format!(
            "creep of {:.2} +- {:.2} % in {:.2} s (95 %: {low:.2} to {high:.2} s)",
            100.0 * creep.share,
            196.0 * creep.share_se,
            creep.time_s
        );
        line(what, found.creep);
    }
}

fn residual_picture(unit: u8, found: &Fitted) -> String {
    let rows: Vec<Bar> = found
        .gain
        .residuals
        .iter()
        .map(|r| Bar {
            label: format!("line {}: {:.3} N", r.at.line, r.force_n),
            value: 1e3 * r.residual_n,
            sd: 1e3 * r.sd_n,
        })
        .collect();
    let title = format!("unit {unit}: measured less fitted, on a band of two standard deviations");
    bars(&title, "mN", &rows).to_svg()
}
