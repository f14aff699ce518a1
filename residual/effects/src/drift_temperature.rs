//! Drift with temperature, of zero or of gain.

use super::{ratio, Build, Context, Effect, EffectKind, Estimate, Nature, Piece, Psi, Variant};

use residual_columns::format::num;

pub struct DriftTemperature;

impl Effect for DriftTemperature {
    fn kind(&self) -> EffectKind {
        EffectKind::DriftTemperature
    }
    fn against(&self, _: &Context) -> String {
        "temperature".into()
    }
    fn impossible(&self, _: &Estimate, ctx: &Context) -> Option<String> {
        let (width, step) = (ctx.width("temperature"), ctx.step_of("temperature"));
        (width <= 2.0 * step).then(|| {
            format!(
                "the temperature moves by {} only, in steps of {}",
                num(width),
                num(step)
            )
        })
    }
    /// With a lag that is too short to be seen it is the drift without one.
    fn may_be_at_end(&self, _: &Variant) -> [bool; 2] {
        [true, false]
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        if ctx.spec.roles.temperature.is_none() {
            return vec![];
        }
        let Some((lo, hi)) = ctx.range("temperature") else {
            return vec![];
        };
        let mid = 0.5 * (lo + hi);
        let k = ctx.spec.roles.unit("temperature");
        let per = ctx.per(&k);
        let mut out = vec![Variant::linear(
            "of zero",
            vec![
                Piece::new(
                    "drift_per_degree",
                    per.clone(),
                    format!("temperature - {mid}"),
                ),
                // The temperature of no error is unknown: it comes as the error at mid-range.
                Piece::new("error_at_mid_range", ctx.unit(), "1").being(Nature::Beside),
            ],
        )];
        for (of, force) in ctx.sensed() {
            if ctx.range(&force).is_none() {
                continue;
            }
            let text = format!("(temperature - {mid}) * {force}");
            out.push(Variant::linear(
                &format!("of gain, over {of}"),
                vec![
                    Piece::new("gain_per_degree", ratio("1", &k), text),
                    // Nor is the temperature of the right gain known.
                    Piece::new("gain_error_at_mid_range", "1", ctx.load.clone())
                        .being(Nature::Beside),
                ],
            ));
        }
        let grid = Context::log_grid(20.0 * ctx.dt, ctx.span, 8);
        out.push(Variant::profiled(
            "of zero, as it warms through",
            Psi::new("time_constant", "s", grid),
            move |tau| {
                Build::Add(vec![Piece::new(
                    "drift_per_degree",
                    per.clone(),
                    format!("lowpass(temperature, {tau}) - {mid}"),
                )])
            },
        ));
        out
    }
}
