//! `calibrate geometry`: exit points and axes from a digitizer.

use super::super::exit::{Failure, Reply, Result};
use super::super::Context;
use super::guide::{self, Answer};
use super::{picture, read, Bench, ByHand};
use calibrate::picture::{bars, Bar};
use calibrate::points;
use calibrate::standin::Digitizer;
use calibration::geometry::Survey;
use clap::Args;
use serde_json::json;
use session::link::fast::plant_of;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Arguments of `calibrate geometry`.
#[derive(Debug, Args)]
pub struct Geometry {
    /// Points (CSV: label, x_mm, y_mm, z_mm, station) instead of a guided session; `-`: standard
    /// input
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// Holes of the robot's base from the CAD model (CSV: label, x_mm, y_mm, z_mm)
    /// [default: those of the emulated rig]
    #[arg(long, value_name = "FILE")]
    base: Option<PathBuf>,
    /// Standard deviation of the digitizer in one coordinate, mm
    #[arg(long, value_name = "MM", default_value_t = 0.2)]
    digitizer_sd: f64,
    /// Standard deviation of the base holes about the CAD model, mm
    #[arg(long, value_name = "MM", default_value_t = 0.0)]
    hole_sd: f64,
    /// Times that each point is touched from each station in a guided session
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u8).range(1..=50))]
    touches: u8,
    /// Leave out a line of the points; repeatable
    #[arg(long, value_name = "LINE")]
    leave_out: Vec<usize>,
    /// Accept units that stand where another one was: they were exchanged
    #[arg(long)]
    replace: bool,
    #[command(flatten)]
    by_hand: ByHand,
}

/// No digitizer is better than this, mm: what is below it was given in another unit.
const LEAST_DIGITIZER_SD_MM: f64 = 0.02;

impl Geometry {
    /// Runs the command. It opens no link: the geometry needs no board.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        for (name, value, zero) in [
            ("--digitizer-sd", self.digitizer_sd, false),
            ("--hole-sd", self.hole_sd, true),
        ] {
            if !(value.is_finite() && (value > 0.0 || (zero && value == 0.0)) && value < 10.0) {
                return Err(Failure::usage(format!(
                    "{name} has to be above 0 and below 10 mm"
                )));
            }
        }
        if self.digitizer_sd < LEAST_DIGITIZER_SD_MM {
            return Err(Failure::usage(format!(
                    "--digitizer-sd {}: no digitizer is better than {LEAST_DIGITIZER_SD_MM} mm; is it in mm, not m?",
                    self.digitizer_sd
                ),
            ));
        }
        let connection = &self.by_hand.connection;
        let mut bench = Bench::tested(connection, context)?;
        let seed = connection.seed(&bench.rig);
        if self.points.is_none() {
            let file = ("--points", "touches the points of a real rig");
            self.by_hand.check(seed.is_some(), file)?;
        }
        let mut digitizer = seed.map(|seed| self.standin(seed)).transpose()?;
        let base = match (&self.base, &digitizer) {
            (Some(path), _) => read(path)?,
            (None, Some(digitizer)) => ("base holes of the emulated rig".to_owned(), digitizer.base_csv()),
            (None, None) => {
                return Err(Failure::usage("--base FILE is needed: the holes of the robot's base from the CAD model (label, x_mm, y_mm, z_mm)",
                ))
            }
        };
        let (name, text) = match &self.points {
            Some(path) => read(path)?,
            None => self.session(&bench, &base.1, &mut digitizer, context)?,
        };
        let text = if self.leave_out.is_empty() {
            text
        } else {
            points::without_lines(&name, &text, &self.leave_out)?
        };
        let survey = points::survey(
            (&name, &text),
            (&base.0, &base.1),
            &bench.rig,
            1e-3 * self.digitizer_sd,
            1e-3 * self.hole_sd,
        )?;
        if !self.replace {
            points::check_units(&bench.record, &survey)?;
        }
        let changes_m = points::changes_m(&bench.record, &survey);
        points::apply(&mut bench.record, &survey)?;
        let kept = bench.keep(context)?;
        if self.points.is_none() {
            bench.store.draft("geometry").finish(&kept.version)?;
        }
        let svg = self.residuals(&survey);
        let path = picture(&self.by_hand.out, "calibrate-geometry.svg", &svg)?;
        context
            .output
            .note(&format!("residuals: {}", path.display()));
        Ok(reply(&survey, &changes_m, &kept.version))
    }

    fn standin(&self, seed: u64) -> Result<Digitizer> {
        let plant = self.by_hand.connection.plant_file().map(plant_of);
        let plant = plant
            .transpose()
            .map_err(|e| Failure::usage(e.to_string()))?;
        let mut digitizer = Digitizer::new(seed, plant).map_err(Failure::usage)?;
        for mistake in &self.by_hand.inject {
            digitizer.inject(mistake);
        }
        Ok(digitizer)
    }

    /// Points by hand, or by the stand-in: file and text.
    fn session(
        &self,
        bench: &Bench,
        base: &str,
        digitizer: &mut Option<Digitizer>,
        context: &Context,
    ) -> Result<(String, String)> {
        let yes = self.by_hand.yes;
        let draft = bench.store.draft("geometry");
        if self.by_hand.restart || yes {
            draft.discard()?;
        }
        let reference =
            calibration::geometry::read_reference("base", base, 0.0).map_err(Failure::usage)?;
        let holes: Vec<String> = reference.holes_m.keys().cloned().collect();
        let units = bench.rig.units.iter().filter(|unit| unit.enabled);
        let units: Vec<u8> = units.map(|unit| unit.number).collect();
        let plan = points::plan(&holes, &units, usize::from(self.touches));
        let mut done = draft.rows()?;
        if done > 0 {
            context.output.note(&format!(
                "{done} of {} points are kept from before; going on (--restart begins anew)",
                plan.len()
            ));
        }
        loop {
            let Some((station, label)) = plan.get(done) else {
                if yes {
                    break;
                }
                // A point that was touched wrongly may be the last one.
                let prompt = format!(
                    "all {} points are there. Enter: compute; u: undo the last point; q: stop here",
                    plan.len()
                );
                match guide::ask_or(&prompt, Answer::Go(String::new()))? {
                    Answer::Go(_) => break,
                    Answer::Undo => {
                        draft.undo()?;
                        done = done.saturating_sub(1);
                        continue;
                    }
                    Answer::Quit => return Err(guide::broken_off(done, plan.len(), "points")),
                }
            };
            let typed = match digitizer {
                Some(digitizer) if yes => digitizer.touch(station, label),
                _ => None,
            };
            let typed = match typed {
                Some(typed) => typed,
                None => {
                    let prompt = format!(
                        "station {station}, point {} of {}: touch {label} and send x y z in mm (u: undo the last point, q: stop here)",
                        done + 1,
                        plan.len()
                    );
                    match guide::ask(&prompt)? {
                        Answer::Undo => {
                            draft.undo()?;
                            done = done.saturating_sub(1);
                            continue;
                        }
                        Answer::Quit => return Err(guide::broken_off(done, plan.len(), "points")),
                        // On an emulated rig a bare Enter lets the stand-in touch the point.
                        Answer::Go(text) if text.is_empty() => digitizer
                            .as_mut()
                            .and_then(|digitizer| digitizer.touch(station, label))
                            .unwrap_or_default(),
                        Answer::Go(text) => text,
                    }
                }
            };
            match points::row(&typed, label, station) {
                Ok(row) => {
                    draft.add(points::HEADER, &row)?;
                    done += 1;
                }
                Err(why) => context.output.error(&why),
            }
        }
        let text = draft.text()?.unwrap_or_default();
        Ok((draft.path().display().to_string(), text))
    }

    /// Length of the mean residual of each point from each station.
    fn residuals(&self, survey: &Survey) -> String {
        let mut groups: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
        for r in &survey.residuals {
            groups
                .entry((r.station.clone(), r.label.to_string()))
                .or_default()
                .push(1e3 * r.residual_m.norm());
        }
        let rows: Vec<Bar> = groups
            .into_iter()
            .map(|((station, label), sizes)| {
                let count = sizes.len() as f64;
                Bar {
                    label: format!("{station}: {label}"),
                    value: (sizes.iter().map(|s| s * s).sum::<f64>() / count).sqrt(),
                    sd: 3f64.sqrt() * self.digitizer_sd,
                }
            })
            .collect();
        bars(
            "RMS distance of the touches from the fitted point",
            "mm",
            &rows,
        )
        .to_svg()
    }
}

