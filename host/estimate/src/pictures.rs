//! Pictures of estimates as the thesis has them: prediction against truth, errors of each model,
//! errors over joints and speed.

use estimator::metrics::Rows;
use experiment::table::Table;
use scene::{color, range, shade, Anchor, Axes, Color, Scene, BLACK, GRAY};

/// Most points of a curve.
const POINTS: usize = 1_200;
const LEFT: f32 = 70.0;
const WIDE: f32 = 820.0;
const HIGH: f32 = 260.0;
const TOP: f32 = 66.0;
const BELOW: f32 = 56.0;
const LEGEND: f32 = 150.0;
/// Cells of a map along each side.
const CELLS: usize = 24;
/// Side of a map, px.
const SIDE: f32 = 230.0;
/// Rows in a cell of a map at least; fewer say nothing.
const CELL_ROWS: usize = 20;
fn wide(title: &str) -> (Scene, Axes) {
    let mut scene = Scene::new(LEFT + WIDE + LEGEND, TOP + HIGH + BELOW);
    scene.heading((LEFT, 22.0), title);
    let axes = Axes {
        left: LEFT,
        top: TOP,
        width: WIDE,
        height: HIGH,
        x: (0.0, 1.0),
        y: (0.0, 1.0),
    };
    (scene, axes)
}

/// Label and estimates over `seconds` of a trial from `from_s`, with the interval's half widths of
/// the last model.
#[must_use]
pub fn prediction(
    title: &str,
    models: &[(String, &Rows)],
    step_s: f64,
    from_s: f64,
    seconds: f64,
) -> Scene {
    let (mut scene, mut axes) = wide(title);
    let Some((_, first)) = models.first() else {
        return scene;
    };
    let from = ((from_s / step_s) as usize).min(first.label.len());
    let to = (from + (seconds / step_s) as usize).min(first.label.len());
    axes.x = (
        from as f64 * step_s,
        (to as f64 * step_s).max(from as f64 * step_s + 1.0),
    );
    let shown = |rows: &'_ Rows| {
        rows.estimate[from..to]
            .iter()
            .chain(&rows.label[from..to])
            .copied()
            .collect::<Vec<f64>>()
    };
    axes.y = range(models.iter().flat_map(|(_, rows)| shown(rows)));
    let stride = (to - from).div_ceil(POINTS).max(1);
    let points = |values: &[f64]| {
        let rows = (from..to).step_by(stride);
        axes.at(rows.map(|k| (k as f64 * step_s, values[k])))
    };
    for (n, (name, rows)) in models.iter().enumerate() {
        let color = color(n);
        scene.line(&points(&rows.estimate), 1.2, color, false);
        axes.legend(&mut scene, n + 1, name, color);
    }
    scene.line(&points(&first.label), 1.6, BLACK, false);
    axes.legend(&mut scene, 0, "measured", BLACK);
    axes.draw(&mut scene, "force on the tool, N", "time in the trial, s");
    scene
}

/// A replay: estimate and interval of the component `axis`, and the measured force where there is
/// one. Columns are those of `forcectl estimate run --out`.
#[must_use]
pub fn replay(rows: &Table, axis: &str) -> Scene {
    let (mut scene, mut axes) = wide("Estimated contact force, replay");
    let column = |name: &str| rows.column(name).unwrap_or_default();
    let (time, valid) = (column("t_s"), column("valid"));
    let estimate = column(&format!("estimate_{axis}_n"));
    let half = column("half_width_n");
    let label = column(&format!("force_{axis}_n"));
    let ends = time.first().zip(time.last());
    let (from, to) = ends.map_or((0.0, 1.0), |(from, to)| (*from, *to));
    axes.x = (from, to.max(from + 1.0));
    let shown = |k: &usize| valid[*k] == 1.0;
    let values = (0..time.len()).filter(shown).map(|k| estimate[k]);
    axes.y = range(values.chain(label.iter().copied().filter(|v| v.is_finite())));
    let stride = time.len().div_ceil(POINTS).max(1);
    // Stretches of valid rows: what is invalid is not drawn.
    let taken: Vec<usize> = (0..time.len()).step_by(stride).collect();
    for stretch in taken.split(|k| !shown(k)).filter(|s| s.len() > 1) {
        let of =
            |value: &dyn Fn(usize) -> f64| axes.at(stretch.iter().map(|k| (time[*k], value(*k))));
        if half[stretch[0]].is_finite() {
            // Where the interval is wider than the picture, its line is the frame's.
            for sign in [-1.0, 1.0] {
                let edge = |k: usize| (estimate[k] + sign * half[k]).clamp(axes.y.0, axes.y.1);
                scene.line(&of(&edge), 0.8, GRAY, false);
            }
        }
        scene.line(&of(&|k| estimate[k]), 1.2, color(0), false);
    }
    axes.legend(&mut scene, 0, "estimate", color(0));
    axes.legend(&mut scene, 1, "90 % interval", GRAY);
    if label.iter().any(|v| v.is_finite()) {
        for stretch in taken.split(|k| !label[*k].is_finite()) {
            let points = stretch.iter().map(|k| (time[*k], label[*k]));
            scene.line(&axes.at(points), 1.6, BLACK, false);
        }
        axes.legend(&mut scene, 2, "measured", BLACK);
    }
    axes.draw(&mut scene, "force on the tool, N", "time in the log, s");
    scene
}

