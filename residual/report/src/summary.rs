//! The verdict in one or two sentences.

use super::sections::{CHECKS, UNEXPLAINED};
use super::words::{behind, joined};
use super::{Effect, Figures, Report, Structure, Verdict};
use residual_columns::format::{num, percent};
use residual_evidence::leftover::LINE_OF_INPUT;
use residual_log::finding::LEFT_OUT;
use residual_log::hygiene::{
    BUNCHED, CLIPPING, FEW_ROWS, HELD, OTHER_UNIT, REPEATED_MOTION, REPORTED_ONLY,
    SPEED_AGAINST_ANGLE, UNLIKE_LOG,
};

/// Correlation of the residual with itself from which the verdict names it.
const COLOURED: f64 = 0.1;

/// Reduction of the final model's held-out RMSE from which the verdict names the structure that is
/// left beside the effects.
const REMAINS: f64 = 0.1;

/// How much more than all that is left without a name an effect must remove, in squared error, to
/// hold by itself.
const FAR_MORE: f64 = 10.0;

/// Half the width of an interval, as a share of the value, up to which a value is certain. What is
/// left may still be in it; more than that moves no name.
const CERTAIN: f64 = 0.2;

/// Share of the rows at the end of the target's range from which that is said with the answer.
const LOST: f64 = 0.01;

/// Checks of the data that make the answer doubtful.
const AGAINST: [&str; 7] = [
    SPEED_AGAINST_ANGLE,
    FEW_ROWS,
    LEFT_OUT,
    BUNCHED,
    HELD,
    LINE_OF_INPUT,
    OTHER_UNIT,
];

impl Report {
    /// The verdict in some sentences, with the errors before and after.
    pub fn summary(&self) -> String {
        format!(
            "{}{}{}{}{}{}{}{}",
            self.before(),
            self.answer(),
            self.equals(),
            self.remains(),
            self.beside(),
            self.ended(),
            self.checked(),
            self.doubts()
        )
    }

    /// Whether the answer is whole: every name is supported, the search came to its end, little is
    /// left, what is left beside no effect is white, and neither the columns nor the check data
    /// contradict it.
    pub(super) fn is_whole(&self) -> bool {
        let last = self.last.heldout_rmse;
        let worse = self.check.as_ref().and_then(|c| c.worse_than(last));
        let coloured = self.verdict == Verdict::None && !self.coloured().is_empty();
        let doubtful = !self.improves.is_empty()
            || self.limited.is_some()
            || !self.equal_paths.is_empty()
            || self.paths_not_judged > 0
            || self.left().is_some()
            || worse.is_some()
            || coloured
            || self.clipped().is_some()
            || AGAINST.iter().any(|check| self.flawed(check));
        !doubtful
    }

    /// The first structure that is large beside what is left. The verdict `unknown` names its
    /// structure by itself.
    fn left(&self) -> Option<&Structure> {
        let mut all = self.structure.iter();
        all.find(|s| self.verdict != Verdict::Unknown && s.gain >= REMAINS)
    }

    /// Which names may as well be others.
    fn equals(&self) -> String {
        let more = match self.paths_not_judged {
            0 => String::new(),
            1 => {
                " One more course of the search predicts as well; its names were not judged.".into()
            }
            n => format!(
                " {n} more courses of the search predict as well; their names were not judged."
            ),
        };
        let all = self.equal_paths.iter().map(|p| {
            format!(
                " These data do not tell {} or {}: with {} the model predicts as well (held-out RMSE {}{}).",
                joined(&p.effects, " and "),
                joined(&p.instead, " and "),
                joined(&p.instead, " and "),
                num(p.heldout_rmse),
                behind(&self.unit)
            )
        });
        all.chain([more]).collect()
    }

    /// What remains beside the effects.
    fn remains(&self) -> String {
        self.left().map_or(String::new(), |s| {
            format!(
                " What is left still has structure that no effect explains ({} of its RMSE; see \"{UNEXPLAINED}\"): {}.",
                percent(s.gain),
                briefly(&s.depends_on)
            )
        })
    }

    /// The effects that hold by themselves under the verdict `unknown`, in a sentence.
    pub(super) fn holding(&self) -> String {
        let hold: Vec<&Effect> = self.effects.iter().filter(|e| self.holds(e)).collect();
        match hold.len() {
            0 => String::new(),
            _ => format!(
                " What is left is small beside {}, whose values can be used.",
                self.listed(&hold)
            ),
        }
    }