/// `changes_m`: how far each exit point is from that of the calibration before, m.
fn reply(survey: &Survey, changes_m: &[(u8, f64)], version: &str) -> Reply {
    let mut text = "unit         exit point, mm (+- one standard deviation)         axis, +- deg    chain less joint, mm    from before, mm\n".to_owned();
    let mut rows = Vec::new();
    for unit in &survey.units {
        let covariance = unit.exit_covariance_m2();
        let at = |i: usize| {
            format!(
                "{:>9.2} +- {:.2}",
                1e3 * unit.exit_m[i],
                1e3 * covariance[(i, i)].max(0.0).sqrt()
            )
        };
        let chain = survey.chain.as_ref().ok().and_then(|units| {
            units
                .iter()
                .find(|c| c.unit == unit.unit)
                .map(|c| 1e3 * (c.exit_m - unit.exit_m).norm())
        });
        let from_before = changes_m.iter().find(|(number, _)| *number == unit.unit);
        let from_before = from_before.map(|(_, change_m)| 1e3 * change_m);
        row!(
            text,
            "{:>4} {} {} {} {:>13.2} {:>20} {:>18}",
            unit.unit,
            at(0),
            at(1),
            at(2),
            unit.axis_sd_rad().to_degrees(),
            chain.map_or_else(|| "no chain".to_owned(), |d| format!("{d:.2}")),
            from_before.map_or_else(|| "-".to_owned(), |d| format!("{d:.2}"))
        );
        rows.push(json!({"unit": unit.unit, "exit_m": unit.exit_m.as_slice(), "axis": unit.axis.as_slice(),
            "exit_sd_m": unit.exit_sd_m(), "axis_sd_deg": unit.axis_sd_rad().to_degrees(), "chain_less_joint_mm": chain, "from_before_mm": from_before}));
    }
    row!(
        text,
        "the points show a digitizer of {:.3} mm ({} residuals, p {:.2}); version {version}",
        1e3 * survey.sd_estimate_m,
        survey.degrees_of_freedom,
        survey.p
    );
    if let Err(why) = &survey.chain {
        row!(text, "the chain of the thesis can't be followed: {why}");
    }
    Reply::new(
        text,
        json!({"version": version, "units": rows, "digitizer_sd_m": survey.sd_estimate_m, "p": survey.p}),
    )
}
