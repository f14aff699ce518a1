//! Dry friction that grows with the load.

use crate::rig::knowing;
use residual_columns::stats::Rng;
use residual_effects::*;

/// Parameters of the form with a share, where the target has this share of the command.
fn parameters(share: f64) -> Vec<(String, String)> {
    let rows = 4800;
    let mut rng = Rng::new(5);
    let mut of = |f: &dyn Fn(f64) -> f64, noise: f64| -> Vec<f64> {
        let at = |i: usize| f(0.02 * i as f64);
        (0..rows).map(|i| at(i) + noise * rng.normal()).collect()
    };
    let voltage = |t: f64| 1.0 + 0.4 * (0.83 * t).sin() + 0.2 * (2.9 * t).cos();
    let columns = [
        ("target", of(&|t| share * voltage(t), 1.0)),
        ("command", of(&voltage, 0.0)),
        ("velocity", of(&|t| (1.9 * t).cos(), 0.0)),
    ];
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                command = { column = \"c\", unit = \"V\" }\nvelocity = { column = \"v\", unit = \"m/s\" }\n\
                [[terms]]\nname = \"a\"\nexpr = \"command\"\n[[terms]]\nname = \"b\"\nexpr = \"1\"\n";
    let mut out = vec![];
    knowing(spec, &columns, 600, |ctx| {
        let all = effect(EffectKind::LoadDependentCoulomb)
            .variants(ctx)
            .remove(0)
            .params(0.0, &[1.0, 1.0]);
        out = all.into_iter().map(|p| (p.name, p.unit)).collect();
    });
    out
}

/// A share of a load that may be 0 can have any value.
#[test]
fn friction_is_per_command_where_the_size_of_the_load_is_not_known() {
    let own = |of: &[(String, String)]| of[1].clone();
    assert_eq!(
        own(&parameters(0.0)),
        ("friction_per_command".into(), "N/V".into())
    );
    assert_eq!(
        own(&parameters(3.0)),
        ("friction_per_load".into(), "1".into())
    );
}

#[test]
fn is_named() {
    crate::rig::names("load_dependent_coulomb", |s| {
        -0.15 * s.command * s.velocity.signum()
    });
}
