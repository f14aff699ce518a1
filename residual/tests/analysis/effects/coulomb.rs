//! Dry friction of constant size.

#[test]
fn is_named() {
    crate::rig::names("coulomb", |s| -0.4 * s.velocity.signum());
}

/// A robot that moves from place to place is slow where it starts and where it ends: there a
/// deadband above the noise of the velocity hides a direction that the angle shows.
#[test]
fn is_no_presliding_where_the_deadband_hides_its_sign() {
    use residual::{analyse, spec::Spec, Data};
    use residual_columns::stats::Rng;
    let (runs, rows, dt, move_s) = (5, 2000, 0.005, 0.9);
    let mut rng = Rng::new(11);
    let mut columns = [vec![], vec![], vec![], vec![]];
    for run in 0..runs {
        let (mut from, mut to, mut at_s) = (0.0, 1.0, 0.0);
        for i in 0..rows {
            if at_s >= move_s {
                (from, at_s) = (to, 0.0);
                to = -2.5 + 5.0 * rng.uniform();
            }
            // The path of least jerk.
            let s: f64 = at_s / move_s;
            let angle = from + (to - from) * s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
            let speed = (to - from) / move_s * 30.0 * (s * (1.0 - s)).powi(2);
            columns[0].push(i as f64 * dt + run as f64 * 100.0);
            columns[1].push(angle);
            columns[2].push(speed + 0.01 * rng.normal());
            let sign = if s > 0.0 { (to - from).signum() } else { 0.0 };
            columns[3].push(0.08 * sign + 0.05 * rng.normal());
            at_s += dt;
        }
    }
    let [time, angle, velocity, target] = columns;
    let columns = [("velocity", velocity), ("angle", angle), ("target", target)];
    let data = Data::from_columns(time, columns)
        .sequences((0..runs).map(|run| run * rows..(run + 1) * rows))
        .build()
        .unwrap();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N m\" }\n\
         roles.velocity = { column = \"v\", unit = \"rad/s\", deadband = 0.03 }\n\
         roles.angle = { column = \"q\", unit = \"rad\" }\n\
         [[terms]]\nname = \"offset\"\nexpr = \"1\"\n";
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let names: Vec<_> = report.effects.iter().map(|e| e.name.to_string()).collect();
    assert_eq!(names, ["coulomb"], "{}", report.summary());
}