    /// Whether an effect can be used although structure is left that no effect explains: without it
    /// the squared error grows by far more than that structure takes of it, and its values are
    /// certain.
    pub fn holds(&self, effect: &Effect) -> bool {
        let last = self.last.heldout_rmse.powi(2);
        let own = effect.heldout_without.powi(2) - last;
        let strongest = self.structure.iter().map(|s| s.gain).fold(0.0, f64::max);
        let left = last * (1.0 - (1.0 - strongest.clamp(0.0, 1.0)).powi(2));
        let certain = |(name, value): (&String, &f64)| {
            let interval = effect.ci.get(name);
            interval.is_some_and(|[low, high]| 0.5 * (high - low) <= CERTAIN * value.abs())
        };
        // A phase near 0 has no size of its own, and no value without an interval is certain.
        let mut sizes = effect.params.iter().filter(|(name, _)| *name != "phase");
        let stands_for_another = |e: &Effect| self.others(e.name).concat().contains(&effect.name);
        let alone =
            self.others(effect.name).is_empty() && !self.effects.iter().any(stands_for_another);
        !self.structure.is_empty()
            && alone
            && !self.drifts(effect)
            && own > FAR_MORE * left
            && sizes.all(certain)
    }

    /// Whether what is left goes with the time and with what the effect acts on: its value is then
    /// a mean of several.
    fn drifts(&self, effect: &Effect) -> bool {
        let mut over_time = (self.structure.iter().map(|s| &s.depends_on))
            .filter(|what| what.contains("time in the run"));
        over_time.any(|what| {
            ["velocity", "load", "angle"].iter().any(|of| {
                let term = if *of == "load" { "command" } else { of };
                what.contains(of)
                    && effect
                        .terms
                        .iter()
                        .any(|t| t.contains(of) || t.contains(term))
            })
        })
    }

    /// Whether the data have a finding of this check.
    fn flawed(&self, check: &str) -> bool {
        self.finding(check).is_some()
    }

    /// What a check of the data has seen.
    fn finding(&self, check: &str) -> Option<&str> {
        let mut all = self.hygiene.iter();
        let found = all.find(|f| f.check == check);
        found.map(|f| f.what.as_str())
    }

    /// What is to be known before the answer: few rows that decide it, stamps that are not those of
    /// the rows, rows that are no values of their own.
    fn before(&self) -> String {
        let other = self.finding(OTHER_UNIT);
        // Its rows are the few that carry the error, and no spikes.
        let few = self.finding(FEW_ROWS).filter(|_| other.is_none());
        let left = |w: &&str| w.ends_with(REPORTED_ONLY);
        let held = self.finding(HELD).filter(left);
        let clipped = self.clipped();
        let seen = [other, few, self.finding(BUNCHED), held]
            .into_iter()
            .flatten();
        seen.chain(clipped.as_deref())
            .map(|what| format!("{}. ", capitalised(what.trim_end_matches('.'))))
            .collect()
    }

    /// That much of the target stands at the end of its range and is fitted as it is.
    fn clipped(&self) -> Option<String> {
        let mut all = self.hygiene.iter();
        let f = all.find(|f| f.check == CLIPPING)?;
        let what = f.what.strip_suffix(&format!(": {REPORTED_ONLY}"))?;
        let share = f.count as f64 / self.rows.max(1) as f64;
        (share > LOST).then(|| {
            format!(
                "{} of the rows have the {what}: what acts there is not in the target, and effects that are missed or too small follow; \
                 hygiene.clipping = \"drop\" leaves these rows out",
                percent(share)
            )
        })
    }

    /// What the data themselves say against the answer.
    fn doubts(&self) -> String {
        let mut out = String::new();
        let seen = [UNLIKE_LOG, LEFT_OUT, LINE_OF_INPUT].map(|check| self.finding(check));
        for what in seen.into_iter().flatten() {
            out += &format!(" {}.", capitalised(what));
        }
        if self.flawed(SPEED_AGAINST_ANGLE) {
            out += &format!(
                " The angle and the velocity contradict each other: the time stamps or a unit may be wrong; see \"{CHECKS}\"."
            );
        }
        let other_motion = self.check.as_ref().is_some_and(|c| !c.repeats());
        if self.flawed(REPEATED_MOTION) && !other_motion {
            out += &format!(
                " Most runs repeat one motion, so the held-out error does not show how the model does on another; see \"{CHECKS}\"."
            );
        }
        out
    }

