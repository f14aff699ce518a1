//! An error that depends on the pose.

use super::gravity_angle::weights;
use super::{ratio, Context, Effect, EffectKind, Lookalike, Piece, Variant};

pub struct Geometry;

impl Effect for Geometry {
    fn kind(&self) -> EffectKind {
        EffectKind::Geometry
    }
    fn repeatable(&self) -> bool {
        true
    }
    /// Over an arc in which noise hides its curve, the weight of a link is a line or a parabola
    /// over an angle of the pose.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        weights(ctx)
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let names = ctx.spec.roles.pose.keys();
        match names
            .clone()
            .find(|n| form.label.ends_with(&format!(" in {n}")))
        {
            Some(own) => vec![own.clone()],
            None => names.cloned().collect(),
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let l = &ctx.load;
        let poses: Vec<(&String, String)> = ctx
            .spec
            .roles
            .pose
            .iter()
            .filter(|(n, _)| ctx.range(n).is_some())
            .map(|(n, c)| (n, c.unit.clone()))
            .collect();
        let mut out = Vec::new();
        for (n, u) in &poses {
            let (a, b) = (ctx.per(u), ctx.per(&format!("{u}^2")));
            let line = Piece::new(format!("per_{n}"), a, (*n).clone());
            let load = Piece::new(
                format!("per_{n}_and_load"),
                ratio("1", u),
                format!("{n} * {l}"),
            );
            out.push(Variant::linear(&format!("line in {n}"), vec![line.clone()]));
            out.push(Variant::linear(
                &format!("curve in {n}"),
                vec![
                    line,
                    Piece::new(format!("per_{n}_squared"), b, format!("{n}^2")),
                ],
            ));
            out.push(Variant::linear(
                &format!("share of load, line in {n}"),
                vec![load.clone()],
            ));
            let square = Piece::new(
                format!("per_{n}_squared_and_load"),
                ratio("1", &format!("{u}^2")),
                format!("{n}^2 * {l}"),
            );
            out.push(Variant::linear(
                &format!("share of load, curve in {n}"),
                vec![load, square],
            ));
        }
        if poses.len() > 1 {
            let lines = poses
                .iter()
                .map(|(n, u)| Piece::new(format!("per_{n}"), ctx.per(u), (*n).clone()))
                .collect();
            out.push(Variant::linear("line in all of the pose", lines));
            let loads = poses
                .iter()
                .map(|(n, u)| {
                    Piece::new(
                        format!("per_{n}_and_load"),
                        ratio("1", u),
                        format!("{n} * {l}"),
                    )
                })
                .collect();
            out.push(Variant::linear(
                "share of load, line in all of the pose",
                loads,
            ));
        }
        out
    }
}
