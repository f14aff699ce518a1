//! The sections of a report.

use super::document::Part;
use super::plot::Plot;
use super::words::{behind, first_of, joined, readable, titled};
use super::{DeclaredTerm, Effect, Figures, ModelTest, Report, Rival, Verdict};
use residual_columns::format::{num, p_value, percent, positive_zero, with_interval};
use residual_effects::EffectKind;
use residual_evidence::by_log::LogError;

/// Heading of the section on structure that no effect explains.
pub(super) const UNEXPLAINED: &str = "Unexplained structure";

/// Heading of the section on flaws of the data.
pub(super) const CHECKS: &str = "Checks of the data";

/// Logs in the table of their errors, which fits on a page; `report.json` has all.
const LOGS_SHOWN: usize = 20;

impl Report {
    /// Which data were analysed.
    pub(super) fn data(&self) -> String {
        let folds = if self.folds == self.files {
            "each file".into()
        } else if self.folds.iter().map(|f| f.len() + 2).sum::<usize>() < 160 {
            self.folds.join(", ")
        } else {
            format!("{} groups in {} folds", self.groups, self.folds.len())
        };
        format!(
            "{} rows in {} sequences from {} file(s): {}. Held out in turn: {folds}.",
            self.rows,
            self.sequences,
            self.files.len(),
            first_of(&self.files, 4)
        )
    }

    /// How to read the rest, for this verdict.
    pub(super) fn guidance(&self) -> String {
        match self.verdict {
            Verdict::None => format!(
                "No effect of the catalogue that these data can show reduces the held-out RMSE significantly by {} or more.",
                self.material()
            ),
            Verdict::Unknown if self.effects.is_empty() && self.limited.is_some() => {
                "The search was not allowed to name what is left: `selection.max_effects` ended it. The errors below are those of the model as it stands.".into()
            }
            Verdict::Unknown if self.effects.is_empty() => {
                format!("No effect of the catalogue is named. See \"{UNEXPLAINED}\".")
            }
            Verdict::Unknown => format!(
                "The effects below are not findings. They describe part of a structure that the catalogue does not contain: \
                 do not use their names or their values.{} See \"{UNEXPLAINED}\".",
                self.holding()
            ),
            Verdict::NotIdentifiable => {
                "The section \"Not distinguishable\" names the experiments that would distinguish the effects.".into()
            }
            Verdict::Effect | Verdict::Several => {
                "Each effect was compared with every other effect of the catalogue in its place; the best of them is its nearest rival. \
                 Friction coefficients multiply the velocity or its sign. Friction that opposes the motion is negative where the \
                 target is the force on the load, as a load cell measures it. It is positive where the target is what the drive \
                 supplies: a motor current, a drive torque, an actuator force.".into()
            }
        }
    }

    /// Errors of the declared model, after each effect in turn, and of the final model.
    pub(super) fn errors(&self) -> Vec<Part> {
        let full = |name: String, f: &Figures| {
            let (rmse, rmse_ci) = with_interval(f.heldout_rmse, f.heldout_rmse_ci);
            let (mae, mae_ci) = with_interval(f.heldout_mae, f.heldout_mae_ci);
            vec![
                name,
                format!("{rmse} ({rmse_ci})"),
                format!("{mae} ({mae_ci})"),
                num(f.insample_rmse),
            ]
        };
        let mut rows = vec![full("declared".into(), &self.baseline)];
        for (i, e) in self.effects.iter().enumerate() {
            let name = format!("{} {}", if i == 0 { "with" } else { "and" }, self.called(e));
            rows.push(if i + 1 == self.effects.len() {
                full(name, &self.last)
            } else {
                vec![name, num(e.heldout_after), String::new(), String::new()]
            });
        }
        if let Some(all) = &self.with_all {
            rows.push(full(self.with_all_words().into(), all));
        }
        vec![
            Part::Heading("Error before and after".into()),
            Part::table(
                &[
                    "model",
                    &titled("held-out RMSE", &self.unit),
                    &titled("held-out MAE", &self.unit),
                    &titled("in-sample RMSE", &self.unit),
                ],
                rows,
            ),
        ]
        .into_iter()
        .chain(self.only_beside_others().map(Part::Text))
        .chain([Part::Text(self.held_out())])
        .chain(self.each_log())
        .chain(self.check())
        .collect()
    }

