//! `calibrate self` and `calibrate verify`: what a run with the robot moving says of the
//! calibration.

use super::super::connection::Connection;
use super::super::exit::{self, Failure, Reply, Result};
use super::super::values;
use super::super::watch::Watch;
use super::super::Context;
use super::{picture, Bench};
use calibrate::frame::{self, Explanation};
use calibrate::moving::{self, Collector, LengthVerdict, Run};
use calibrate::picture::{bars, Bar};
use calibration::self_calibration::{MovedVerdict, Prior, Sample};
use clap::Args;
use force::metrics::{Step, STEADY_AFTER_S};
use known::uncertainty::ForceUncertainty;
use known::ZeroStore;
use nalgebra::Vector3;
use rig::Rig;
use run::{Options, Outcome, Zeroing};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Arguments of `calibrate self`.
#[derive(Debug, Args)]
pub struct Moving {
    /// Time for which the robot moves while the cables hold zero force
    #[arg(long, value_name = "SECONDS", default_value = "100", value_parser = values::seconds)]
    duration: f64,
    /// Standard deviation of a coordinate of the robot's tip, mm
    #[arg(long, value_name = "MM", default_value_t = 0.2)]
    tip_sd: f64,
    /// Join the run with the stored exit points, and store the result
    #[arg(long)]
    store: bool,
    /// Standard deviation in every direction that the advice on the motion aims at, mm
    #[arg(long, value_name = "MM", default_value_t = 2.0)]
    aim: f64,
    /// Folder for the picture of the residuals
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

impl Moving {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        if !(self.tip_sd.is_finite() && (0.0..100.0).contains(&self.tip_sd)) {
            return Err(Failure::usage("--tip-sd has to be 0 to 100 mm"));
        }
        if !(self.aim.is_finite() && (0.01..=100.0).contains(&self.aim)) {
            return Err(Failure::usage("--aim has to be 0.01 to 100 mm"));
        }
        let mut bench = Bench::tested(&self.connection, context)?;
        let rig = bench.calibrated();
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut watch = Watch::new(&context.output);
        let options = Options {
            zeroing: self.connection.zeroing(),
            stop: context.interrupt.flag(),
            ..Options::new([0.0; 3], self.duration)
        };
        let mut collector = Collector::new(&rig, &mut watch);
        let outcome = run::set_force(link.as_mut(), &rig, &options, &mut collector);
        let samples = std::mem::take(&mut collector.samples);
        drop(collector);
        watch.progress.done();
        outcome?;
        let prior = Prior {
            tip_sd_m: 1e-3 * self.tip_sd,
            ..Prior::default()
        };
        let found = moving::evaluate(&samples, &bench.record, &prior)?;
        let mut text = table(&bench, &found);
        let advice = self.advice(&samples, &found);
        row!(text, "{advice}");
        let svg = residual_bars(&moving::residuals(&samples, &found, &prior));
        let path = picture(&self.out, "calibrate-self.svg", &svg)?;
        context
            .output
            .note(&format!("residuals: {}", path.display()));
        let unmoved = found.moved.verdict == MovedVerdict::Unmoved;
        // What a run does not tell it can't tell to be unmoved; what it shows to be moved is.
        let told = !unmoved || found.untold().is_empty();
        let mut version = None;
        if self.store && !unmoved {
            return Err(Failure::new(
                exit::DEGRADED,
                "the rig was moved since its calibration: a run can't be joined with exit points that hold no more; `forcectl calibrate geometry` first. Nothing was stored",
            )
            .with_reply(Reply::new(text, json!({"moved": true}))));
        }
        if self.store && told {
            moving::apply(&mut bench.record, &found);
            let kept = bench.keep(context)?;
            row!(
                text,
                "joined with the stored exit points: version {}",
                kept.version
            );
            version = Some(kept.version);
        }
        let units: Vec<_> = found
            .units
            .iter()
            .map(|u| json!({"unit": u.unit, "exit_m": u.alone.exit_m.as_slice(), "exit_sd_m": u.alone.covariance_m2.trace().sqrt(),
                "unobserved": u.alone.unobserved().len()}))
            .collect();
        if self.store && !told {
            row!(text, "nothing was stored");
        }
        let json = json!({"units": units, "moved": told.then_some(!unmoved), "moved_p": found.moved.p, "untold": found.untold(),
            "version": version, "advice": advice});
        let code = if told { exit::DONE } else { exit::DEGRADED };
        Ok(Reply::new(text, json).with_code(code))
    }

