//! One reversal of a reel: tension error over time under several controllers.

use scene::{Anchor, Color, Scene};

const BLACK: Color = Color(0x22, 0x22, 0x22);
const GREY: Color = Color(0xcc, 0xcc, 0xcc);
/// Told apart also in grey and with a red-green deficiency (Okabe and Ito 2008).
const COLORS: [Color; 4] = [
    Color(0xd5, 0x5e, 0x00),
    Color(0xe6, 0x9f, 0x00),
    Color(0x56, 0xb4, 0xe9),
    Color(0x00, 0x72, 0xb2),
];
/// Part of the time around the reversal, s.
const WINDOW_S: (f64, f64) = (-0.3, 0.9);
/// Edges of the diagram, pixels.
const LEFT: f32 = 60.0;
const RIGHT: f32 = 700.0;
const TOP: f32 = 20.0;
const BOTTOM: f32 = 300.0;

/// The first clear reversal: the reel turns one way for 0.3 s before it and the other way for 0.3 s after it.
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

/// Draws `traces` (name; time in s, error in N, reel speed in rad/s) around a reversal of the last one.
pub fn reversal(traces: &[(&str, &[[f64; 3]])]) -> String {
    let mut scene = Scene::new(720.0, 420.0);
    let at = traces.last().and_then(|(_, trace)| reversal_s(trace));
    let Some(at) = at else {
        scene.text(
            LEFT,
            TOP + 20.0,
            "no reversal in this run",
            Anchor::Start,
            false,
            BLACK,
        );
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
    let x = |t: f64| LEFT + (RIGHT - LEFT) * ((t - WINDOW_S.0) / (WINDOW_S.1 - WINDOW_S.0)) as f32;
    let y = |n: f64| TOP + (BOTTOM - TOP) * ((most - n) / (2.0 * most)) as f32;
    for part in [-1.0, -0.5, 0.0, 0.5, 1.0] {
        let n = part * most;
        scene.line(&[(LEFT, y(n)), (RIGHT, y(n))], 1.0, GREY, part != 0.0);
        scene.text(
            LEFT - 6.0,
            y(n) + 4.0,
            &format!("{n:.2}"),
            Anchor::End,
            false,
            BLACK,
        );
    }
    for tenth in [-3, 0, 3, 6, 9] {
        let t = f64::from(tenth) / 10.0;
        scene.line(&[(x(t), TOP), (x(t), BOTTOM)], 1.0, GREY, tenth != 0);
        scene.text(
            x(t),
            BOTTOM + 16.0,
            &format!("{t:.1}"),
            Anchor::Middle,
            false,
            BLACK,
        );
    }
    for ((part, color), (i, (name, _))) in parts.iter().zip(COLORS).zip(traces.iter().enumerate()) {
        let points: Vec<_> = part.iter().map(|(t, n)| (x(*t), y(*n))).collect();
        scene.line(&points, 1.5, color, false);
        let (column, row) = ((i % 2) as f32 * 330.0, (i / 2) as f32 * 20.0);
        let at = (LEFT + column, BOTTOM + 60.0 + row);
        scene.line(
            &[(at.0, at.1 - 4.0), (at.0 + 24.0, at.1 - 4.0)],
            3.0,
            color,
            false,
        );
        scene.text(at.0 + 30.0, at.1, name, Anchor::Start, false, BLACK);
    }
    scene.text(
        LEFT,
        14.0,
        "tension error of unit 1, N",
        Anchor::Start,
        true,
        BLACK,
    );
    scene.text(
        (LEFT + RIGHT) / 2.0,
        BOTTOM + 34.0,
        "time since the reel's reversal, s",
        Anchor::Middle,
        false,
        BLACK,
    );
    scene.to_svg()
}