    /// The held-out error of each log, those with the largest first.
    fn each_log(&self) -> Vec<Part> {
        let mut logs: Vec<&LogError> = self.by_log.iter().collect();
        if logs.is_empty() {
            return vec![];
        }
        logs.sort_by(|a, b| b.final_rmse.total_cmp(&a.final_rmse));
        let which = if logs.len() > LOGS_SHOWN {
            format!(
                "Of {} logs the {LOGS_SHOWN} with the largest error; `report.json` has all:",
                logs.len()
            )
        } else {
            "Each log:".into()
        };
        let row = |log: &&LogError| {
            vec![
                log.file.clone(),
                log.rows.to_string(),
                num(log.declared_rmse),
                num(log.final_rmse),
            ]
        };
        vec![
            Part::Text(which),
            Part::table(
                &[
                    "log",
                    "rows",
                    &titled("held-out RMSE, declared", &self.unit),
                    &titled("held-out RMSE, final", &self.unit),
                ],
                logs.iter().take(LOGS_SHOWN).map(row).collect(),
            ),
        ]
    }

    /// Why an effect that was found makes an error larger in the table, if one does.
    fn only_beside_others(&self) -> Option<String> {
        let worse = |e: &&Effect| {
            e.heldout_after > e.heldout_before && num(e.heldout_after) != num(e.heldout_before)
        };
        let worse: Vec<&Effect> = self.effects.iter().filter(worse).collect();
        (!worse.is_empty()).then(|| {
            format!(
                "The rows add the effects in the order of what each is worth in the final model. The error grows with {}, which \
                 helps only beside effects further down; its section has the error of the final model without it.",
                self.listed(&worse)
            )
        })
    }

    /// Errors on the check data.
    fn check(&self) -> Vec<Part> {
        let Some(check) = &self.check else {
            return vec![];
        };
        let row = |model: &str, rmse: f64| vec![model.to_string(), num(rmse)];
        let repeats = if check.repeats() {
            " Their motion is one that the searched data have as well. So these figures do not show how the model does on \
             another motion."
        } else {
            ""
        };
        vec![
            Part::Text(format!(
                "Check: {} rows from {} that took no part in the search. Every coefficient is fixed as fitted above.{repeats}",
                check.rows,
                first_of(&check.files, 4)
            )),
            Part::table(
                &["model", &titled("RMSE", &self.unit)],
                vec![
                    row("declared", check.declared_rmse),
                    row(
                        if self.verdict == Verdict::Unknown {
                            "with the approximating effects"
                        } else {
                            "with the effects found"
                        },
                        check.found_rmse,
                    ),
                    row(self.with_all_words(), check.all_rmse),
                ],
            ),
        ]
    }