    /// Which motion would tell all exit points as well as `--aim` says.
    fn advice(&self, samples: &[Vec<Sample>; wire::UNITS], found: &Run) -> String {
        let Some((middle, least_m)) = moving::motion(samples) else {
            return String::new();
        };
        let of = |u: &moving::UnitRun| (u.unit, u.alone.needs(1e-3 * self.aim, &middle));
        let worst = found
            .units
            .iter()
            .map(of)
            .max_by(|a, b| a.1.longer.total_cmp(&b.1.longer));
        let Some((unit, needs)) = worst else {
            return String::new();
        };
        if needs.longer <= 1.0 {
            return format!("this run alone tells every exit point to {} mm", self.aim);
        }
        let where_ = if needs.along_cable > 0.7 {
            "along its cable, which only motion across the cable tells"
        } else {
            "across its cable"
        };
        format!(
            "for {} mm in every direction: {:.1} times the motion in all directions (standard deviation {:.0} mm instead of {:.0} mm), or {:.0} times as long ({:.0} s) with this motion; unit {unit} is known worst, {where_}",
            self.aim,
            needs.further,
            1e3 * least_m * needs.further,
            1e3 * least_m,
            needs.longer,
            needs.longer * self.duration
        )
    }
}

fn residual_bars(parts: &[moving::Part]) -> String {
    let rows: Vec<Bar> = parts
        .iter()
        .map(|part| Bar {
            label: format!("unit {}, tip at {}", part.unit, part.side),
            value: 1e3 * part.residual_m,
            sd: 1e3 * part.sd_m,
        })
        .collect();
    bars(
        "cable length predicted less measured, by the side of the motion",
        "mm",
        &rows,
    )
    .to_svg()
}

fn table(bench: &Bench, found: &Run) -> String {
    let mut text =
        "unit   exit point alone, mm                +-   from stored   joined +-   not observed\n"
            .to_owned();
    for u in &found.units {
        let unit = bench.record.units.iter().find(|r| r.number == u.unit);
        let stored = unit.map_or_else(Vector3::zeros, |r| r.exit_m.into());
        let at = u.alone.exit_m * 1e3;
        let joined = u.joined.map_or(f64::NAN, |(_, c)| 1e3 * c.trace().sqrt());
        let open: Vec<String> = u
            .alone
            .unobserved()
            .iter()
            .map(|d| {
                format!(
                    "along ({:+.2} {:+.2} {:+.2}) by {:.1} mm",
                    d.direction.x,
                    d.direction.y,
                    d.direction.z,
                    1e3 * d.sd_m
                )
            })
            .collect();
        row!(
            text,
            "{:>4} {:>9.1} {:>9.1} {:>9.1} {:>9.2} {:>13.2} {:>11.2}   {}",
            u.unit,
            at.x,
            at.y,
            at.z,
            1e3 * u.alone.covariance_m2.trace().sqrt(),
            1e3 * (u.alone.exit_m - stored).norm(),
            joined,
            if open.is_empty() {
                "-".to_owned()
            } else {
                open.join(", ")
            }
        );
    }
    for (unit, why) in &found.not {
        row!(text, "{unit:>4}   {why}");
    }
    let list = |units: &[u8]| {
        units
            .iter()
            .map(u8::to_string)
            .collect::<Vec<_>>()
            .join(", ")
    };
    let untold = found.untold();
    let verdict = match &found.moved.verdict {
        MovedVerdict::Unmoved if !untold.is_empty() => {
            row!(
                text,
                "this run does not tell whether the rig was moved: of unit {} it does not know two directions of the exit point \
                 to {:.0} mm; see the motion or the time below",
                list(&untold),
                1e3 * moving::TOLD_SD_M
            );
            return text;
        }
        MovedVerdict::Unmoved => "the rig stands where its calibration says, but for the directions that are not observed".to_owned(),
        MovedVerdict::Units(units) => format!(
            "MOVED since the calibration: unit {}; calibrate geometry again",
            list(units)
        ),
        MovedVerdict::Body { translation_m, rotation_rad } => format!(
            "MOVED since the calibration: all units as one body (or the robot) by {:.1} mm and {:.2} degrees; calibrate geometry again",
            1e3 * translation_m.norm(),
            rotation_rad.norm().to_degrees()
        ),
    };
    row!(text, "{verdict} (p {:.3})", found.moved.p);
    text
}

