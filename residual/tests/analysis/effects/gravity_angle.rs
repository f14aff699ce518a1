//! Weight of a part that turns with an angle.

use crate::rig::knowing;
use residual_effects::*;

/// Forms offered for three poses, the first of them the angle once more, and an angle with this
/// amplitude in rad.
fn forms(amplitude: f64, effect: &dyn Effect) -> Vec<String> {
    let of =
        |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..1200).map(|i| f(0.02 * i as f64)).collect() };
    let columns = [
        ("target", of(&|t| (0.7 * t).sin())),
        ("angle", of(&|t| amplitude * (0.9 * t).sin())),
        ("velocity", of(&|t| amplitude * 0.9 * (0.9 * t).cos())),
        ("q1", of(&|t| 0.3 - amplitude * (0.9 * t).sin())),
        ("q2", of(&|t| (0.5 * t).sin())),
        ("q3", of(&|t| (0.31 * t).cos())),
    ];
    let pose = |n: &str| format!("pose.{n} = {{ column = \"{n}\", unit = \"rad\" }}\n");
    let spec = format!(
        "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N·m\" }}\n\
         velocity = {{ column = \"v\", unit = \"rad/s\" }}\nangle = {{ column = \"a\", unit = \"rad\" }}\n\
         {}{}{}[[terms]]\nname = \"a\"\nexpr = \"1\"\n",
        pose("q1"),
        pose("q2"),
        pose("q3")
    );
    let mut out = vec![];
    knowing(&spec, &columns, 600, |ctx| {
        out = effect.variants(ctx).into_iter().map(|v| v.label).collect();
    });
    out
}

/// The torque about a joint contains its own angle in every term.
#[test]
fn sums_contain_the_angle_of_the_joint() {
    let own = [
        "angle + q2",
        "angle - q2",
        "angle + q3",
        "angle - q3",
        "angle + q2 + q3",
    ];
    let single = ["q1", "q2", "q3", "angle"];
    let all: Vec<&str> = single.into_iter().chain(own).collect();
    assert_eq!(forms(1.0, effect(EffectKind::GravityAngle)), all);
    assert_eq!(
        forms(1.0, effect(EffectKind::Payload)),
        [
            "mass on angle",
            "mass on angle and angle + q2",
            "mass on angle and angle - q2",
            "mass on angle and angle + q3",
            "mass on angle and angle - q3",
        ]
    );
}

/// Two joints driven alike are never quite in one place: the weight of the outer link turns with
/// the sum of their angles, twice the angle.
#[test]
fn a_joint_that_is_driven_like_the_angle_offers_twice_the_angle() {
    let of =
        |f: &dyn Fn(f64) -> f64| -> Vec<f64> { (0..1200).map(|i| f(0.02 * i as f64)).collect() };
    let columns = [
        ("target", of(&|t| (0.7 * t).sin())),
        ("angle", of(&|t| (0.9 * t).sin())),
        ("velocity", of(&|t| 0.9 * (0.9 * t).cos())),
        ("q1", of(&|t| (0.9 * t).sin() + 2e-3 * (7.0 * t).sin())),
    ];
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N·m\" }\n\
                velocity = { column = \"v\", unit = \"rad/s\" }\nangle = { column = \"a\", unit = \"rad\" }\n\
                pose.q1 = { column = \"q1\", unit = \"rad\" }\n[[terms]]\nname = \"a\"\nexpr = \"1\"\n";
    knowing(spec, &columns, 600, |ctx| {
        let forms = effect(EffectKind::GravityAngle).variants(ctx);
        let labels: Vec<&str> = forms.iter().map(|v| v.label.as_str()).collect();
        assert!(labels.contains(&"angle + q1"), "{labels:?}");
    });
}

/// A motor that turns many times is no joint.
#[test]
fn sums_are_of_the_poses_where_the_angle_is_no_joint() {
    let of = forms(30.0, effect(EffectKind::GravityAngle));
    assert!(!of.iter().any(|label| label.contains("angle")), "{of:?}");
    for sum in ["q1 + q2", "q2 - q3", "q1 + q2 + q3"] {
        assert!(of.iter().any(|label| label == sum), "{of:?}");
    }
}

#[test]
fn is_named() {
    crate::rig::names("gravity_angle", |s| 0.5 * (s.pose + 0.7).sin());
}

