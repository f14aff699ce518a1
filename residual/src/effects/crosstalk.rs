//! A neighbour's signal in this one.

use super::{Context, Effect, EffectKind, Piece, Variant};

pub(crate) struct Crosstalk;

impl Effect for Crosstalk {
    fn kind(&self) -> EffectKind {
        EffectKind::Crosstalk
    }
    fn meaning(&self) -> &'static str {
        "crosstalk: a share of another channel shows in the target"
    }
    fn experiment(&self) -> &'static str {
        "excite the other channel alone"
    }
    fn against(&self, ctx: &Context) -> String {
        let channels = &ctx.spec.roles.channels;
        match channels.keys().next() {
            Some(only) if channels.len() == 1 => only.clone(),
            _ => ctx.load.clone(),
        }
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        ctx.spec
            .roles
            .channels
            .iter()
            .filter(|(n, _)| ctx.range(n).is_some())
            .map(|(n, c)| {
                Variant::linear(
                    n,
                    vec![Piece::new(
                        format!("share_of_{n}"),
                        ctx.per(&c.unit),
                        n.clone(),
                    )],
                )
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn is_named() {
        crate::effects::testbench::names("crosstalk", |s| 0.2 * s.neighbour);
    }
}