/// Arguments of `calibrate verify`.
#[derive(Debug, Args)]
pub struct Verify {
    /// Size of the forces along +x, -x, +y, -y, +z, -z, N
    #[arg(long, value_name = "N", default_value = "2.5", allow_negative_numbers = true, value_parser = values::force_size)]
    force: f64,
    /// Time for which each is held
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = values::seconds)]
    duration: f64,
    /// Standard deviation of a coordinate of the robot's tip, mm
    /// [default: position_sd_mm of `[pose]` in the rig file, else what is usual for its source]
    #[arg(long, value_name = "MM", value_parser = values::pose_sd_mm)]
    pose_sd: Option<f64>,
    /// Folder for the picture
    #[arg(long, value_name = "DIR", default_value = "forcectl-out")]
    out: PathBuf,
    #[command(flatten)]
    connection: Connection,
}

/// A force that was held.
struct Held {
    commanded_n: Vector3<f64>,
    outcome: Outcome,
}

/// A single cycle against the stated radii of one force.
struct Cycles {
    /// Radius about the commanded force, N, and part of the cycles in which the true force lies
    /// within (emulated rig).
    instant_95_n: f64,
    instants_within: Option<f64>,
    /// The same about the estimate of the load cells.
    estimate_95_n: f64,
    estimates_within: Option<f64>,
}

impl Cycles {
    fn of(stated: &ForceUncertainty, steady: &[&Step]) -> Self {
        let part = |within: &dyn Fn(&Step, Vector3<f64>) -> bool| {
            let all: Option<Vec<bool>> = steady
                .iter()
                .map(|step| Some(within(step, step.applied_n?)))
                .collect();
            all.map(|all| all.iter().filter(|held| **held).count() as f64 / all.len() as f64)
        };
        Self {
            instant_95_n: stated.instant_95_n,
            instants_within: part(&|step, truth| {
                (truth - step.commanded_n).norm() <= stated.instant_95_n
            }),
            estimate_95_n: stated.estimate_95_n,
            estimates_within: part(&|step, truth| {
                (truth - step.estimated_n).norm() <= stated.estimate_95_n
            }),
        }
    }
}

fn cycles_lines(text: &mut String, cycles: &[Cycles]) {
    if cycles.is_empty() {
        return;
    }
    let count = cycles.len() as f64;
    row!(
        text,
        "\na single cycle, mean over the forces: within 95 %, N   true force within"
    );
    let mut line = |what: &str, radius_n: f64, within: Option<f64>| {
        row!(
            text,
            "  {what:<42} {radius_n:>8.3}   {:>17}",
            within.map_or_else(
                || "not known".to_owned(),
                |part| format!("{:.1} %", 100.0 * part)
            )
        );
    };
    let mean = |of: fn(&Cycles) -> Option<f64>| {
        let all: Option<Vec<f64>> = cycles.iter().map(of).collect();
        all.map(|all| all.iter().sum::<f64>() / count)
    };
    let radius = |of: fn(&Cycles) -> f64| cycles.iter().map(of).sum::<f64>() / count;
    line(
        "any instant, of the commanded force",
        radius(|c| c.instant_95_n),
        mean(|c| c.instants_within),
    );
    line(
        "the cells, of their estimate in the cycle",
        radius(|c| c.estimate_95_n),
        mean(|c| c.estimates_within),
    );
}