    /// Whether the model with all effects of the first search predicts better than that with the
    /// effects found. Without a wrong name the search may come to a better model.
    pub(super) fn all_is_better(&self) -> bool {
        let better = |all: &Figures| all.heldout_rmse < self.last.heldout_rmse;
        self.with_all.as_ref().is_some_and(better)
    }

    /// What improves the fit under a name that the data do not support.
    fn beside(&self) -> String {
        let Some(all) = &self.with_all else {
            return String::new();
        };
        let names = self.listed(&self.improves.iter().collect::<Vec<_>>());
        if !self.all_is_better() {
            return format!(
                " The data do not support the name of what was found at first: {names}."
            );
        }
        let which = match self.improves.len() {
            1 => "One further effect improves",
            _ => "Further effects improve",
        };
        format!(
            " {which} the fit (to {}{}), but the data do not support the name: {names}.",
            num(all.heldout_rmse),
            behind(&self.unit)
        )
    }

    /// That the search ended before its end.
    fn ended(&self) -> String {
        let told = self.verdict == Verdict::Unknown && self.effects.is_empty();
        self.limited
            .filter(|_| !told)
            .map_or(String::new(), |next| {
                format!(
                " The search ended at max_effects = {} with structure left that {next} would fit.",
                self.extended.selection.max_effects
            )
            })
    }

    /// What came out on the check data.
    fn checked(&self) -> String {
        self.check.as_ref().map_or(String::new(), |check| {
            let repeats = if check.repeats() {
                ", on the motion of the searched data"
            } else {
                ""
            };
            let u = behind(&self.unit);
            let held_out = self.last.heldout_rmse;
            let worse = check.worse_than(held_out).map_or(String::new(), |ratio| {
                format!(
                    "; that is {ratio:.2} times the held-out RMSE of {}{u}, so the model fits these data less well than the searched ones",
                    num(held_out)
                )
            });
            format!(
                " On the check data: RMSE {} -> {}{u}{repeats}{worse}.",
                num(check.declared_rmse),
                num(check.found_rmse)
            )
        })
    }

    /// That what is left is not white, where its test says so.
    fn coloured(&self) -> String {
        let test = self
            .residual_tests
            .iter()
            .find(|t| t.model == "after" && t.test.against == "itself");
        match test {
            Some(t) if t.test.p < 0.01 && t.test.correlation.abs() > COLOURED => format!(
                " What is left is not white: its correlation with itself is {:.2} at {} row(s), as that of a filtered sensor \
                 or of a slow disturbance that these columns do not show.",
                t.test.correlation, t.test.lag
            ),
            _ => String::new(),
        }
    }

    /// The verdict in one or two sentences.
    fn answer(&self) -> String {
        let u = behind(&self.unit);
        let (b, f) = (num(self.baseline.heldout_rmse), num(self.last.heldout_rmse));
        let all: Vec<&Effect> = self.effects.iter().collect();
        let list = self.listed(&all);
        match self.verdict {
            Verdict::None => format!(
                "Nothing material is missing: held-out RMSE {b}{u}.{}",
                self.coloured()
            ),
            Verdict::Effect | Verdict::Several => {
                format!("The model lacks {list}: held-out RMSE {b} -> {f}{u}.")
            }
            Verdict::NotIdentifiable => {
                let alternatives = self
                    .not_identifiable
                    .first()
                    .map(|a| a.effects.as_slice())
                    .unwrap_or_default();
                // Each of the others, with what it cannot be told from either.
                let group = |e: &Effect| {
                    let groups = self.not_identifiable.iter().skip(1);
                    groups.map(|a| &a.effects).find(|all| all.contains(&e.name))
                };
                // Of the kind that cannot be told from another, one is named above, the others are
                // not.
                let mut named = false;
                let others = all.into_iter().filter(|e| {
                    let further = named && alternatives.first() == Some(&e.name);
                    named |= alternatives.first() == Some(&e.name);
                    further || !alternatives.contains(&e.name)
                });
                let (doubtful, clear): (Vec<&Effect>, Vec<&Effect>) =
                    others.partition(|e| group(e).is_some());
                let mut also: Vec<String> = vec![];
                for all in doubtful.into_iter().filter_map(group) {
                    let either = joined(all, " or ");
                    if !also.contains(&either) {
                        also.push(either);
                    }
                }
                if !clear.is_empty() {
                    also.push(self.listed(&clear));
                }
                let also = match also.len() {
                    0 => String::new(),
                    _ => format!(" It also lacks {}.", also.join(", ")),
                };
                let either = joined(alternatives, " or ");
                format!("The model lacks {either}; these data cannot distinguish them: held-out RMSE {b} -> {f}{u}.{also}")
            }
            Verdict::Unknown if self.limited.is_some() && all.is_empty() => format!(
                "Structure remains, and the search was not allowed to look further (max_effects = {}): {} would fit it. \
                 Held-out RMSE {b}{u}.",
                self.extended.selection.max_effects,
                joined(&self.limited.into_iter().collect::<Vec<_>>(), "")
            ),
            Verdict::Unknown => {
                let on = self.structure.first().map_or("", |s| &s.depends_on);
                let part = match all.len() {
                    0 => String::new(),
                    1 => format!(" The effect {list} describes only part of it."),
                    _ => format!(" The effects {list} describe only part of it."),
                };
                let hold = self.holding();
                format!("Structure remains that no effect of the catalogue explains: {on}.{part}{hold} Held-out RMSE {b} -> {f}{u}.")
            }
        }
    }
}

