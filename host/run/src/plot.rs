//! The picture of a run: force at the tip, its error, tensions, over time, as SVG.

use crate::outcome::Outcome;
use force::metrics::{Step, SETTLED_WITHIN_N, STEADY_AFTER_S};
use nalgebra::Vector3;
use scene::{color, Anchor, Axes, Color, Scene, BAND, BLACK};
use wire::UNITS;

const WIDTH: f32 = 1000.0;
const LEFT: f32 = 70.0;
const RIGHT: f32 = 130.0;
const TOP: f32 = 50.0;
const PANEL: f32 = 230.0;
const GAP: f32 = 45.0;
/// Most points of a curve; longer runs are thinned out.
const POINTS: usize = 2000;

/// Marks where a curve leaves the panel.
const CLIPPED: Color = Color(0xB0, 0x00, 0x20);
/// Height of that mark, px.
const MARK: f32 = 5.0;
/// The error panel shows errors up to this in any case, N.
const ERROR_SHOWN_N: f64 = 0.6;

/// One curve.
struct Curve {
    label: String,
    color: Color,
    width: f32,
    dashed: bool,
    points: Vec<(f64, f64)>,
}

struct Panel {
    title: String,
    unit: &'static str,
    curves: Vec<Curve>,
    /// A band from 0 to this value that counts as good.
    band: Option<f64>,
    /// Shown at least, in value.
    at_least: (f64, f64),
    /// Values above this are drawn at the upper edge and marked there.
    clip: Option<f64>,
}

/// Draws a run.
#[must_use]
pub fn draw(outcome: &Outcome) -> Scene {
    let steps = thinned(&outcome.steps);
    let panels = [
        force_panel(&steps, outcome),
        error_panel(&steps, outcome),
        tension_panel(&steps),
    ];
    let height = TOP + panels.len() as f32 * (PANEL + GAP) + 10.0;
    let mut scene = Scene::new(WIDTH, height);
    let commanded_n = outcome.commanded_n;
    let title = format!(
        "forcectl set-force {} {} {}, {}, firmware {}",
        commanded_n.x, commanded_n.y, commanded_n.z, outcome.link, outcome.firmware
    );
    scene.heading((LEFT, 24.0), &title);
    let span = match (steps.first(), steps.last()) {
        (Some(first), Some(last)) if last.t_s > first.t_s => (first.t_s, last.t_s),
        _ => (0.0, 1.0),
    };
    for (i, panel) in panels.iter().enumerate() {
        let top = TOP + i as f32 * (PANEL + GAP);
        draw_panel(&mut scene, panel, top, span, i + 1 == panels.len());
    }
    scene
}

/// Draws two runs below each other at the same scale: the error at the tip, and that of the cable
/// that was worst before. In one panel the later curve would hide the earlier one.
#[must_use]
pub fn compare(before: &Outcome, after: &Outcome) -> Scene {
    let runs = [
        ("before", color(1), thinned(&before.steps)),
        ("after", color(0), thinned(&after.steps)),
    ];
    let worst = before.metrics.as_ref().map_or(0, |m| {
        let rms = m.tension_rms_n;
        (0..UNITS).fold(0, |worst, i| if rms[i] > rms[worst] { i } else { worst })
    });
    let commanded_n = before.commanded_n;
    let pair = |title: String, value: &dyn Fn(&Step) -> f64, at_least: (f64, f64)| {
        let curves: Vec<Curve> = runs
            .iter()
            .map(|(label, color, steps)| {
                // The step itself would hide everything after it.
                let steady: Vec<&Step> = steps.iter().copied().filter(|s| s.t_s > 0.5).collect();
                curve((*label).to_owned(), *color, 1.2, false, &steady, value)
            })
            .collect();
        let values = curves.iter().flat_map(|c| c.points.iter().map(|p| p.1));
        let at_least = values.fold(at_least, |(l, h), y| (l.min(y), h.max(y)));
        curves
            .into_iter()
            .map(move |curve| Panel {
                title: format!("{title}, {}", curve.label),
                unit: "N",
                curves: vec![curve],
                band: None,
                at_least,
                clip: None,
            })
            .collect::<Vec<_>>()
    };
    let mut panels = pair(
        "Length of the force error at the tip".to_owned(),
        &|s| (s.best_force_n() - commanded_n).norm(),
        (0.0, 0.1),
    );
    panels.extend(pair(
        format!(
            "Tension error of cable {} (the worst in session 1)",
            worst + 1
        ),
        &|s| s.best_tension_n()[worst] - s.tension_setpoint_n[worst],
        (-0.1, 0.1),
    ));
    let height = TOP + panels.len() as f32 * (PANEL + GAP) + 10.0;
    let mut scene = Scene::new(WIDTH, height);
    let title = format!("forcectl identify, {}", before.link);
    scene.heading((LEFT, 24.0), &title);
    let end = before.steps.last().map_or(1.0, |s| s.t_s.max(1.0));
    for (i, panel) in panels.iter().enumerate() {
        let top = TOP + i as f32 * (PANEL + GAP);
        draw_panel(&mut scene, panel, top, (0.5, end), i + 1 == panels.len());
    }
    scene
}