/// Cable lengths by the encoders against the geometry: a real rig has no other truth.
fn length_lines(text: &mut String, lengths: &[LengthVerdict], frames: &[Explanation]) {
    if lengths.is_empty() {
        return;
    }
    row!(
        text,
        "\ncable length against the encoders while the robot moved, RMS, mm"
    );
    let cells: Vec<String> = (lengths.iter())
        .map(|l| format!("{}: {:.3}", l.unit, 1e3 * l.rms_m))
        .collect();
    row!(text, "  unit {}", cells.join("  "));
    for l in lengths {
        if l.disagrees() {
            row!(
                text,
                "  unit {}: DISAGREES, {:.1} mm where {:.1} are permitted: exit point, frame of the poses, sign or size of \
                 travel_m_per_count, or the cable is another unit's; the forces above do not show it",
                l.unit,
                1e3 * l.rms_m,
                1e3 * l.limit_m.unwrap_or_default()
            );
        }
    }
    for (n, found) in frames.iter().enumerate() {
        row!(
            text,
            "  {}: {} in the rig file makes all lengths agree, to {:.1} mm",
            if n == 0 { "what fits" } else { "or" },
            found.words,
            1e3 * found.rms_m
        );
    }
    if lengths.iter().all(|l| l.limit_m.is_none()) {
        row!(
            text,
            "  not judged: the tip moved less than 5 mm; let the robot move"
        );
    }
}