/// Over a short arc a weight rises with the angle as a spring does. About a point on which a part
/// stands it pushes the other way than friction says of a spring.
#[test]
fn a_part_that_stands_has_a_weight_and_no_spring() {
    let model = "[roles]\ntime = { column = \"t\", unit = \"s\" }\ntarget = { column = \"y\", unit = \"N·m\" }\n\
                 angle = { column = \"a\", unit = \"rad\" }\n\
                 velocity = { column = \"v\", unit = \"rad/s\", deadband = 0.005 }\n\
                 [selection]\nonly = [\"coulomb\", \"viscous\", \"inertia\", \"cable_stretch\", \"gravity_angle\", \"geometry\"]\n\
                 [[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
    let found = |weight: f64| {
        let rows = 4 * 800;
        let time = |i: usize| 0.02 * (i % 800) as f64;
        let angle = |i: usize| {
            let (t, run) = (time(i), (i / 800) as f64);
            0.25 * (0.5 * t + run).sin()
                + 0.15 * (1.37 * t + 2.0 * run).sin()
                + 0.06 * (2.9 * t).sin()
        };
        let velocity = |i: usize| {
            let (t, run) = (time(i), (i / 800) as f64);
            0.125 * (0.5 * t + run).cos()
                + 0.2055 * (1.37 * t + 2.0 * run).cos()
                + 0.174 * (2.9 * t).cos()
        };
        let mut noise = residual_columns::stats::Rng::new(4);
        let target: Vec<f64> = (0..rows)
            .map(|i| 0.5 * velocity(i).signum() + weight * angle(i).sin() + 0.05 * noise.normal())
            .collect();
        let data = residual::Data::from_columns(
            (0..rows).map(time).collect(),
            [
                ("angle", (0..rows).map(angle).collect::<Vec<f64>>()),
                ("velocity", (0..rows).map(velocity).collect()),
                ("target", target),
            ],
        )
        .sequences((0..4).map(|run| 800 * run..800 * (run + 1)))
        .build()
        .unwrap();
        let spec = residual::spec::Spec::parse(model).unwrap();
        residual::analyse(&spec, data, &mut ()).unwrap()
    };
    let upright = found(-2.0);
    let names: Vec<&str> = upright.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(
        names,
        ["coulomb", "gravity_angle"],
        "{}",
        upright.markdown()
    );
    let slope = upright.effects[1].params["weight_per_angle"];
    assert!((slope + 2.0).abs() < 0.1, "{slope}");
    // Noise of 0.05 N·m, and friction that goes over within the deadband.
    assert!(upright.last.heldout_rmse < 0.09, "{}", upright.markdown());
    // Hanging it is a weight or a spring.
    let hanging = found(2.0);
    let names = &hanging.not_identifiable[0].effects;
    assert!(
        names.iter().any(|n| *n == "cable_stretch"),
        "{}",
        hanging.markdown()
    );
    assert!(
        names.iter().any(|n| *n == "gravity_angle"),
        "{}",
        hanging.markdown()
    );
}

/// One row of a joint that swings over a third of a turn.
pub struct Swing {
    pub angle: f64,
    pub velocity: f64,
    pub acceleration: f64,
    pub command: f64,
}

/// The names that may stand for `found`, which a joint with this target must have; of the catalogue
/// there are `only` these.
pub fn others(
    found: EffectKind,
    only: &[&str],
    term: &str,
    target: impl Fn(&Swing) -> f64,
) -> Vec<EffectKind> {
    let model = format!(
        "[roles]\ntime = {{ column = \"t\", unit = \"s\" }}\ntarget = {{ column = \"y\", unit = \"N·m\" }}\n\
         angle = {{ column = \"a\", unit = \"rad\" }}\ncommand = {{ column = \"c\", unit = \"N·m\" }}\n\
         velocity = {{ column = \"v\", unit = \"rad/s\", deadband = 0.005 }}\n\
         [selection]\nonly = {only:?}\n[[terms]]\nname = \"declared\"\n{term}\n"
    );
    let rows: Vec<(f64, Swing)> = (0..4 * 1500)
        .map(|i| {
            let (t, run) = (0.02 * f64::from(i % 1500), f64::from(i / 1500));
            let ((s, c), (fast_s, fast_c)) =
                ((0.5 * t + run).sin_cos(), (1.37 * t + 2.0 * run).sin_cos());
            let swing = Swing {
                angle: 0.4 + 0.7 * s + 0.3 * fast_s,
                velocity: 0.35 * c + 0.411 * fast_c,
                acceleration: -0.175 * s - 0.563_07 * fast_s,
                command: 4.0 + 1.5 * (0.9 * t + 1.3 * run).sin() + 0.8 * (2.3 * t + run).sin(),
            };
            (t, swing)
        })
        .collect();
    let mut noise = residual_columns::stats::Rng::new(4);
    let column = |of: &dyn Fn(&Swing) -> f64| rows.iter().map(|(_, s)| of(s)).collect::<Vec<f64>>();
    let noise: Vec<f64> = rows.iter().map(|_| 0.1 * noise.normal()).collect();
    let target = column(&target)
        .iter()
        .zip(noise)
        .map(|(y, n)| y + n)
        .collect();
    let data = residual::Data::from_columns(
        rows.iter().map(|(t, _)| *t).collect(),
        [
            ("angle", column(&|s| s.angle)),
            ("velocity", column(&|s| s.velocity)),
            ("command", column(&|s| s.command)),
            ("target", target),
        ],
    )
    .sequences((0..4).map(|run| 1500 * run..1500 * (run + 1)))
    .build()
    .unwrap();
    let spec = residual::spec::Spec::parse(&model).unwrap();
    let report = residual::analyse(&spec, data, &mut ()).unwrap();
    let is_found = report.effects.iter().any(|e| e.name == found);
    assert!(is_found, "{}", report.markdown());
    report.others(found).concat()
}

/// Over a part of a turn a ripple of an order near one has the shape of a weight; where its order
/// is seen to be none of a weight, both names stand.
#[test]
fn a_ripple_over_a_part_of_a_turn_may_stand_for_a_weight() {
    let only = [
        "coulomb",
        "viscous",
        "inertia",
        "gravity_angle",
        "periodic_angle",
    ];
    let names = |order: f64| {
        others(EffectKind::GravityAngle, &only, "expr = \"1\"", |s| {
            0.4 * s.velocity.signum() + (order * s.angle + 0.6).sin()
        })
    };
    assert!(names(1.0).is_empty());
    for order in [1.4, 1.6] {
        assert!(names(order).contains(&EffectKind::PeriodicAngle), "{order}");
    }
}
