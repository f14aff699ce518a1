//! A sine of constant frequency: mains, a fan, an alias of something faster.

use super::{
    amplitude_phase, spectrum, Build, Context, Effect, EffectKind, Estimate, Piece, Psi, Variant,
};

pub(crate) struct Tone;

impl Effect for Tone {
    fn kind(&self) -> EffectKind {
        EffectKind::Tone
    }
    fn meaning(&self) -> &'static str {
        "a tone of constant frequency in time, independent of the motion (mains, fan, or the alias of something above half the row rate)"
    }
    fn experiment(&self) -> &'static str {
        "log at rest with the drive off, at two sampling rates: a true tone keeps its frequency, an alias moves"
    }
    fn against(&self, _: &Context) -> String {
        "elapsed".into()
    }
    fn repeatable(&self) -> bool {
        true
    }
    fn impossible(&self, e: &Estimate, _: &Context) -> Option<String> {
        e.vague("frequency")
    }
    fn variants(&self, ctx: &Context) -> Vec<Variant> {
        let time = ctx.values("time");
        let highest = spectrum::highest_frequency(ctx.problem, &time, 0.5);
        let lowest = (5.0 / ctx.span).min(0.2 * highest);
        let inputs: Vec<Vec<f64>> = ctx
            .velocity
            .iter()
            .cloned()
            .chain(ctx.has_command().then(|| "command".to_string()))
            .chain(ctx.spec.roles.pose.keys().cloned())
            .map(|e| ctx.values(&e))
            .filter(|v| !v.is_empty())
            .collect();
        let mut driven = None;
        let mut out = Vec::new();
        for (label, local) in [("one phase for all", false), ("a phase for each run", true)] {
            let mut grid = spectrum::proposals(
                ctx,
                &time,
                &[],
                &spectrum::Look {
                    lowest,
                    highest,
                    coherent: !local,
                    lines: true,
                },
            );
            // At a frequency at which the rig itself is driven, a tone cannot be told from an answer.
            grid.retain(|f| spectrum::share(ctx.problem, &time, &inputs, *f) < 0.1);
            if grid.is_empty() {
                continue;
            }
            // Neither at a harmonic of a motion that repeats, however small it is there.
            let driven = driven.get_or_insert_with(|| driven_lines(ctx, &time, highest));
            grid.retain(|f| !driven.iter().any(|d| d.has(*f)));
            if grid.is_empty() {
                continue;
            }
            let unit = ctx.unit().to_string();
            out.push(
                Variant::profiled(
                    label,
                    Psi {
                        name: "frequency",
                        unit: "Hz".into(),
                        grid,
                        refine: true,
                        resolution: Some(0.6 / ctx.span),
                    },
                    move |f| {
                        let w = f * std::f64::consts::TAU;
                        let pieces = vec![
                            Piece::new("sine", unit.clone(), format!("sin({w} * time)")),
                            Piece::new("cosine", unit.clone(), format!("cos({w} * time)")),
                        ];
                        if local {
                            Build::Local(pieces)
                        } else {
                            Build::Add(pieces)
                        }
                    },
                )
                .with(amplitude_phase),
            );
        }
        out
    }
}

/// The spectrum of an input.
struct Driven {
    spectrum: spectrum::Spectrum,
    /// Whether a closed loop can have put the line there: only a harmonic of the input's own repetition counts then.
    answers: bool,
}

impl Driven {
    /// Whether the rig is driven at a frequency.
    fn has(&self, frequency: f64) -> bool {
        self.spectrum.line_at(frequency) && (!self.answers || self.spectrum.is_harmonic(frequency))
    }
}

/// Spectra of the inputs that say when the rig is driven: command, load, velocity, poses, their slopes, and the sign of the
/// velocity. A tone of the mains that a channel picks up as well is no drive, so channels are not among them.
fn driven_lines(ctx: &Context, time: &[f64], highest: f64) -> Vec<Driven> {
    // In a closed loop the command answers to the tone; the setpoint, where it is logged, says what drives the rig.
    let mut texts: Vec<(String, bool)> = if ctx.spec.roles.setpoint.is_some() {
        vec![("setpoint".into(), false)]
    } else if ctx.has_command() {
        vec![(ctx.load.clone(), true), ("command".into(), true)]
    } else {
        vec![(ctx.load.clone(), false)]
    };
    texts.extend(ctx.velocity.iter().cloned().map(|v| (v, false)));
    texts.extend(ctx.spec.roles.pose.keys().cloned().map(|q| (q, false)));
    let slopes: Vec<(String, bool)> = texts
        .iter()
        .map(|(t, answers)| (format!("deriv({t}, 1)"), *answers))
        .collect();
    texts.extend(slopes);
    texts.extend(
        ctx.velocity
            .iter()
            .map(|v| (format!("sgn({v}, {})", ctx.deadband), false)),
    );
    texts
        .iter()
        .map(|(t, answers)| (ctx.values(t), *answers))
        .filter(|(v, _)| v.len() == time.len())
        .filter_map(|(v, answers)| {
            let spectrum = spectrum::Spectrum::new(ctx.problem, time, &v, highest, false)?;
            Some(Driven { spectrum, answers })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    /// A sine of the motion, cut at both ends, has harmonics: what answers to them is no tone.
    #[test]
    fn a_harmonic_of_a_repeating_motion_is_no_tone() {
        use crate::effects::testbench::{simulate, Excitation};
        let motion = Excitation {
            repeats: true,
            ..Excitation::default()
        };
        let report = simulate(&motion, 1.0, &mut |s| {
            0.2 * (std::f64::consts::TAU * 5.0 * 0.4 * s.elapsed).sin()
        });
        let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
        assert!(!names.contains(&"tone"), "{}", report.markdown());
    }

    #[test]
    fn is_named() {
        crate::effects::testbench::names("tone", |s| {
            0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
        });
    }
}