impl Verify {
    /// Runs the command.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        let least_s = STEADY_AFTER_S + 1.0;
        if self.duration < least_s {
            return Err(Failure::usage(format!(
                    "--duration {}: the first {STEADY_AFTER_S:.0} s of each force are left out until it is steady; give at least {least_s:.0} s",
                    self.duration
                ),
            ));
        }
        let bench = Bench::tested(&self.connection, context)?;
        let stored = bench.store.current()?.is_some();
        let mut rig = bench.calibrated();
        rig.pose_sd_m = self.pose_sd.map_or(rig.pose_sd_m, |mm| 1e-3 * mm);
        rig.check_force(Vector3::new(self.force, 0.0, 0.0))
            .map_err(Failure::usage)?;
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&rig, context)?;
        let mut watch = Watch::new(&context.output);
        let mut zeroing = self.connection.zeroing();
        let mut held = Vec::new();
        let mut lengths = None;
        for direction in 0..6 {
            let mut commanded_n = Vector3::zeros();
            commanded_n[direction / 2] = if direction % 2 == 0 {
                self.force
            } else {
                -self.force
            };
            let options = Options {
                zeroing: zeroing.clone(),
                stop: context.interrupt.flag(),
                ..Options::new(commanded_n, self.duration)
            };
            let mut collector = Collector::new(&rig, &mut watch);
            let outcome = run::set_force(link.as_mut(), &rig, &options, &mut collector);
            let samples = std::mem::take(&mut collector.samples);
            drop(collector);
            let outcome = match outcome {
                Ok(outcome) => outcome,
                Err(error) => {
                    watch.progress.done();
                    return Err(error.into());
                }
            };
            held.push(Held {
                commanded_n,
                outcome,
            });
            lengths.get_or_insert(samples);
            // Friction keeps force in the cables after a run: a zero taken now would be wrong.
            if zeroing == Zeroing::Measure {
                zeroing = Zeroing::Keep(ZeroStore::none());
            }
        }
        watch.progress.done();
        self.reply((&rig, stored), &held, lengths.as_ref(), context)
    }

    /// `stored`: whether the rig has a stored calibration.
    fn reply(
        &self,
        (rig, stored): (&Rig, bool),
        held: &[Held],
        samples: Option<&[Vec<calibration::self_calibration::Sample>; wire::UNITS]>,
        context: &Context,
    ) -> Result<Reply> {
        let mut text = "commanded, N          held, N (by load cells)      off, N    stated 95 %, N   true force off, N   (means of the run)\n".to_owned();
        let mut rows = Vec::new();
        let mut picture_rows = Vec::new();
        let mut outside = 0;
        let mut cycles = Vec::new();
        for h in held {
            let Some(metrics) = &h.outcome.metrics else {
                continue;
            };
            let steady: Vec<_> = h
                .outcome
                .steps
                .iter()
                .filter(|s| s.t_s >= STEADY_AFTER_S)
                .collect();
            let count = steady.len() as f64;
            let measured = steady.iter().map(|s| s.estimated_n).sum::<Vector3<f64>>() / count;
            let off = (measured - h.commanded_n).norm();
            let stated = h.outcome.uncertainty.as_ref().map(|u| u.radius_95_n);
            // The truth is the plant's; what is compared with it is what the load cells said at the
            // same time.
            let truth = metrics
                .from_truth
                .then(|| (metrics.applied_n - measured).norm());
            let beyond = matches!((truth, stated), (Some(truth), Some(stated)) if truth > stated);
            outside += usize::from(beyond);
            let c = h.commanded_n;
            row!(
                text,
                "{:>5.1} {:>5.1} {:>5.1}   {:>8.3} {:>8.3} {:>8.3} {off:>10.3} {:>16} {:>15}{}",
                c.x,
                c.y,
                c.z,
                measured.x,
                measured.y,
                measured.z,
                stated.map_or_else(|| "not known".to_owned(), |s| format!("{s:.3}")),
                truth.map_or_else(|| "not known".to_owned(), |t| format!("{t:.3}")),
                if beyond { "  outside" } else { "" }
            );
            for (axis, name) in ["x", "y", "z"].iter().enumerate() {
                picture_rows.push(Bar {
                    label: format!("({} {} {}) {name}", c.x, c.y, c.z),
                    value: measured[axis] - c[axis],
                    sd: stated.map_or(0.1, |s| s / 2.8),
                });
            }
            let uncertainty = h.outcome.uncertainty.as_ref();
            let single = uncertainty.map(|u| Cycles::of(u, &steady));
            rows.push(json!({"commanded_n": c.as_slice(), "measured_n": measured.as_slice(), "stated_95_n": stated, "true_off_n": truth,
                "instant_95_n": uncertainty.map(|u| u.instant_95_n), "estimate_95_n": uncertainty.map(|u| u.estimate_95_n),
                "instants_within": single.as_ref().and_then(|s| s.instants_within),
                "estimates_within": single.as_ref().and_then(|s| s.estimates_within)}));
            cycles.extend(single);
        }
        cycles_lines(&mut text, &cycles);
        let lengths: Vec<LengthVerdict> = samples.map_or_else(Vec::new, |samples| {
            (rig.units.iter().zip(samples))
                .filter_map(|(unit, samples)| {
                    moving::judge_length(unit.number, samples, &unit.exit_m, rig.pose_sd_m)
                })
                .collect()
        });
        let wrong = lengths.iter().any(LengthVerdict::disagrees);
        let exits_m = rig.units.each_ref().map(|unit| unit.exit_m);
        let frames = match samples {
            Some(samples) if wrong => frame::explain(samples, &exits_m, rig.pose_sd_m),
            _ => Vec::new(),
        };
        length_lines(&mut text, &lengths, &frames);
        if !stored {
            row!(
                text,
                "no calibration of this rig is stored: what the table can't state is not known"
            );
        }
        let svg = bars(
            "force by load cells less commanded, on the stated uncertainty",
            "N",
            &picture_rows,
        )
        .to_svg();
        let path = picture(&self.out, "calibrate-verify.svg", &svg)?;
        context.output.note(&format!("picture: {}", path.display()));
        let lengths: Vec<_> = (lengths.iter())
            .map(|l| json!({"unit": l.unit, "rms_mm": 1e3 * l.rms_m, "limit_mm": l.limit_m.map(|m| 1e3 * m)}))
            .collect();
        let reply = Reply::new(
            text,
            json!({"forces": rows, "outside": outside, "lengths": lengths, "lengths_agree": !wrong,
                "frames": frames.iter().map(|f| json!({"words": f.words, "rms_mm": 1e3 * f.rms_m})).collect::<Vec<_>>()}),
        );
        // One of six may lie outside of 95 % by chance in a quarter of the runs; two hardly.
        Ok(if outside > 1 || wrong {
            reply.with_code(exit::DEGRADED)
        } else {
            reply
        })
    }
}
