//! A neighbour's signal in this one.

use super::{Context, Effect, EffectKind, Estimate, Piece, Variant};

use residual_columns::format::num;

pub struct Crosstalk;

impl Effect for Crosstalk {
    fn kind(&self) -> EffectKind {
        EffectKind::Crosstalk
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let share = e.params.first()?;
        // Units differ where the channel is no force.
        (share.unit == "1" && share.value.abs() > 1.0)
            .then(|| format!("{} {}: more than all of it", share.name, num(share.value)))
            .filter(|_| !ctx.unit().is_empty())
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let names = ctx.spec.roles.channels.keys();
        match names.clone().find(|n| **n == form.label) {
            Some(own) => vec![own.clone()],
            None => names.cloned().collect(),
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let channels = ctx.spec.roles.channels.iter();
        let shares: Vec<(&String, Piece)> = channels
            .filter(|(n, _)| ctx.range(n).is_some())
            .map(|(n, c)| {
                let name = format!("share_of_{n}");
                (n, Piece::new(name, ctx.per(&c.unit), n.clone()))
            })
            .collect();
        let mut out: Vec<Variant> = shares
            .iter()
            .map(|(n, share)| Variant::linear(n, vec![share.clone()]))
            .collect();
        if shares.len() > 1 {
            let all = shares.into_iter().map(|(_, share)| share).collect();
            out.push(Variant::linear("all channels", all));
        }
        out
    }
}