fn thinned(steps: &[Step]) -> Vec<&Step> {
    let stride = steps.len().div_ceil(POINTS).max(1);
    steps.iter().step_by(stride).collect()
}

fn curve(
    label: String,
    color: Color,
    width: f32,
    dashed: bool,
    steps: &[&Step],
    value: impl Fn(&Step) -> f64,
) -> Curve {
    Curve {
        label,
        color,
        width,
        dashed,
        points: steps
            .iter()
            .map(|step| (step.t_s, value(step)))
            .filter(|(_, y)| y.is_finite())
            .collect(),
    }
}

fn from_truth(outcome: &Outcome) -> bool {
    outcome.steps.iter().all(|step| step.applied_n.is_some())
}

fn force_panel(steps: &[&Step], outcome: &Outcome) -> Panel {
    let mut curves = Vec::new();
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let color = color(axis);
        curves.push(curve(format!("F{name}"), color, 1.6, false, steps, |s| {
            s.best_force_n()[axis]
        }));
        curves.push(curve(String::new(), color, 1.2, true, steps, |s| {
            s.commanded_n[axis]
        }));
    }
    Panel {
        title: if from_truth(outcome) {
            "Force at the tip, in the plant (dashed: commanded)".to_owned()
        } else {
            "Force at the tip, from the load cells (dashed: commanded)".to_owned()
        },
        unit: "N",
        curves,
        band: None,
        at_least: (-0.5, 0.5),
        clip: None,
    }
}

fn error_panel(steps: &[&Step], outcome: &Outcome) -> Panel {
    let error_n = |s: &Step| {
        let goal_n = if s.t_s >= 0.0 {
            outcome.commanded_n
        } else {
            Vector3::zeros()
        };
        (s.best_force_n() - goal_n).norm()
    };
    // The step itself would make everything after it small. Nothing else is clipped.
    let clip = steps
        .iter()
        .filter(|s| !(0.0..STEADY_AFTER_S).contains(&s.t_s))
        .map(|s| error_n(s))
        .fold(ERROR_SHOWN_N, f64::max);
    Panel {
        title: "Length of the force error (band: settled)".to_owned(),
        unit: "N",
        curves: vec![curve(
            "|error|".to_owned(),
            color(1),
            1.4,
            false,
            steps,
            error_n,
        )],
        band: Some(SETTLED_WITHIN_N),
        at_least: (0.0, 0.2),
        clip: Some(clip),
    }
}

fn tension_panel(steps: &[&Step]) -> Panel {
    let mut curves = Vec::new();
    for i in 0..UNITS {
        curves.push(curve(
            format!("cable {}", i + 1),
            color(i),
            1.4,
            false,
            steps,
            |s| s.best_tension_n()[i],
        ));
        curves.push(curve(String::new(), color(i), 1.0, true, steps, |s| {
            s.tension_setpoint_n[i]
        }));
    }
    Panel {
        title: "Cable tensions (dashed: setpoint)".to_owned(),
        unit: "N",
        curves,
        band: None,
        at_least: (0.0, 3.0),
        clip: None,
    }
}

