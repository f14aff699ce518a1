//! What the effects know of the data.

use crate::rig::knowing;

#[test]
fn a_filtered_velocity_is_late_and_a_noisy_one_is_not() {
    let late = |lag: f64, noise: f64| {
        let mut rng = residual_columns::stats::Rng::new(3);
        let at = |i: usize| 0.02 * i as f64;
        let angle: Vec<f64> = (0..3000)
            .map(|i| (1.3 * at(i)).sin() + 0.4 * (3.1 * at(i)).cos())
            .collect();
        let velocity = |t: f64| 1.3 * (1.3 * t).cos() - 1.24 * (3.1 * t).sin();
        let velocity: Vec<f64> = (0..3000)
            .map(|i| velocity(at(i) - lag) + noise * rng.normal())
            .collect();
        let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\" }\n\
                    velocity = { column = \"v\", unit = \"rad/s\" }\nangle = { column = \"a\", unit = \"rad\" }\n\
                    [[terms]]\nname = \"a\"\nexpr = \"1\"\n";
        let columns = [
            ("target", angle.clone()),
            ("angle", angle),
            ("velocity", velocity),
        ];
        let mut out = None;
        knowing(spec, &columns, 1500, |ctx| out = ctx.velocity_is_late());
        out
    };
    let found = late(0.04, 0.0).unwrap();
    assert!((found - 0.04).abs() < 0.004, "{found}");
    assert_eq!((late(0.0, 0.0), late(0.0, 0.1)), (None, None));
}