    /// The row of the model with all effects.
    fn with_all_words(&self) -> &'static str {
        if self.all_is_better() {
            "and all that improves the fit"
        } else {
            "with all effects of the first search"
        }
    }

    /// Effects that improve the fit under names that the data do not support.
    pub(super) fn unsupported(&self) -> Vec<Part> {
        if self.improves.is_empty() {
            return vec![];
        }
        let rows = self.improves.iter().map(|e| {
            let parameters = e.params.iter().map(|(name, v)| {
                let unit = e.units.get(name).map_or("", String::as_str);
                format!("{name} {} {unit}", num(*v)).trim_end().to_string()
            });
            vec![
                self.called(e),
                format!("{} -> {}", num(e.heldout_before), num(e.heldout_after)),
                parameters.collect::<Vec<_>>().join(", "),
                e.unsupported.clone(),
            ]
        });
        vec![
            Part::Heading("Improves the fit, name not supported".into()),
            Part::Text(
                format!(
                    "{}, but something else may be behind it. They are not in the final model, in `MODEL.extended.toml` or in \
                     `MODEL.frozen.toml`.",
                    if self.all_is_better() {
                        "These effects lower the held-out error of these data"
                    } else {
                        "These effects lowered the held-out error in the first search"
                    }
                ),
            ),
            Part::table(
                &[
                    "effect",
                    &titled("held-out RMSE without and with it", &self.unit),
                    "parameters",
                    "why",
                ],
                rows.collect(),
            ),
        ]
    }

    /// How the held-out errors are computed, and the nested one.
    fn held_out(&self) -> String {
        let nested = match self.nested_rmse {
            Some(rmse) => format!(
                " With the whole selection repeated without each fold, the RMSE on the fold left out is {}{}.",
                num(rmse),
                behind(&self.unit)
            ),
            None => String::new(),
        };
        format!(
            "Held-out: the coefficients that predict a group are fitted to the other folds. Effects are selected by this \
             same error, and nonlinear parameters are refined on all rows, so the error on new data may be somewhat \
             larger.{nested} Intervals are 95 %, by bootstrap over blocks of time."
        )
    }

    /// The effect with this index.
    pub(super) fn effect(&self, i: usize) -> Vec<Part> {
        let (e, u) = (&self.effects[i], behind(&self.unit));
        let kind = if self.verdict == Verdict::Unknown {
            "Approximating effect"
        } else {
            "Effect"
        };
        let mut meaning = e.meaning.clone();
        if let Some(first) = meaning.get_mut(0..1) {
            first.make_ascii_uppercase();
        }
        let terms: Vec<String> = e.terms.iter().map(|t| readable(t)).collect();
        let mut out = vec![
            Part::Heading(format!("{kind} {}: {}", i + 1, self.heading_of(e))),
            Part::Text(format!(
                "{meaning}. Form: {}. Held-out RMSE {}{u} without it and {}{u} with it.",
                e.form,
                num(e.heldout_without),
                num(self.last.heldout_rmse)
            )),
            parameters(e),
            Part::Text(format!("Terms: `{}`", terms.join("`, `"))),
        ];
        out.extend(e.rival.as_ref().map(|r| self.rival(r)));
        if !e.plot.x.is_empty() {
            let mut caption = self.caption(&e.plot);
            caption.push_str(" All other effects are included in both.");
            if e.name == EffectKind::AngleFriction {
                caption.push_str(
                    " Left of zero is the motion backward, at its angle less one turn or period.",
                );
            }
            out.push(Part::Picture {
                file: format!("effect-{}-{}.svg", i + 1, e.name),
                plot: Box::new(self.labelled(&e.plot)),
                caption,
            });
        }
        out
    }

    /// The best other effect in the place of one. The search compared them before it took away the
    /// effects whose names the data do not support, so both figures are of the model with all of
    /// them.
    fn rival(&self, r: &Rival) -> Part {
        let u = behind(&self.unit);
        let place = match &self.with_all {
            None => "Nearest rival:".to_string(),
            Some(all) => format!(
                "Nearest rival, in the model with all that improves the fit (held-out RMSE {}{u}):",
                num(all.heldout_rmse)
            ),
        };
        let than = if r.behind < 0.0 {
            format!(
                "{} smaller. A rival takes the place only if it is significant, is steady over the blocks of time and predicts \
                 at least 1 % better before the last round of the search",
                percent(-r.behind)
            )
        } else {
            format!("{} larger", percent(r.behind))
        };
        Part::Text(format!(
            "{place} with {} in its place the held-out RMSE is {}{u}, {than}.",
            r.name,
            num(r.heldout_rmse)
        ))
    }

    /// What a plot shows.
    fn caption(&self, p: &Plot) -> String {
        format!(
            "Residual of the fit to all rows (in-sample) against {}, {} and {}.",
            self.labelled(p).against,
            p.names[0],
            p.names[1]
        )
    }

    /// Effects that cannot be distinguished.
    pub(super) fn ambiguities(&self) -> Vec<Part> {
        let parts = self.not_identifiable.iter().map(|a| {
            [
                Part::Heading(format!("Not distinguishable: {}", joined(&a.effects, ", "))),
                Part::Text(format!(
                    "These effects explain the data equally well. Experiments that would distinguish them: {}.",
                    a.experiment
                )),
            ]
        });
        let equal = self.equal_paths.iter().map(|p| {
            let (own, others) = (joined(&p.effects, " and "), joined(&p.instead, " and "));
            [
                Part::Heading(format!("As good: {own} or {others}")),
                Part::Text(format!(
                    "Another course of the search found {others} in the place of {own}. Its held-out RMSE is {}{}, within 0.3 % or one \
                     standard error of that of the course that was taken. A measurement in which the two differ would tell.",
                    num(p.heldout_rmse),
                    behind(&self.unit)
                )),
            ]
        });
        parts.flatten().chain(equal.flatten()).collect()
    }

    /// Structure that no effect explains; nothing if there is none.
    pub(super) fn unexplained(&self) -> Vec<Part> {
        if self.structure.is_empty() {
            return vec![];
        }
        let beside = if self.verdict == Verdict::Unknown {
            ""
        } else {
            " Beside what the named effects took off the squared error it is small, so the verdict is as it is."
        };
        let mut out = vec![
            Part::Heading(UNEXPLAINED.into()),
            Part::Text(format!(
                "What is left is not noise alone: without the structure in each row the held-out RMSE of the final model would be lower by the \
                 share that the row gives, and no effect of the catalogue is sure to explain it.{beside}"
            )),
            Part::table(
                &["depends on", "reduction of held-out RMSE", "p value"],
                self.structure
                    .iter()
                    .map(|s| vec![s.depends_on.clone(), percent(s.gain), p_value(s.p_value)])
                    .collect(),
            ),
        ];
        if let Some(p) = self.plot_unknown.as_ref().filter(|p| !p.x.is_empty()) {
            out.push(Part::Picture {
                file: "structure.svg".into(),
                plot: Box::new(self.labelled(p)),
                caption: self.caption(p),
            });
        }
        out
    }

    /// Effects that are too small to count.
    pub(super) fn not_material(&self) -> Vec<Part> {
        let mut out = vec![Part::Heading("Significant, but not material".into())];
        if self.seen_not_material.is_empty() {
            out.push(Part::Text("No other effect is significant.".into()));
            return out;
        }
        out.push(Part::Text(format!(
            "Each of these effects is significant, but reduces the held-out RMSE by less than {}, from which an effect counts.",
            self.material()
        )));
        out.push(Part::table(
            &["effect", "form", "reduction of held-out RMSE"],
            self.seen_not_material
                .iter()
                .map(|s| vec![s.name.to_string(), s.form.clone(), percent(s.gain)])
                .collect(),
        ));
        out
    }

    /// The declared model.
    pub(super) fn declared_terms(&self) -> Vec<Part> {
        let how = |t: &DeclaredTerm| match (t.fixed, t.per_sequence) {
            (true, _) => "fixed",
            (false, false) => "fitted",
            (false, true) => "fitted in each sequence; RMS",
        };
        vec![
            Part::Heading("Declared terms".into()),
            Part::Text(
                "Coefficients of the declared model before any effect was added, and beside the effects.".into(),
            ),
            Part::table(
                &["term", "coefficient", "beside the effects", "unit", ""],
                self.declared
                    .iter()
                    .map(|t| {
                        vec![
                            t.name.clone(),
                            num(t.coefficient),
                            self.beside_the_effects(t),
                            t.unit.clone(),
                            how(t).into(),
                        ]
                    })
                    .collect(),
            ),
        ]
    }

    /// Coefficient of a declared term in the final model.
    fn beside_the_effects(&self, declared: &DeclaredTerm) -> String {
        let mut own = self.extended.terms.iter().filter(|t| t.effect.is_empty());
        let own = own.find(|t| t.name == declared.name);
        own.and_then(|t| t.fixed.or(t.fitted))
            .map_or("-".into(), num)
    }

    /// The last scan of the catalogue.
    pub(super) fn scan(&self) -> Vec<Part> {
        let mut out = vec![
            Part::Heading("Every effect, added to the final model".into()),
            Part::Text(
                "p value: probability of such a reduction by chance, estimated with decoys (the residual with a random sign for each \
                 block of time). t statistic: mean reduction of the squared error per block of time, divided by its standard error."
                    .into(),
            ),
            Part::table(
                &[
                    "effect",
                    "form",
                    "reduction of held-out RMSE",
                    "p value",
                    "t statistic",
                ],
                self.tested
                    .iter()
                    .map(|t| {
                        let at = t
                            .params
                            .iter()
                            .map(|(n, v)| format!(", {n} {}", num(*v)))
                            .collect::<String>();
                        vec![
                            t.name.to_string(),
                            format!("{}{at}", t.form),
                            percent(t.gain),
                            p_value(t.p_value),
                            positive_zero(format!("{:.1}", t.t_statistic)),
                        ]
                    })
                    .collect(),
            ),
        ];
        if !self.absent.is_empty() {
            out.push(Part::Text(format!(
                "Not tested, because the data lack the columns or do not vary in them, because the axis makes more than one and a half turns (a weight on it is a ripple of order one then), or because a fitted coefficient leaves no room: {}.",
                joined(&self.absent, ", ")
            )));
        }
        out
    }

    /// Whiteness and cross-correlation of the residual.
    pub(super) fn tests_of_residual(&self) -> Vec<Part> {
        vec![
            Part::Heading("Tests of the residual".into()),
            Part::Text(
                "The largest correlation of the residual with itself and with each input, over all lags; before: declared model, \
                 after: final model.".into(),
            ),
            Part::table(
                &["model", "against", "lag, rows", "correlation", "p value"],
                self.residual_tests
                    .iter()
                    .map(|ModelTest { model, test }| {
                        vec![
                            model.clone(),
                            test.against.clone(),
                            test.lag.to_string(),
                            positive_zero(format!("{:.3}", test.correlation)),
                            p_value(test.p),
                        ]
                    })
                    .collect(),
            ),
        ]
    }

    /// Flaws of the data.
    pub(super) fn data_checks(&self) -> Vec<Part> {
        vec![
            Part::Heading(CHECKS.into()),
            Part::table(
                &["check", "rows", "first", "what"],
                self.hygiene
                    .iter()
                    .map(|f| {
                        vec![
                            f.check.clone(),
                            f.count.to_string(),
                            f.first.clone(),
                            f.what.clone(),
                        ]
                    })
                    .collect(),
            ),
        ]
    }
}

