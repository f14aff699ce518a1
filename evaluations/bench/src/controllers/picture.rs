//! One reversal of a reel: tension error over time under several controllers.

use scene::{color, Anchor, Axes, Scene};

/// Colors of the controllers.
const HUES: [usize; 4] = [1, 4, 5, 0];
/// Part of the time around the reversal, s.
const WINDOW_S: (f64, f64) = (-0.3, 0.9);

/// The first clear reversal: the reel turns one way for 0.3 s before it and the other way for 0.3 s
/// after it.
fn reversal_s(trace: &[[f64; 3]]) -> Option<f64> {
    let clear = |part: &[[f64; 3]], sign: f64| part.iter().all(|point| point[2] * sign > 0.0);
    // A point a millisecond. At the reversal itself the reel rests for a moment.
    let (apart, long) = (100, 300);
    (apart + long..trace.len().saturating_sub(apart + long))
        .find(|at| {
            let before = &trace[at - apart - long..at - apart];
            let after = &trace[at + apart..at + apart + long];
            let sign = before[0][2].signum();
            clear(before, sign) && clear(after, -sign)
        })
        .map(|at| trace[at][0])
}

/// Draws `traces` (name; time in s, error in N, reel speed in rad/s) around a reversal of the last
/// one.
pub fn reversal(traces: &[(&str, &[[f64; 3]])]) -> String {
    let mut scene = Scene::new(720.0, 420.0);
    let at = traces.last().and_then(|(_, trace)| reversal_s(trace));
    let Some(at) = at else {
        scene.text((60.0, 40.0), Anchor::Start, "no reversal in this run");
        return scene.to_svg();
    };
    let within = |trace: &[[f64; 3]]| -> Vec<(f64, f64)> {
        trace
            .iter()
            .map(|point| (point[0] - at, point[1]))
            .filter(|(t, _)| (WINDOW_S.0..=WINDOW_S.1).contains(t))
            .collect()
    };
    let parts: Vec<_> = traces.iter().map(|(_, trace)| within(trace)).collect();
    let most = parts
        .iter()
        .flatten()
        .map(|(_, error)| error.abs())
        .fold(0.1, f64::max);
    let most = (most * 10.0).ceil() / 10.0;
    let axes = Axes {
        left: 60.0,
        top: 30.0,
        width: 640.0,
        height: 280.0,
        x: WINDOW_S,
        y: (-most, most),
    };
    axes.grid(&mut scene);
    axes.draw(
        &mut scene,
        "tension error of unit 1, N",
        "time since the reel's reversal, s",
    );
    for (i, ((part, (name, _)), hue)) in parts.into_iter().zip(traces).zip(HUES).enumerate() {
        scene.line(&axes.at(part), 1.5, color(hue), false);
        // The names are long: two columns below.
        let (x, y) = ((i % 2) as f32 * 330.0 + axes.left, (i / 2) as f32 * 20.0);
        let y = axes.bottom() + 60.0 + y;
        scene.line(&[(x, y - 4.0), (x + 24.0, y - 4.0)], 3.0, color(hue), false);
        scene.text((x + 30.0, y), Anchor::Start, name);
    }
    scene.to_svg()
}
