//! A loop with memory of the path, over a good part of the range.

use super::{
    Build, Context, Effect, EffectKind, Estimate, Form, Lookalike, Nature, Piece, Psi, Variant,
};

pub struct Hysteresis;

/// Narrowest and widest turn, as a share of the range and of the largest excursion within one run.
/// A loop that never comes round within a run is a spring.
const WIDTHS: (f64, f64) = (0.025, 0.8);

/// Standard errors by which another law of friction must predict worse than a loop.
const EXCLUDED_FROM: f64 = 2.5;

impl Effect for Hysteresis {
    fn kind(&self) -> EffectKind {
        EffectKind::Hysteresis
    }
    /// A narrower loop is the elastic turn of presliding: friction that turns, too.
    fn may_be_at_end(&self, _: &Variant) -> [bool; 2] {
        [true, false]
    }
    /// The turn of a loop is told from a sudden one only where the data show reversals well.
    fn lookalikes(&self, ctx: &Context) -> Vec<Lookalike> {
        let laws = [
            EffectKind::Coulomb,
            EffectKind::LoadDependentCoulomb,
            EffectKind::Presliding,
        ];
        let mut out = Lookalike::of(&laws, EXCLUDED_FROM, ctx);
        // An elastic turn is the same formula with a shorter distance: the fitted distance decides
        // on the name.
        out.retain(|other| other.form.form != Form::ElasticTurn);
        out
    }
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let (column, position) = if e.label.contains("position") {
            ("angle", true)
        } else {
            ("command", false)
        };
        let driver = ctx.position.as_ref().filter(|_| position);
        let driver = driver.unwrap_or(&ctx.load);
        e.below_step("turning_width", ctx.step_of(column), column)
            .or_else(|| {
                let widest = WIDTHS.1 * ctx.excursion(driver);
                let why = "within no run does it move so far that the loop could turn";
                e.outside("turning_width", 0.0, widest, why)
            })
    }
    fn axes(&self, form: &Variant, _: f64, ctx: &Context) -> Vec<String> {
        match &ctx.position {
            Some(x) if form.label.contains("position") => vec![x.clone()],
            _ => vec![ctx.load.clone()],
        }
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let mut drivers = Vec::new();
        if ctx.has_command() {
            drivers.push(("load", ctx.load.clone(), ctx.unit().to_string()));
        }
        // Only its changes count, so one that is integrated from the velocity does as well.
        if let Some(x) = &ctx.position {
            drivers.push(("position", x.clone(), ctx.position_unit()));
        }
        let unit = ctx.unit().to_string();
        let grid = |name: &str, x: &str| {
            let (lo, hi) = ctx.range(x)?;
            let excursion = ctx.excursion(x);
            // Shorter turning widths of the position belong to `presliding`.
            let range = if name == "position" {
                hi - lo
            } else {
                excursion.min(hi - lo)
            };
            let (narrow, wide) = (WIDTHS.0 * range, WIDTHS.1 * excursion);
            (wide > 1.5 * narrow).then(|| (Context::log_grid(narrow, wide, 11), wide))
        };
        let width = |unit: &str, grid: Vec<f64>| Psi::new("turning_width", unit, grid);
        let mut out = Vec::new();
        for (name, x, xu) in drivers {
            let Some((grid, widest)) = grid(name, &x) else {
                continue;
            };
            // Dry friction that a loop of the position works against would drive the motion.
            let physical = |form: Variant| {
                let form = form.possible(move |width, _| width <= widest);
                if name == "position" {
                    form.along_friction(0)
                } else {
                    form
                }
            };
            // That of a load is no friction.
            let nature = match name {
                "position" => Nature::Friction,
                _ => Nature::Other,
            };
            // Gradual turns as of Dahl's model, sharp ones as of a spring that slips.
            let (dahl, own) = (x.clone(), unit.clone());
            out.push(physical(Variant::profiled(
                &format!("loop of {name}"),
                width(&xu, grid.clone()),
                move |d| {
                    let text = format!("dahl({dahl}, {d})");
                    Build::Add(vec![
                        Piece::new("half_height", own.clone(), text).being(nature)
                    ])
                },
            )));
            if name != "position" {
                continue;
            }
            let (stop, own) = (x.clone(), unit.clone());
            out.push(physical(Variant::profiled(
                "loop of position with sharp corners",
                width(&xu, grid.clone()),
                move |d| {
                    let text = format!("stop({stop}, {d}) * {}", 2.0 / d);
                    Build::Add(vec![
                        Piece::new("half_height", own.clone(), text).being(nature)
                    ])
                },
            )));
            if ctx.range(&ctx.load).is_none() {
                continue;
            }
            let by = ctx.measure();
            out.push(physical(Variant::profiled(
                "loop of position, in proportion to load",
                width(&xu, grid),
                move |d| {
                    let name = format!("half_height{}", by.suffix);
                    let text = format!("dahl({x}, {d}) * {}", by.text);
                    Build::Add(vec![Piece::new(name, by.unit.clone(), text).being(nature)])
                },
            )));
        }
        out
    }
}
