//! What friction does at rest and just after a reversal: the direction it holds.

use super::context::Measure;
use super::{
    Build, Context, Effect, EffectKind, Estimate, Form, Friction, Nature, Piece, Psi, Variant,
};
use residual_columns::stats;
use residual_fit::problem::Direction;

pub struct Presliding;

/// Rows within which friction may seem to turn before a motion begins that has begun: the velocity
/// is still in its deadband.
const SOONEST_ROWS: f64 = 2.0;

impl Effect for Presliding {
    fn kind(&self) -> EffectKind {
        EffectKind::Presliding
    }
    fn friction(&self) -> Option<Friction> {
        Some(Friction::AtRest)
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        e.below_step("presliding_distance", ctx.step_of("angle"), "angle")
    }
    /// Friction that turns over a distance too short to see still holds its direction at rest. A
    /// longer one is that of a hysteresis.
    fn may_be_at_end(&self, form: &Variant) -> [bool; 2] {
        [form.form == Form::ElasticTurn, false]
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        let (Some(v), Some(x), Some(d)) = (&ctx.velocity, &ctx.position, &ctx.direction) else {
            return vec![];
        };
        let at_rest = held(d);
        match form.form {
            Form::ElasticTurn => vec![x.clone()],
            Form::MotionAndRest => vec![v.clone()],
            _ => vec![
                // Rows in motion show other effects; they all lie at 0.
                format!("{at_rest} * {}", ctx.load),
                at_rest,
            ],
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let (Some(direction), Some(position)) = (&ctx.direction, &ctx.position) else {
            return vec![];
        };
        let forms = Forms {
            ctx,
            direction,
            position,
            loaded: ctx.range(&ctx.load).is_some(),
        };
        let mut out = Vec::new();
        if ctx.rests() {
            out.extend(forms.motion_and_rest());
            out.extend(forms.at_rest());
            out.push(forms.turning());
        }
        out.extend(forms.elastic_turn(false));
        if forms.loaded && !ctx.friction {
            out.extend(forms.elastic_turn(true));
        }
        out
    }
}

/// What the forms are made from.
struct Forms<'a> {
    ctx: &'a Context<'a>,
    direction: &'a Direction,
    position: &'a str,
    /// Whether the load varies.
    loaded: bool,
}

impl Forms<'_> {
    /// The direction held at rest, 0 in motion, where other friction acts.
    fn held(&self) -> String {
        held(self.direction)
    }

    /// A coefficient in the target's unit.
    fn constant(&self, name: &str, text: String) -> Piece {
        Piece::new(name, self.ctx.unit(), text)
    }

    /// A coefficient per unit of load.
    fn per_load(&self, name: &str, text: &str) -> Piece {
        per_load(&self.ctx.measure(), name, text)
    }

    /// Dry friction in motion and at rest under one coefficient: it stays during a stop.
    fn motion_and_rest(&self) -> Option<Variant> {
        if self.ctx.friction {
            return None;
        }
        let text = self.direction.held();
        let pieces = vec![self.constant("friction", text).being(Nature::Friction)];
        Some(Variant::linear("friction that stays at rest", pieces).form(Form::MotionAndRest))
    }

    /// Friction at rest alone, without and with its share of load.
    fn at_rest(&self) -> Vec<Variant> {
        let held = self
            .constant("held_friction", self.held())
            .being(Nature::Friction);
        let mut out =
            vec![Variant::linear("direction held", vec![held.clone()]).form(Form::AtRest)];
        if self.loaded {
            let pieces = vec![held, self.per_load("held_friction", &self.held())];
            out.push(
                Variant::linear("direction held, with load", pieces).form(Form::AtRestWithLoad),
            );
        }
        out
    }

    /// Friction at rest that turns before the next motion begins.
    fn turning(&self) -> Variant {
        let (ctx, direction) = (self.ctx, self.direction.clone());
        let at_rest = vec![self
            .constant("held_friction", self.held())
            .being(Nature::Friction)];
        let mut held_per_load = Vec::new();
        if self.loaded {
            held_per_load.push(self.per_load("held_friction", &self.held()));
        }
        // Before the first motion of a run the direction of friction is unknown. Its mean is a
        // parameter of its own, so that other effects do not have to explain it.
        let unknown = format!("({} == 0)", direction.held());
        let mut waiting = Vec::new();
        if stats::mean(&ctx.values(&unknown)) > 0.002 {
            waiting.push(
                self.constant("before_first_motion", unknown)
                    .being(Nature::Beside),
            );
        }
        let (unit, by, loaded) = (ctx.unit().to_string(), ctx.measure(), self.loaded);
        let (soonest, longest) = (SOONEST_ROWS * ctx.dt, 40.0 * ctx.dt);
        let psi = Psi::new("turning_time", "s", Context::log_grid(soonest, longest, 10));
        let label = "held, then turning before the next motion";
        Variant::profiled(label, psi, move |tau| {
            let ahead = format!("ahead({}, {}, {tau})", direction.of, direction.band);
            let mut p = at_rest.clone();
            p.push(Piece::new("turning_friction", unit.clone(), ahead.clone()));
            p.extend(held_per_load.clone());
            if loaded {
                p.push(per_load(&by, "turning_friction", &ahead));
            }
            p.extend(waiting.clone());
            Build::Add(p)
        })
        .possible(move |tau, _| tau >= soonest)
    }

    /// The elastic turn of Dahl's model over a short distance; friction `of_load` is a share of it.
    fn elastic_turn(&self, of_load: bool) -> Option<Variant> {
        let (lo, hi) = self.ctx.range(self.position)?;
        // Longer turning distances belong to `hysteresis`.
        let psi = Psi::new(
            "presliding_distance",
            self.ctx.position_unit(),
            Context::log_grid(2e-4 * (hi - lo), 0.018 * (hi - lo), 11),
        );
        let (x, sign) = (self.position.to_string(), self.direction.sign());
        let (unit, by) = (self.ctx.unit().to_string(), self.ctx.measure());
        let (friction, loaded) = (self.ctx.friction, self.loaded);
        let build = move |d: f64| {
            let state = format!("dahl({x}, {d})");
            if of_load {
                return Build::Add(vec![per_load(&by, "friction", &state)]);
            }
            if !friction {
                return Build::Add(vec![
                    Piece::new("friction", unit.clone(), state).being(Nature::Friction)
                ]);
            }
            // Friction is in the model already: only what differs from its jump is new.
            let turn = format!("({state} - {sign})");
            let mut p = vec![Piece::new("turning_friction", unit.clone(), turn.clone())];
            if loaded {
                p.push(per_load(&by, "turning_friction", &turn));
            }
            Build::Add(p)
        };
        let label = if of_load {
            "elastic turn, in proportion to load"
        } else {
            "elastic turn"
        };
        Some(Variant::profiled(label, psi, build).form(Form::ElasticTurn))
    }
}

/// The direction held at rest, 0 in motion, where other friction acts.
fn held(direction: &Direction) -> String {
    format!("({} - {})", direction.held(), direction.sign())
}

/// A coefficient per unit of what friction grows with.
fn per_load(by: &Measure, name: &str, text: &str) -> Piece {
    let name = format!("{name}{}", by.suffix);
    Piece::new(name, by.unit.clone(), format!("{text} * {}", by.text))
}