/// Error of each model over `seconds` of a trial from `from_s`, mean of each second, below the
/// joints' path.
#[must_use]
pub fn over_trajectory(
    title: &str,
    models: &[(String, &Rows)],
    step_s: f64,
    from_s: f64,
    seconds: f64,
) -> Scene {
    let mut scene = Scene::new(LEFT + WIDE + LEGEND, 2.0 * (TOP + HIGH) + BELOW);
    scene.heading((LEFT, 22.0), title);
    let Some((_, first)) = models.first() else {
        return scene;
    };
    let from = ((from_s / step_s) as usize).min(first.error.len());
    let to = (from + (seconds / step_s) as usize).min(first.error.len());
    let second = ((1.0 / step_s).round() as usize).max(1);
    let starts: Vec<usize> = (from..to).step_by(second).collect();
    let x = (
        from as f64 * step_s,
        (to as f64 * step_s).max(from as f64 * step_s + 1.0),
    );
    let axes = |top: f32, y: (f64, f64)| Axes {
        left: LEFT,
        top,
        width: WIDE,
        height: HIGH,
        x,
        y,
    };
    let middle = |start: usize| (start + second / 2) as f64 * step_s;
    // Joints in shares of their range in this trial, so that one axis holds angles and a length.
    let names = ["shoulder", "elbow", "insertion"];
    let upper = axes(TOP, (0.0, 1.0));
    for (joint, name) in names.into_iter().enumerate() {
        let (low, high) = range(first.joints.iter().map(|q| q[joint]));
        let line = starts.iter().map(|start| {
            let share = (first.joints[*start][joint] - low) / (high - low);
            (*start as f64 * step_s, share)
        });
        scene.line(&upper.at(line), 1.4, color(joint), false);
        upper.legend(&mut scene, joint, name, color(joint));
    }
    upper.draw(&mut scene, "joint, share of its range", "");
    let errors: Vec<Vec<f64>> = (models.iter())
        .map(|(_, rows)| {
            let mean = |start: &usize| {
                let part = &rows.error[*start..(start + second).min(rows.error.len())];
                part.iter().map(|e| e.abs()).sum::<f64>() / part.len().max(1) as f64
            };
            starts.iter().map(mean).collect()
        })
        .collect();
    let most = errors.iter().flatten().copied().fold(1e-9, f64::max);
    let lower = axes(2.0 * TOP + HIGH, (0.0, 1.05 * most));
    for (n, ((name, _), errors)) in models.iter().zip(&errors).enumerate() {
        let line = starts.iter().zip(errors);
        let line = lower.at(line.map(|(start, error)| (middle(*start), *error)));
        scene.line(&line, 1.2, color(n), false);
        lower.legend(&mut scene, n, name, color(n));
    }
    lower.draw(&mut scene, "absolute error, N", "time in the trial, s");
    scene
}

fn quantile(sorted: &[f64], share: f64) -> f64 {
    sorted
        .get(((sorted.len() as f64 * share) as usize).min(sorted.len().saturating_sub(1)))
        .copied()
        .unwrap_or(0.0)
}