/// The parameters of an effect.
fn parameters(e: &Effect) -> Part {
    let rows = e.params.iter().map(|(name, v)| {
        let (value, interval) =
            e.ci.get(name)
                .map_or((num(*v), "-".into()), |ci| with_interval(*v, *ci));
        let unit = e.units.get(name).cloned().unwrap_or_default();
        let interval = if e.at_limit.contains(name) {
            format!("{interval}; the value is at the limit of the search, so the true one may lie beyond it")
        } else {
            interval
        };
        vec![name.clone(), value, interval, unit]
    });
    Part::table(
        &["parameter", "value", "95 % interval", "unit"],
        rows.collect(),
    )
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;

    /// The search compares rivals before it takes away the effects whose names the data do not
    /// support.
    #[test]
    fn figures_of_a_rival_are_of_the_model_that_is_named() {
        let mut report = example::report();
        report.with_all = None;
        let text = report.markdown();
        let line = "Nearest rival: with viscous in its place the held-out RMSE is 0.1100 N, 10.0 % larger.";
        assert!(text.contains(line), "{text}");
        // The final model has an error of 0.1 N, with all effects 0.09 N: 0.099 N is larger than
        // the second only.
        report.with_all = Some(Figures {
            heldout_rmse: 0.09,
            ..report.last.clone()
        });
        report.effects[0].rival = Some(Rival {
            name: EffectKind::Viscous,
            heldout_rmse: 0.099,
            behind: 0.1,
        });
        let text = report.markdown();
        let line = "Nearest rival, in the model with all that improves the fit (held-out RMSE 0.09000 N): with viscous in its \
                    place the held-out RMSE is 0.09900 N, 10.0 % larger.";
        assert!(text.contains(line), "{text}");
    }

    #[test]
    fn a_value_at_the_limit_of_the_search_is_said() {
        let mut report = example::report();
        let said = |report: &Report| {
            let text = report.markdown();
            text.contains("| -0.40 to -0.20; the value is at the limit of the search")
        };
        assert!(said(&report), "{}", report.markdown());
        report.effects[0].at_limit.clear();
        assert!(!said(&report));
    }

    /// An effect that helps only beside another makes the error larger where the other is not there
    /// yet.
    #[test]
    fn a_row_with_a_larger_error_is_explained() {
        let mut report = example::report();
        let line = "The error grows with viscous, which helps only beside effects further down";
        assert!(!report.markdown().contains("The error grows"));
        let viscous = Effect {
            name: EffectKind::Viscous,
            heldout_before: 1.0 / 3.0,
            heldout_after: 0.36,
            ..report.effects[0].clone()
        };
        report.effects.insert(0, viscous);
        let text = report.markdown();
        assert!(text.contains(line), "{text}");
        // No larger by any digit that is shown.
        report.effects[0].heldout_after = 1.0 / 3.0 + 1e-9;
        assert!(!report.markdown().contains("The error grows"));
    }

    #[test]
    fn why_a_better_rival_did_not_take_the_place_is_said() {
        let mut report = example::report();
        report.effects[0].rival.as_mut().unwrap().behind = -0.142;
        let text = report.markdown();
        assert!(
            text.contains("14.2 % smaller. A rival takes the place only if it is significant"),
            "{text}"
        );
    }

    #[test]
    fn the_sign_of_friction_depends_on_what_the_target_is() {
        let mut report = example::report();
        report.verdict = Verdict::Several;
        let text = report.markdown();
        for part in ["negative where the target", "positive where the target"] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }
}
