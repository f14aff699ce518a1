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