/// Box plots of the errors: median, quartiles, and the 5 % and 95 % points.
#[must_use]
pub fn boxes(title: &str, models: &[(String, &[Rows])]) -> Scene {
    let (mut scene, mut axes) = wide(title);
    let marks: Vec<[f64; 5]> = models
        .iter()
        .map(|(_, trials)| {
            let mut errors: Vec<f64> = trials
                .iter()
                .flat_map(|t| t.error.iter().copied())
                .collect();
            errors.sort_by(f64::total_cmp);
            [0.05, 0.25, 0.5, 0.75, 0.95].map(|share| quantile(&errors, share))
        })
        .collect();
    axes.y = range(marks.iter().flatten().copied());
    axes.x = (0.0, models.len().max(1) as f64);
    axes.draw(
        &mut scene,
        "error of the estimate, N (5, 25, 50, 75, 95 %)",
        "",
    );
    // The ticks of x number the models; their names cover them.
    scene.rectangle(
        LEFT - 4.0,
        TOP + HIGH + 0.8,
        WIDE + 8.0,
        24.0,
        Color(255, 255, 255),
    );
    let zero = axes.at_y(0.0);
    scene.line(&[(LEFT, zero), (LEFT + WIDE, zero)], 0.8, GRAY, true);
    for (n, ((name, _), m)) in models.iter().zip(&marks).enumerate() {
        let x = axes.at_x(n as f64 + 0.5);
        let y = m.map(|v| axes.at_y(v));
        let color = color(n);
        scene.line(&[(x, y[0]), (x, y[4])], 1.4, color, false);
        scene.rectangle(x - 18.0, y[3], 36.0, (y[1] - y[3]).max(1.0), color);
        scene.line(
            &[(x - 18.0, y[2]), (x + 18.0, y[2])],
            2.0,
            Color(255, 255, 255),
            false,
        );
        scene.text((x, TOP + HIGH + 17.0), Anchor::Middle, name);
    }
    scene
}

/// Mean absolute error in six bins of speed, a group of bars for each bin.
#[must_use]
pub fn by_speed(title: &str, below_m_per_s: &[f64], models: &[(String, Vec<f64>)]) -> Scene {
    let (mut scene, mut axes) = wide(title);
    let most = models
        .iter()
        .flat_map(|(_, e)| e.iter().copied())
        .fold(0.0, f64::max);
    axes.y = (0.0, if most > 0.0 { 1.05 * most } else { 1.0 });
    let width_mm = below_m_per_s.first().map_or(1.0, |v| v * 1e3);
    axes.x = (0.0, width_mm * below_m_per_s.len().max(1) as f64);
    let bar = 0.8 * width_mm / models.len().max(1) as f64;
    for (n, (name, errors)) in models.iter().enumerate() {
        let color = color(n);
        for (bin, error) in errors.iter().enumerate() {
            let from = width_mm * bin as f64 + 0.1 * width_mm + bar * n as f64;
            let (x, y) = (axes.at_x(from), axes.at_y(*error));
            scene.rectangle(x, y, axes.at_x(from + bar) - x, axes.at_y(0.0) - y, color);
        }
        axes.legend(&mut scene, n, name, color);
    }
    axes.draw(
        &mut scene,
        "mean absolute error, N",
        "speed of the tip, mm/s",
    );
    scene
}

/// Values over something, one line a model.
#[must_use]
pub fn curves(
    title: &str,
    x_words: &str,
    y_words: &str,
    models: &[(String, Vec<(f64, f64)>)],
) -> Scene {
    let (mut scene, mut axes) = wide(title);
    let points = || models.iter().flat_map(|(_, p)| p.iter());
    axes.x = range(points().map(|p| p.0));
    axes.y = (0.0, 1.05 * points().map(|p| p.1).fold(1e-9, f64::max));
    for (n, (name, points)) in models.iter().enumerate() {
        let color = color(n);
        let line = axes.at(points.iter().copied());
        scene.line(&line, 1.6, color, false);
        for (x, y) in line {
            scene.rectangle(x - 3.0, y - 3.0, 6.0, 6.0, color);
        }
        axes.legend(&mut scene, n, name, color);
    }
    axes.draw(&mut scene, y_words, x_words);
    scene
}

/// One map: words of the axes, and where each row lies.
pub type Place<'a> = (&'a str, &'a str, &'a dyn Fn(&Rows, usize) -> (f64, f64));

