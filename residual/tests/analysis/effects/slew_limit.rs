//! A slew limit: the target follows the command at a limited rate.

use crate::rig::{simulate, Excitation};

/// What a limit of `rate` N/s leaves of the command.
fn limited(rate: f64) -> impl FnMut(f64, bool, f64) -> f64 {
    let mut y = 0.0;
    move |command, first, dt| {
        y = if first {
            command
        } else {
            y + (command - y).clamp(-rate * dt, rate * dt)
        };
        y
    }
}

#[test]
fn is_named() {
    let rate = 2.5;
    let mut follow = limited(rate);
    let report = simulate(&Excitation::default(), 1.0, &mut |s| {
        follow(s.command, s.first, s.dt) - s.command
    });
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["slew_limit"], "{}", report.markdown());
    let [low, high] = report.effects[0].ci["rate_limit"];
    assert!(
        low < rate && rate < high && high - low < 0.2,
        "{low} {high}"
    );
}

/// A command that is set in steps: the target is under way from the row of the step on.
#[test]
fn of_steps_is_named() {
    use residual::{analyse, spec::Spec, Data};
    use residual_columns::stats::Rng;
    let (runs, rows, dt, rate) = (5, 2000, 0.01, 20.0);
    let mut rng = Rng::new(4);
    let [mut time, mut command, mut target] = [const { vec![] }; 3];
    for run in 0..runs {
        let (mut c, mut y) = (5.0, 5.0);
        for i in 0..rows {
            time.push(f64::from(run) * 100.0 + f64::from(i) * dt);
            target.push(y + 0.05 * rng.normal());
            if i % 60 == 0 {
                c = 1.0 + 8.0 * rng.uniform();
            }
            command.push(c);
            y += (c - y).clamp(-rate * dt, rate * dt);
        }
    }
    let rows = rows as usize;
    let data = Data::from_columns(time, [("command", command), ("target", target)])
        .sequences((0..runs as usize).map(|run| run * rows..(run + 1) * rows))
        .build()
        .unwrap();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N\" }\n\
         roles.command = { column = \"c\", unit = \"N\" }\n\
         [[terms]]\nname = \"command\"\nexpr = \"command\"\nfixed = 1.0\n";
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["slew_limit"], "{}", report.markdown());
    let found = report.effects[0].params["rate_limit"];
    assert!((found - rate).abs() < 0.2, "{found}");
}
