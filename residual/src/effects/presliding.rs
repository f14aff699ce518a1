//! What friction does at rest and just after a reversal: the direction it holds.

use super::{Build, Context, Effect, EffectKind, Form, Friction, Piece, Psi, Variant};
use crate::stats;

pub(crate) struct Presliding;

impl Effect for Presliding {
    fn kind(&self) -> EffectKind {
        EffectKind::Presliding
    }
    fn meaning(&self) -> &'static str {
        "presliding: at rest friction holds the direction of the last motion, and turns over a short distance before the next"
    }
    fn experiment(&self) -> &'static str {
        "stop, reverse over a distance far below one turn, and log position finely: the force follows a short elastic loop"
    }
    fn against(&self, ctx: &Context) -> String {
        let db = ctx.deadband;
        match &ctx.velocity {
            None => ctx.load.clone(),
            // Rows in motion are other effects' business; they all lie at 0.
            Some(v) if ctx.rests() => {
                format!("(held({v}, {db}) - sgn({v}, {db})) * {}", ctx.load)
            }
            Some(v) => format!("held({v}, {db})"),
        }
    }
    fn friction(&self) -> Option<Friction> {
        Some(Friction::AtRest)
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(v), Some(x)) = (ctx.velocity.clone(), ctx.position.clone()) else {
            return vec![];
        };
        let db = ctx.deadband;
        let unit = ctx.unit().to_string();
        let mut out = Vec::new();
        let rests = ctx.rests();
        if rests && !ctx.friction {
            // Dry friction in motion and at rest as one: a stop does not let go of it.
            out.push(
                Variant::linear(
                    "friction that stays at rest",
                    vec![Piece::new(
                        "friction",
                        unit.clone(),
                        format!("held({v}, {db})"),
                    )],
                )
                .form(Form::MotionAndRest),
            );
        }
        if rests {
            // Only the rows at rest: what moves is friction's own business.
            let held = format!("(held({v}, {db}) - sgn({v}, {db}))");
            out.push(
                Variant::linear(
                    "direction held",
                    vec![Piece::new("held_friction", unit.clone(), held.clone())],
                )
                .form(Form::AtRest),
            );
            let load = ctx.load.clone();
            let loaded = ctx.range(&load).is_some();
            if loaded {
                out.push(
                    Variant::linear(
                        "direction held, with load",
                        vec![
                            Piece::new("held_friction", unit.clone(), held.clone()),
                            Piece::new(
                                "held_friction_per_load",
                                "1",
                                format!("{held} * abs({load})"),
                            ),
                        ],
                    )
                    .form(Form::AtRestWithLoad),
                );
            }
            // Before the first motion of a run nobody knows which way the friction lies: its mean is
            // a parameter of its own, or other effects would be bent to explain it.
            let unknown = format!("(held({v}, {db}) == 0)");
            let waiting = stats::mean(&ctx.values(&unknown)) > 0.002;
            let (v2, unit2) = (v.clone(), unit.clone());
            out.push(Variant::profiled(
                "held, then turning before the next motion",
                Psi {
                    name: "turning_time",
                    unit: "s".into(),
                    grid: Context::log_grid(0.5 * ctx.dt, 40.0 * ctx.dt, 10),
                    refine: true,
                    resolution: None,
                },
                move |tau| {
                    let ahead = format!("ahead({v2}, {db}, {tau})");
                    let mut p = vec![
                        Piece::new("held_friction", unit2.clone(), held.clone()),
                        Piece::new("turning_friction", unit2.clone(), ahead.clone()),
                    ];
                    if loaded {
                        p.push(Piece::new(
                            "held_friction_per_load",
                            "1",
                            format!("{held} * abs({load})"),
                        ));
                        p.push(Piece::new(
                            "turning_friction_per_load",
                            "1",
                            format!("{ahead} * abs({load})"),
                        ));
                    }
                    if waiting {
                        p.push(Piece::new(
                            "before_first_motion",
                            unit2.clone(),
                            unknown.clone(),
                        ));
                    }
                    Build::Add(p)
                },
            ));
        }
        if let Some((lo, hi)) = ctx.range(&x) {
            // Longer turning distances are hysteresis's.
            let grid = Context::log_grid(2e-4 * (hi - lo), 0.018 * (hi - lo), 11);
            let psi = Psi {
                name: "presliding_distance",
                unit: ctx.position_unit(),
                grid,
                refine: true,
                resolution: None,
            };
            let (friction, loaded) = (ctx.friction, ctx.range(&ctx.load).is_some());
            let load = ctx.load.clone();
            out.push(
                Variant::profiled("elastic turn", psi, move |d| {
                    let state = format!("dahl({x}, {d})");
                    if !friction {
                        return Build::Add(vec![Piece::new("friction", unit.clone(), state)]);
                    }
                    // Friction is in the model already: only what differs from its jump is new.
                    let turn = format!("({state} - sgn({v}, {db}))");
                    let mut p = vec![Piece::new("turning_friction", unit.clone(), turn.clone())];
                    if loaded {
                        p.push(Piece::new(
                            "turning_friction_per_load",
                            "1",
                            format!("{turn} * abs({load})"),
                        ));
                    }
                    Build::Add(p)
                })
                .form(Form::ElasticTurn),
            );
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use crate::effects::testbench::{names_with, Excitation};

    #[test]
    fn is_named() {
        let mut last = 0.0;
        names_with(
            "presliding",
            Excitation {
                declare_coulomb: true,
                stops: true,
                ..Excitation::default()
            },
            move |s| {
                if s.first {
                    last = 0.0;
                }
                if s.velocity != 0.0 {
                    last = s.velocity.signum();
                    0.0
                } else {
                    -0.6 * last
                }
            },
        );
    }
}
