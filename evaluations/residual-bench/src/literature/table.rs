//! Rates on sets of the literature generator beside the goals, as Markdown.

use super::judge::{self, Class};
use super::{Group, Outcome};
use std::fmt::Write as _;

/// One line of the table: what, hits, cases, goal.
struct Line {
    what: String,
    hits: usize,
    of: usize,
    goal: &'static str,
    /// Range of the share that reaches the goal.
    reached: std::ops::RangeInclusive<f64>,
}

fn count<'a>(
    what: &str,
    outcomes: impl Iterator<Item = &'a Outcome>,
    hit: impl Fn(&Outcome) -> bool,
    goal: &'static str,
    reached: std::ops::RangeInclusive<f64>,
) -> Line {
    let (mut hits, mut of) = (0, 0);
    for o in outcomes {
        hits += usize::from(hit(o));
        of += 1;
    }
    Line {
        what: what.into(),
        hits,
        of,
        goal,
        reached,
    }
}

fn lines(all: &[Outcome]) -> Vec<Line> {
    let one = |low: f64, high: f64| {
        all.iter()
            .filter(move |o| o.case.group == Group::One && (low..high).contains(&o.case.size))
    };
    let group = |g: Group| all.iter().filter(move |o| o.case.group == g);
    let right = |o: &Outcome| o.class == Class::Right;
    let mut out = vec![
        count(
            "one effect at the noise's size or more: right first, or in the first group",
            one(1.0, f64::INFINITY),
            right,
            ">= 95 %",
            0.95..=1.0,
        ),
        count(
            "one effect at 0.3 of the noise: right first, or in the first group",
            one(0.0, 1.0),
            right,
            ">= 80 %",
            0.8..=1.0,
        ),
        count(
            "two or three effects: one of them first",
            group(Group::Some),
            right,
            "",
            0.0..=1.0,
        ),
        count(
            "empty sets quiet",
            group(Group::Empty),
            right,
            ">= 99 %",
            0.99..=1.0,
        ),
        count(
            "outside the catalogue: `unknown`",
            group(Group::Outside),
            right,
            ">= 90 %",
            0.9..=1.0,
        ),
        count(
            "... or quiet",
            group(Group::Outside),
            |o| o.class == Class::None,
            "",
            0.0..=1.0,
        ),
    ];
    let named: usize = all.iter().map(|o| o.found.len()).sum();
    out.push(Line {
        what: "names found that are not in the set".into(),
        hits: all.iter().map(|o| o.wrong.len()).sum(),
        of: named,
        goal: "<= 2 %",
        reached: 0.0..=0.02,
    });
    out.push(Line {
        what: "... or in a group with one that is, as the data cannot distinguish them".into(),
        hits: all.iter().map(|o| o.grouped.len()).sum(),
        of: named,
        goal: "",
        reached: 0.0..=1.0,
    });
    let covered: Vec<_> = all.iter().flat_map(|o| &o.covered).collect();
    out.push(Line {
        what: "95 % intervals that hold the truth".into(),
        hits: covered.iter().filter(|c| c.holds()).count(),
        of: covered.len(),
        goal: "93 to 97 %",
        reached: 0.93..=0.97,
    });
    out.push(Line {
        what: "estimates inside their own interval".into(),
        hits: covered.iter().filter(|c| c.holds_estimate()).count(),
        of: covered.len(),
        goal: "100 %",
        reached: 1.0..=1.0,
    });
    out
}

/// The table of rates and the results by effect.
#[must_use]
pub fn text(all: &[Outcome]) -> String {
    let mut out = String::from("## Rates\n\n| what | figure | goal | |\n|---|---|---|---|\n");
    for line in lines(all).iter().filter(|l| l.of > 0) {
        let share = line.hits as f64 / line.of as f64;
        let state = match (line.goal, line.reached.contains(&share)) {
            ("", _) => "",
            (_, true) => "reached",
            (_, false) => "missed",
        };
        let _ = writeln!(
            out,
            "| {} | {:.1} % ({} of {}) | {} | {state} |",
            line.what,
            100.0 * share,
            line.hits,
            line.of,
            line.goal
        );
    }
    out += &distances(all);
    out += &by_effect(all);
    out
}

/// How wide the intervals are beside the errors: says more than the share that holds the truth,
/// where intervals are few.
fn distances(all: &[Outcome]) -> String {
    let covered = all.iter().flat_map(|o| &o.covered);
    let mut distances: Vec<f64> = covered.map(judge::Covered::distance).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let Some(median) = distances.get(distances.len() / 2) else {
        return String::new();
    };
    format!(
        "\nDistance of the truth from the middle of the interval, in half widths of the interval: median {median:.2}. It would be 0.34 \
         with exact intervals and normal errors; less where intervals are too wide.\n"
    )
}

/// Right, unknown, none and wrong by effect and size, with the wrong names.
fn by_effect(all: &[Outcome]) -> String {
    let mut rows: Vec<(String, String)> = Vec::new();
    for o in all {
        let key = (o.case.truth(), format!("{}", o.case.size));
        if o.case.group != Group::Some && !rows.contains(&key) {
            rows.push(key);
        }
    }
    rows.sort();
    let mut out = String::from(
        "\n## By effect\n\n| effect | size | right | unknown | none | wrong | names that are not there |\n|---|---:|---:|---:|---:|---:|---|\n",
    );
    for (truth, size) in rows {
        let own: Vec<&Outcome> = all
            .iter()
            .filter(|o| o.case.truth() == truth && format!("{}", o.case.size) == size)
            .collect();
        let class = |c: Class| own.iter().filter(|o| o.class == c).count();
        let mut wrong: Vec<&str> = own
            .iter()
            .flat_map(|o| o.wrong.iter().map(String::as_str))
            .collect();
        wrong.sort_unstable();
        wrong.dedup();
        let _ = writeln!(
            out,
            "| {truth} | {size} | {} | {} | {} | {} | {} |",
            class(Class::Right),
            class(Class::Unknown),
            class(Class::None),
            class(Class::Wrong),
            wrong.join(", ")
        );
    }
    out
}