/// A text that begins a sentence.
fn capitalised(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or(String::new(), |first| {
        first.to_uppercase().chain(chars).collect()
    })
}

/// What structure depends on, without what only the table needs.
fn briefly(depends_on: &str) -> String {
    let figures = depends_on.rfind(" (").filter(|_| depends_on.ends_with(')'));
    let short = &depends_on[..figures.unwrap_or(depends_on.len())];
    let unseen = ["something that these columns do not show: ", "no column: "];
    match unseen.iter().find_map(|lead| short.strip_prefix(lead)) {
        Some(what) => format!("{what}, which these columns do not show"),
        None => short.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::example;
    use super::*;
    use residual_effects::EffectKind;
    use residual_log::finding::Finding;

    /// A report in which nothing is in doubt.
    fn clear() -> Report {
        let mut report = example::report();
        report.verdict = Verdict::Effect;
        report.not_identifiable.clear();
        report.equal_paths.clear();
        report.paths_not_judged = 0;
        report.limited = None;
        report.with_all = None;
        report.check = None;
        report.structure.clear();
        report
    }

    /// The answer is in all three forms, with this banner.
    fn says(report: &Report, clause: &str, banner: &str) {
        for text in [report.summary(), report.markdown()] {
            assert!(text.contains(clause), "{clause}: {text}");
        }
        let class = format!("<p class=\"verdict {banner}\">");
        assert!(report.html().contains(&class), "{class}");
    }

    #[test]
    fn a_figure_without_a_unit_has_no_space_and_no_comma_behind_it() {
        let verdicts = [
            Verdict::None,
            Verdict::Effect,
            Verdict::NotIdentifiable,
            Verdict::Unknown,
        ];
        for verdict in verdicts {
            let mut report = example::report();
            report.verdict = verdict;
            report.unit = String::new();
            for text in [report.summary(), report.markdown(), report.html()] {
                for mark in [" .", " ,", " ;", " )"] {
                    let figure = |at: &usize| text[..*at].ends_with(|c: char| c.is_ascii_digit());
                    let found = text.match_indices(mark).map(|(at, _)| at).find(figure);
                    let line = found.map(|at| text[..at].lines().last());
                    assert_eq!(line, None, "{verdict:?}: `{mark}`");
                }
                let empty = [", |", ", </"].iter().find(|end| text.contains(**end));
                assert_eq!(empty, None, "{verdict:?}: {text}");
            }
        }
    }

    #[test]
    fn what_is_left_is_said_where_it_is_large() {
        let mut report = clear();
        says(&report, "0.1000 N.", "effect");
        let wander = "something that these columns do not show: it wanders slowly within the logs (correlation 0.78)";
        report.structure = vec![Structure::new(wander, 0.09, 0.0)];
        assert!(!report.summary().contains("What is left"));
        says(&report, "0.1000 N.", "effect");
        report.structure[0].gain = 0.725;
        says(
            &report,
            "(72.5 % of its RMSE; see \"Unexplained structure\"): it wanders slowly within the logs, which these columns do not show.",
            "effect partly",
        );
        report.structure[0].depends_on = "no column: it switches between levels".into();
        says(
            &report,
            "): it switches between levels, which",
            "effect partly",
        );
        report.structure[0].depends_on = "the history of load".into();
        says(&report, "): the history of load.", "effect partly");
        report.structure[0].depends_on = wander.into();
        report
            .structure
            .insert(0, Structure::new("a curve in velocity", 0.05, 0.0));
        says(&report, "it wanders slowly", "effect partly");
        // The verdict itself names it.
        report.verdict = Verdict::Unknown;
        assert!(!report.summary().contains("What is left"));
    }

    #[test]
    fn names_that_predict_as_well_are_one_group() {
        let mut report = clear();
        says(&report, "0.1000 N.", "effect");
        report.equal_paths = example::report().equal_paths;
        let own = report.effects[0].name;
        report.equal_paths[0].effects = vec![own];
        let clause = format!(
            "do not tell {own} or hysteresis and gain: with hysteresis and gain the model predicts as well (held-out RMSE 0.1000 N)"
        );
        says(&report, &clause, "effect partly");
        let named = format!("{own} or hysteresis and gain");
        assert_eq!(report.alternatives(&report.effects[0]), named);
        // Friction and a gain are two settings of a board, so neither is made.
        assert!(report.compensation().is_none());
        report.equal_paths.clear();
        assert!(report.compensation().is_some());
        // How many were not judged is said, too.
        for (count, said) in [(1, "One more course of"), (4, "4 more courses of")] {
            report.paths_not_judged = count;
            says(&report, said, "effect partly");
            assert!(report.compensation().is_none());
        }
    }

    #[test]
    fn a_residual_that_is_not_white_has_another_banner_where_nothing_is_named() {
        let mut report = clear();
        report.effects.clear();
        report.verdict = Verdict::None;
        says(&report, "Nothing material is missing", "none");
        let mut itself = report.residual_tests[1].clone();
        itself.model = "after".into();
        itself.test.against = "itself".into();
        itself.test.correlation = 0.97;
        report.residual_tests.push(itself);
        says(&report, "What is left is not white", "none partly");
    }

    #[test]
    fn columns_that_contradict_each_other_are_said() {
        let mut report = clear();
        let finding = |check: &str| Finding {
            check: check.into(),
            count: 100,
            first: "whole record".into(),
            what: "x".into(),
        };
        report.hygiene = vec![finding(SPEED_AGAINST_ANGLE)];
        says(
            &report,
            "the time stamps or a unit may be wrong; see \"Checks of the data\".",
            "effect partly",
        );
        report.hygiene = vec![finding(REPEATED_MOTION)];
        says(&report, "Most runs repeat one motion", "effect");
        // The check data are of another motion.
        report.check = example::report().check;
        assert!(!report.summary().contains("one motion"));
    }

    #[test]
    fn what_a_file_and_a_range_do_to_the_target_is_said_first() {
        let mut report = clear();
        let finding = |check: &str, count: usize, what: &str| Finding {
            check: check.into(),
            count,
            first: "whole record".into(),
            what: what.into(),
        };
        let few = finding(FEW_ROWS, 9, "few rows carry the error");
        let other = finding(OTHER_UNIT, 100, "in b.csv column `y` spreads over 3000 N");
        report.hygiene = vec![few.clone(), other];
        says(&report, "In b.csv column `y` spreads", "effect partly");
        // The rows of that file are no spikes.
        assert!(!report.summary().contains("carry the error"));
        report.hygiene = vec![few];
        says(&report, "Few rows carry the error.", "effect partly");
        let stuck = |count: usize, done: &str| {
            let what = format!("target stuck at 1.200, the end of its range: {done}");
            vec![finding(CLIPPING, count, &what)]
        };
        let many = report.rows / 10;
        report.hygiene = stuck(many, REPORTED_ONLY);
        says(
            &report,
            "10.0 % of the rows have the target stuck at 1.200, the end of its range: what acts",
            "effect partly",
        );
        for harmless in [
            stuck(report.rows / 200, REPORTED_ONLY),
            stuck(many, "left out of the fit"),
        ] {
            report.hygiene = harmless;
            assert!(report.is_whole() && !report.summary().contains("stuck"));
        }
    }

    #[test]
    fn an_effect_is_graded_by_itself() {
        let mut report = clear();
        report.verdict = Verdict::Unknown;
        report.structure = vec![Structure::new("a band", 0.024, 0.0)];
        let effect = &mut report.effects[0];
        effect.heldout_without = 10.0 * report.last.heldout_rmse;
        effect.params = [("inertia".to_string(), 0.2)].into();
        effect.ci = [("inertia".to_string(), [0.19, 0.21])].into();
        let clause = format!(
            "small beside {}, whose values can be used",
            report.effects[0].name
        );
        assert!(report.summary().contains(&clause), "{}", report.summary());
        for spoil in [
            |r: &mut Report| {
                r.structure[0].gain = 0.9;
                r.effects[0].heldout_without = 3.0 * r.last.heldout_rmse;
            },
            |r: &mut Report| r.structure.clear(),
            |r: &mut Report| r.effects[0].heldout_without = 1.05 * r.last.heldout_rmse,
            |r: &mut Report| r.effects[0].ci = [("inertia".to_string(), [0.1, 0.3])].into(),
            |r: &mut Report| r.effects[0].ci.clear(),
            |r: &mut Report| {
                // Friction that jumps in the middle of a log.
                r.structure[0].depends_on = "time in the run, with the sign of the velocity".into();
                r.effects[0].terms = vec!["0.5 * sign(velocity)".into()];
            },
            |r: &mut Report| {
                let both = vec![r.effects[0].name, EffectKind::Viscous];
                r.not_identifiable = vec![super::super::Ambiguity::new(both, "x")];
            },
            |r: &mut Report| {
                r.equal_paths = example::report().equal_paths;
                r.equal_paths[0].effects = vec![r.effects[0].name];
            },
        ] {
            let mut other = report.clone();
            spoil(&mut other);
            assert!(!other.holds(&other.effects[0]), "{}", other.summary());
            assert!(!other.summary().contains("can be used"));
        }
    }

    #[test]
    fn what_the_data_lack_or_have_too_much_of_is_said() {
        let mut report = clear();
        let mut with = |check: &str, what: &str, clause: &str| {
            report.hygiene = vec![Finding {
                check: check.into(),
                count: 3,
                first: "a.csv".into(),
                what: what.into(),
            }];
            says(&report, clause, "effect partly");
        };
        // First of all: whatever is said after it is about these rows.
        with(
            FEW_ROWS,
            "3 of 9000 rows carry 99 %",
            "3 of 9000 rows carry 99 %. The model lacks",
        );
        with(
            BUNCHED,
            "the stamps come in bunches",
            "The stamps come in bunches. The model",
        );
        with(LEFT_OUT, "35.0 % of 600 rows", " 35.0 % of 600 rows.");
        with(
            LINE_OF_INPUT,
            "lines that an input has too",
            " Lines that an input has too.",
        );
        with(
            HELD,
            "the target holds: reported only",
            "The target holds: reported only. The model",
        );
    }

    #[test]
    fn an_error_on_the_check_data_far_above_the_held_out_one_is_said() {
        let mut report = clear();
        report.check = example::report().check;
        says(
            &report,
            "On the check data: RMSE 0.3400 -> 0.1200 N.",
            "effect",
        );
        report.check.as_mut().unwrap().found_rmse = 0.17;
        says(
            &report,
            "0.1700 N; that is 1.70 times the held-out RMSE of 0.1000 N",
            "effect partly",
        );
    }

    #[test]
    fn effects_of_one_kind_are_told_apart() {
        let mut report = clear();
        report.verdict = Verdict::Several;
        let of = |kind, form: &str, order: f64| Effect {
            name: kind,
            form: form.into(),
            params: [("order".to_string(), order)].into(),
            units: [("order".to_string(), "1/turn".to_string())].into(),
            ..report.effects[0].clone()
        };
        use EffectKind::{GravityAngle, PeriodicAngle};
        report.effects.extend([
            of(PeriodicAngle, "ripple", 7.0),
            of(GravityAngle, "q2", 1.0),
            of(PeriodicAngle, "ripple", 14.0),
            of(GravityAngle, "q2 + q3", 1.0),
        ]);
        says(
            &report,
            "lacks coulomb, periodic_angle (order 7.000; order 14.00), gravity_angle (q2; q2 + q3): held-out",
            "several",
        );
        let text = report.markdown();
        for part in [
            "| and periodic_angle (order 14.00) |",
            "Effect 2: periodic_angle (order 7.000)",
            "Effect 5: gravity_angle (q2 + q3)",
            "Effect 1: coulomb\n",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert_eq!(report.details(&report.effects[1]), "ripple, order 7.000");
        assert_eq!(report.details(&report.effects[2]), "q2");
        // Of one kind, one under each heading.
        report.improves = vec![report.effects.remove(3)];
        assert!(report.summary().contains("periodic_angle (order 7.000),"));
        assert!(report
            .markdown()
            .contains("| periodic_angle (order 14.00) |"));
    }
}