fn draw_panel(scene: &mut Scene, panel: &Panel, top: f32, span: (f64, f64), last: bool) {
    let values = panel
        .curves
        .iter()
        .flat_map(|c| c.points.iter().map(|p| p.1))
        .map(|y| panel.clip.map_or(y, |clip| y.min(clip)));
    let (low, high) = values.fold(panel.at_least, |(l, h), y| (l.min(y), h.max(y)));
    let margin = 0.05 * (high - low);
    let axes = Axes {
        left: LEFT,
        top,
        width: WIDTH - LEFT - RIGHT,
        height: PANEL,
        x: span,
        y: (if low == 0.0 { 0.0 } else { low - margin }, high + margin),
    };
    if let Some(band) = panel.band {
        let band = axes.at_y(band);
        scene.rectangle(LEFT, band, axes.width, axes.bottom() - band, BAND);
    }
    axes.grid(scene);
    if (span.0..span.1).contains(&0.0) {
        let x = axes.at_x(0.0);
        scene.line(&[(x, top), (x, axes.bottom())], 1.0, BLACK, true);
    }
    let words = if last {
        "time since the command, s"
    } else {
        ""
    };
    axes.draw(scene, &format!("{}, {}", panel.title, panel.unit), words);
    if let Some(clip) = panel.clip {
        mark_clipped(scene, panel, clip, &axes);
    }
    let named = panel.curves.iter().filter(|curve| !curve.label.is_empty());
    for (n, curve) in named.enumerate() {
        axes.legend(scene, n, &curve.label, curve.color);
    }
    for curve in &panel.curves {
        let points = curve.points.iter().map(|(t, v)| (*t, v.min(axes.y.1)));
        scene.line(&axes.at(points), curve.width, curve.color, curve.dashed);
    }
}

/// Marks at the upper edge where curves are above `clip`, and says how far they go.
fn mark_clipped(scene: &mut Scene, panel: &Panel, clip: f64, axes: &Axes) {
    let mut largest = clip;
    for curve in &panel.curves {
        for group in curve.points.chunk_by(|a, b| (a.1 > clip) == (b.1 > clip)) {
            let (Some(first), Some(last)) = (group.first(), group.last()) else {
                continue;
            };
            if first.1 > clip {
                largest = group.iter().map(|p| p.1).fold(largest, f64::max);
                let x = axes.at_x(first.0);
                let width = (axes.at_x(last.0) - x).max(2.0);
                scene.rectangle(x, axes.top, width, MARK, CLIPPED);
            }
        }
    }
    if largest > clip {
        let text = format!("red: above {clip:.1}, up to {largest:.2}");
        scene.colored_text((axes.right(), axes.top - 9.0), Anchor::End, &text, CLIPPED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(commanded_n: f64, force_n: impl Fn(f64) -> f64) -> Outcome {
        let steps: Vec<Step> = (-100..500)
            .map(|n| {
                let t_s = f64::from(n) * 0.01;
                Step {
                    t_s,
                    tip_m: Vector3::zeros(),
                    commanded_n: Vector3::new(0.0, commanded_n, 0.0),
                    estimated_n: Vector3::new(0.0, force_n(t_s), 0.0),
                    applied_n: None,
                    tension_setpoint_n: [2.0; UNITS],
                    measured_tension_n: [2.0; UNITS],
                    true_tension_n: None,
                    available: [true; UNITS],
                }
            })
            .collect();
        Outcome::of_steps(Vector3::new(0.0, commanded_n, 0.0), steps)
    }

    #[test]
    fn what_the_error_panel_clips_is_marked() {
        let clipped = |svg: &str| svg.contains("fill=\"#b00020\"");
        // A step of 2.5 N: 0.2 s of it are above the panel.
        let step = |t: f64| {
            if t < 0.0 {
                0.0
            } else {
                2.5 * (t / 0.2).min(1.0)
            }
        };
        let svg = draw(&outcome(2.5, step)).to_svg();
        assert!(clipped(&svg), "{svg}");
        assert!(svg.contains("above 0.6, up to 2.50"), "{svg}");
        // No step and no error: nothing to mark.
        assert!(!clipped(&draw(&outcome(0.0, |_| 0.0)).to_svg()));
        // A steady error is shown whole and not clipped.
        let svg = draw(&outcome(2.5, |t| if t < 0.0 { 0.0 } else { 0.5 })).to_svg();
        assert!(!clipped(&svg), "{svg}");
    }

    #[test]
    fn both_runs_of_a_comparison_have_their_own_panels_at_one_scale() {
        let before = outcome(2.5, |t| if t < 0.0 { 0.0 } else { 1.5 });
        let after = outcome(2.5, |t| if t < 0.0 { 0.0 } else { 2.4 });
        let svg = compare(&before, &after).to_svg();
        for title in ["error at the tip, before", "error at the tip, after"] {
            assert_eq!(svg.matches(title).count(), 1, "{svg}");
        }
        // The scale of 1 N is in both.
        assert!(svg.matches(">1.0<").count() >= 2, "{svg}");
    }
}
