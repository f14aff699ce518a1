//! A wrong scale of the declared model.

use crate::rig::knowing;
use residual_effects::*;

/// What is fitted cannot have a wrong scale.
#[test]
fn only_a_declared_scale_has_a_gain() {
    let rows = 200;
    let command: Vec<f64> = (0..rows).map(|i| (0.1 * i as f64).sin()).collect();
    let target = command.iter().map(|c| 2.0 * c + 0.5).collect::<Vec<_>>();
    let forms = |terms: &str| {
        let spec = format!(
            "[roles]\ntime = {{ column = \"t\" }}\ntarget = {{ column = \"y\", unit = \"N\" }}\n\
             command = {{ column = \"c\", unit = \"N\" }}\n{terms}"
        );
        let columns = [("target", target.clone()), ("command", command.clone())];
        let mut count = 0;
        knowing(&spec, &columns, rows, |ctx| {
            count = effect(EffectKind::Gain).variants(ctx).len()
        });
        count
    };
    let term = |expr: &str, fixed: &str| {
        format!("[[terms]]\nname = \"{expr}\"\nexpr = \"{expr}\"\n{fixed}\n")
    };
    let fixed = term("command", "fixed = 1.9");
    assert_eq!(forms(&fixed), 1);
    assert_eq!(forms(&(fixed + &term("1", ""))), 1);
    let fitted = term("command", "");
    assert_eq!(forms(&fitted), 0);
    assert_eq!(forms(&(fitted + &term("1", "fixed = 0.4"))), 0);
}

/// Where the load is at its least, as at a slack cable, no other slope can show.
#[test]
fn a_kink_needs_rows_below_it() {
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                command = { column = \"c\", unit = \"N\" }\n\
                [[terms]]\nname = \"c\"\nexpr = \"command\"\nfixed = 1.0\n";
    let kinks = |load: &dyn Fn(f64) -> f64| {
        let rows = 1000;
        let command: Vec<f64> = (0..rows).map(|i| load((0.1 * i as f64).sin())).collect();
        let columns = [("target", command.clone()), ("command", command)];
        let mut out: Vec<f64> = vec![];
        knowing(spec, &columns, rows, |ctx| {
            let mut all = effect(EffectKind::Gain).lookalikes(ctx).into_iter();
            let form = all.find(|l| l.kind == EffectKind::Kink).map(|l| l.form);
            out = form.and_then(|f| f.psi).map_or(vec![], |psi| psi.grid);
        });
        out
    };
    assert_eq!(kinks(&|x| 2.0 + x).len(), 7);
    assert_eq!(kinks(&|x| -2.0 - x), kinks(&|x| 2.0 + x));
    assert!(kinks(&|x| (x + 0.1).max(0.0)).iter().all(|at| *at > 0.0));
    assert!(kinks(&|x| (x - 0.5).max(0.0)).is_empty());
}

/// A term of the model that is fitted holds the curve already.
#[test]
fn is_certain_beside_a_fitted_square() {
    let spec = "[roles]\ntime = { column = \"t\" }\ntarget = { column = \"y\", unit = \"N\" }\n\
                command = { column = \"c\", unit = \"N\" }\n\
                [[terms]]\nname = \"c\"\nexpr = \"command\"\nfixed = 1.0\n\
                [[terms]]\nname = \"square\"\nexpr = \"command * command\"\n";
    let rows = 8000;
    let mut rng = residual_columns::stats::Rng::new(3);
    let at = |i: usize| 0.02 * i as f64;
    let command: Vec<f64> = (0..rows)
        .map(|i| 3.0 + (0.9 * at(i)).sin() + 0.7 * (2.3 * at(i)).sin())
        .collect();
    let target = command
        .iter()
        .map(|c| 1.05 * c + 0.01 * c * c + 0.05 * rng.normal());
    let columns = [("target", target.collect()), ("command", command.clone())];
    let data = residual::Data::from_columns((0..rows).map(at).collect(), columns)
        .sequences((0..8).map(|k| k * rows / 8..(k + 1) * rows / 8))
        .build()
        .unwrap();
    let spec = residual_log::spec::Spec::parse(spec).unwrap();
    let report = residual::analyse(&spec, data, &mut ()).unwrap();
    assert_eq!(
        report.verdict,
        residual::Verdict::Effect,
        "{}",
        report.markdown()
    );
    assert_eq!(report.effects[0].name, EffectKind::Gain);
}

#[test]
fn is_named() {
    crate::rig::names("gain", |s| 0.1 * s.command);
}