/// Mean absolute error over pairs of quantities; the darker, the larger. Cells with few rows stay
/// white.
#[must_use]
pub fn error_maps(title: &str, trials: &[Rows], places: &[Place<'_>]) -> Scene {
    let (w, h) = (LEFT + SIDE + 20.0, 34.0 + SIDE + BELOW);
    let mut scene = Scene::new(w * 3.0, 40.0 + h * places.len().div_ceil(3) as f32);
    scene.heading((LEFT, 22.0), title);
    for (n, (x_words, y_words, place)) in places.iter().enumerate() {
        let points = || {
            trials
                .iter()
                .flat_map(|t| (0..t.error.len()).map(move |k| (t, k)))
        };
        let axes = Axes {
            left: (n % 3) as f32 * w + LEFT,
            top: 40.0 + (n / 3) as f32 * h + 34.0,
            width: SIDE,
            height: SIDE,
            x: range(points().map(|(t, k)| place(t, k).0)),
            y: range(points().map(|(t, k)| place(t, k).1)),
        };
        let mut cells = vec![(0.0, 0_usize); CELLS * CELLS];
        for (t, k) in points() {
            let (x, y) = place(t, k);
            let cell = |v: f64, (low, high): (f64, f64)| {
                (((v - low) / (high - low) * CELLS as f64) as usize).min(CELLS - 1)
            };
            let (sum, rows) = &mut cells[cell(y, axes.y) * CELLS + cell(x, axes.x)];
            *sum += t.error[k].abs();
            *rows += 1;
        }
        let mean = |(sum, rows): &(f64, usize)| (*rows >= CELL_ROWS).then(|| sum / *rows as f64);
        let mut means: Vec<f64> = cells.iter().filter_map(mean).collect();
        means.sort_by(f64::total_cmp);
        // The few largest cells must not take all of the scale.
        let most = quantile(&means, 0.98).max(1e-9);
        let size = SIDE / CELLS as f32;
        for (c, cell) in cells.iter().enumerate() {
            if let Some(mean) = mean(cell) {
                let (left, top) = (
                    axes.left + (c % CELLS) as f32 * size,
                    axes.top + SIDE - (c / CELLS + 1) as f32 * size,
                );
                scene.rectangle(left, top, size + 0.3, size + 0.3, shade(mean / most));
            }
        }
        axes.draw(
            &mut scene,
            &format!("{y_words}; darkest: {most:.2} N"),
            x_words,
        );
    }
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Rows {
        let n = 20_000;
        Rows {
            trial: 1,
            component_n: Vec::new(),
            error: (0..n).map(|k| f64::from(k % 10) - 4.5).collect(),
            estimate: (0..n).map(|k| f64::from(k).sin()).collect(),
            label: vec![0.0; n as usize],
            range: Some([0.0; 2]),
            speed: vec![0.001; n as usize],
            reversing: vec![false; n as usize],
            joints: (0..n)
                .map(|k| [f64::from(k % 100), f64::from(k / 400), 0.0])
                .collect(),
            rates: vec![[0.0; 3]; n as usize],
            tips: vec![[0.0; 3]; n as usize],
        }
    }

    #[test]
    fn pictures_are_small_and_name_what_they_show() {
        let rows = rows();
        let trials = [rows.clone()];
        let svgs = [
            prediction("p", &[("hybrid".to_owned(), &rows)], 0.02, 0.0, 100.0).to_svg(),
            over_trajectory("t", &[("hybrid".to_owned(), &rows)], 0.02, 0.0, 100.0).to_svg(),
            boxes("b", &[("hybrid".to_owned(), &trials)]).to_svg(),
            by_speed(
                "s",
                &[0.002, 0.004],
                &[("hybrid".to_owned(), vec![0.1, 0.2])],
            )
            .to_svg(),
            curves(
                "c",
                "minutes",
                "N",
                &[("hybrid".to_owned(), vec![(1.0, 0.5), (2.0, 0.25)])],
            )
            .to_svg(),
        ];
        for svg in svgs {
            assert!(
                svg.contains("hybrid") && svg.len() < 150_000,
                "{}",
                svg.len()
            );
        }
        let map = error_maps(
            "m",
            &trials,
            &[("a", "b", &|r: &Rows, k: usize| {
                (r.joints[k][0], r.joints[k][1])
            })],
        )
        .to_svg();
        assert!(map.contains("b; darkest") && map.matches("<rect").count() > 100);
    }
}
