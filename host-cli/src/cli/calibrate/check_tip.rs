//! `calibrate check --at tip`: one known weight on a tip that the cables alone carry.

use super::super::exit::{Failure, Result};
use super::super::watch::Watch;
use super::super::Context;
use super::check::Check;
use super::guide::{self, Answer};
use super::{Bench, Reply};
use calibrate::floating::{self, Floating};
use calibrate::moving::Collector;
use calibrate::standin::Weights;
use calibration::gain::Options as Standard;
use emulator_link::Injection;
use known::checks::Check as Checked;
use known::uncertainty;
use nalgebra::Vector3;
use run::Options;
use serde_json::json;
use session::link::RigLink;
use std::fmt::Write as _;
use wire::UNITS;

/// What the user is told when the tip is to be let go.
const LET_GO: &str = "now lower the stand, steady the weight, and keep your hands off";

/// Coverage factor of 95 % in one direction.
const COVERAGE: f64 = 2.0;

impl Check {
    /// Holds the weight by the cables, lets go of the tip, and compares.
    pub(super) fn tip(
        &self,
        bench: &Bench,
        options: &Standard,
        context: &Context,
    ) -> Result<Reply> {
        let least_s = floating::LET_GO_S + 2.0 * floating::READ_S;
        if self.duration < least_s {
            return Err(Failure::usage(format!(
                "--duration {}: the tip is let go after {:.0} s, has to come to rest, and is read over the last {:.0} s; give at least {least_s:.0} s",
                self.duration,
                floating::LET_GO_S,
                floating::READ_S
            )));
        }
        let mut rig = bench.calibrated();
        rig.pose_sd_m = self.pose_sd.map_or(rig.pose_sd_m, |mm| 1e-3 * mm);
        let force_n = options.force_n(self.weight);
        let commanded_n = Vector3::z() * (floating::COMMANDED * force_n);
        rig.check_force(Vector3::z() * force_n)
            .map_err(Failure::usage)?;
        let open = rig.with_open_loops();
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.connection.open(&open, context)?;
        let hung = self.hangs(link.as_mut())?;
        let mut watch = Watch::new(&context.output);
        let run_options = Options {
            robot_moves: false,
            injections: hung.map_or_else(Vec::new, |n| {
                vec![(floating::LET_GO_S, Injection::HangOnTip(n))]
            }),
            zeroing: self.connection.zeroing(),
            loaded: true,
            stop: context.interrupt.flag(),
            ..Options::new(commanded_n, self.duration)
        };
        let mut collector = Collector::new(&open, &mut watch);
        collector.notice = hung.is_none().then_some((floating::LET_GO_S, LET_GO));
        let outcome = run::set_force(link.as_mut(), &open, &run_options, &mut collector);
        let samples = std::mem::take(&mut collector.samples);
        drop(collector);
        watch.progress.done();
        let outcome = outcome?;
        let found = floating::at_rest(&rig, force_n, &outcome.steps, &samples)?;
        context.output.note(
            "take the weight off the cables: while it hangs there, a cable that stays tight at 0 V is fault 15 to the board; then \
             `forcectl clear`",
        );
        self.judge_tip(bench, &rig, options, &found, context)
    }

    /// What the stand-in hangs on the tip, N. On a real rig the user gets the ring ready; `None`.
    fn hangs(&self, link: &mut dyn RigLink) -> Result<Option<f64>> {
        let seed = link.controls().map(|controls| controls.seed());
        if seed.is_none() && (self.yes || !self.inject.is_empty()) {
            return Err(Failure::usage(
                "--yes and --inject work with an emulated rig only: nobody hangs the weight here",
            ));
        }
        let prompt = format!(
            "put the ring of the cables on a stand at the tip's place, off the robot, and hang {} g on it (q: stop)",
            self.weight
        );
        if !self.yes && guide::ask(&prompt)? == Answer::Quit {
            return Err(guide::broken_off(0, 1, "checks"));
        }
        Ok(seed.map(|seed| Weights::new(seed, &self.inject).force_n(self.weight)))
    }

    fn judge_tip(
        &self,
        bench: &Bench,
        rig: &rig::Rig,
        options: &Standard,
        found: &Floating,
        context: &Context,
    ) -> Result<Reply> {
        let stated = uncertainty::of_tensions(
            &bench.record,
            &found.tip_m,
            &found.tension_n,
            &[true; UNITS],
            rig.pose_sd_m.hypot(found.stretch_sd_m),
        )
        .ok_or_else(|| {
            Failure::usage("a cable stands across its cell: the force has no uncertainty there")
        })?;
        let weight_n = options.force_n(self.weight);
        let off_n = found.force_n - Vector3::z() * weight_n;
        let of_weight_n = COVERAGE * weight_n * options.force_relative_sd(self.weight);
        let parts_n = [stated.radius_95_n, of_weight_n, found.drift_n];
        let today = known::today();
        let checked = Checked {
            date: today.clone(),
            unit: None,
            weight_g: self.weight,
            force_n: weight_n,
            measured_n: weight_n + off_n.norm().copysign(off_n.z),
            uncertainty_95_n: parts_n.iter().map(|p| p * p).sum::<f64>().sqrt(),
            calibration: bench.record.tip_hash(),
        };
        bench.store.add_checks(std::slice::from_ref(&checked))?;
        let mut text = String::new();
        let (f, w) = (found.force_n, 1e3 * found.went_m);
        row!(
            text,
            "weight               {:>8.3} {:>8.3} {weight_n:>8.3} N up",
            0.0,
            0.0
        );
        row!(
            text,
            "by the cells         {:>8.3} {:>8.3} {:>8.3} N",
            f.x,
            f.y,
            f.z
        );
        row!(
            text,
            "off                  {:>8.1} {:>8.1} {:>8.1} mN: {:.1} mN, stated 95 % {:.1} mN, En {:.2}",
            1e3 * off_n.x,
            1e3 * off_n.y,
            1e3 * off_n.z,
            1e3 * off_n.norm(),
            1e3 * checked.uncertainty_95_n,
            checked.en().abs()
        );
        row!(
            text,
            "the tip went         {:>8.1} {:>8.1} {:>8.1} mm when it was let go; cable lengths fit to {:.2} mm; before, the cables pulled up with {:.2} N",
            w.x,
            w.y,
            w.z,
            1e3 * found.lengths_rms_m,
            found.before_n.z
        );
        row!(
            text,
            "parts of 95 %, mN    calibration and pose {:.1}, weight {:.1}, drift {:.1}",
            1e3 * parts_n[0],
            1e3 * parts_n[1],
            1e3 * parts_n[2]
        );
        for missing in &stated.nominal {
            row!(text, "not measured, nominal: {missing}");
        }
        let holds = checked.passes();
        row!(
            text,
            "{}",
            if holds {
                "the calibration holds (En of at most 1)"
            } else {
                "the calibration DOES NOT HOLD: is it the right weight with ring and cord, and the pose of the tip the right one? `forcectl calibrate check` tells the cells from the geometry"
            }
        );
        let rows = [
            json!({"unit": null, "force_n": weight_n, "measured_n": f.as_slice(), "off_n": off_n.as_slice(),
            "uncertainty_95_n": checked.uncertainty_95_n, "en": checked.en(), "went_m": found.went_m.as_slice(),
            "lengths_rms_m": found.lengths_rms_m, "holds": holds}),
        ];
        self.with_history(bench, text, &rows, holds, &today, context)
    }
}
