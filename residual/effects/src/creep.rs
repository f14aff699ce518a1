//! Creep: a slow part of the response of sensor or cable to a load.

use super::{Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant};

pub struct Creep;

/// Largest share by which a compensated sensor creeps the wrong way.
const OVERDONE: f64 = 0.05;

/// Shares of the response that creep can be.
const SHARE: (f64, f64) = (-OVERDONE, 1.0);

/// Shortest and longest time constant, in rows and in spans of the longest run.
const FASTEST_ROWS: f64 = 15.0;
const LONGEST_SPANS: f64 = 2.0;

impl Effect for Creep {
    fn kind(&self) -> EffectKind {
        EffectKind::Creep
    }
    fn against(&self, _: &Context) -> String {
        "elapsed".into()
    }
    /// A share of the response is between nothing and all of it. Load cells creep by some
    /// thousandths, and their compensation may overdo it.
    fn impossible(&self, e: &Estimate, ctx: &Context) -> Option<String> {
        let share = "a share of the response lies between 0 and 1";
        e.outside("creep_share", SHARE.0, SHARE.1, share)
            .or_else(|| {
                let (low, high) = (FASTEST_ROWS * ctx.dt, LONGEST_SPANS * ctx.span);
                let why = "outside of what rows and runs of this length can show";
                e.outside("time_constant", 0.99 * low, 1.01 * high, why)
                    .or_else(|| {
                        e.may_be_below("time_constant", low, "so fast a creep is a gain or a lag")
                    })
            })
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        if ctx.range(&ctx.load).is_none() {
            return vec![];
        }
        // Under a load that never changes within a run, creep is like any other start-up transient.
        let size = residual_columns::stats::rms(&ctx.values(&ctx.load));
        let change = residual_columns::stats::rms(
            &ctx.values(&format!("{} - seqmean({})", ctx.load, ctx.load)),
        );
        if change < 0.02 * size {
            return vec![];
        }
        let grid = Context::log_grid(FASTEST_ROWS * ctx.dt, LONGEST_SPANS * ctx.span, 12);
        let psi = || Psi::new("time_constant", "s", grid.clone());
        let (a, b) = (ctx.load.clone(), ctx.load.clone());
        vec![
            Variant::profiled("since the load came on", psi(), move |tau| {
                Build::Add(vec![Piece::new(
                    "creep_share",
                    "1",
                    format!("charge({a}, {tau})"),
                )])
            })
            .between(&[SHARE]),
            Variant::profiled("about an old equilibrium", psi(), move |tau| {
                Build::Add(vec![Piece::new(
                    "creep_share",
                    "1",
                    format!("lowpass({b}, {tau}) - {b}"),
                )])
            })
            .between(&[SHARE]),
        ]
    }
}
