//! A sine of constant frequency: mains, a fan, an alias of something faster.

/// A sine of the motion, cut at both ends, has harmonics: what answers to them is no tone.
#[test]
fn a_harmonic_of_a_repeating_motion_is_no_tone() {
    use crate::rig::{simulate, Excitation};
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

/// An angle of one speed, here 0.5 turns per second: seven sines a turn are a ripple, not a tone.
#[test]
fn a_ripple_at_constant_speed_is_no_tone() {
    use residual::{analyse, spec::Spec, Data};
    let (rows, dt) = (2000, 0.01);
    let mut rng = residual_columns::stats::Rng::new(3);
    let time: Vec<f64> = (0..2 * rows).map(|i| (i % rows) as f64 * dt).collect();
    // The second run turns back.
    let angle: Vec<f64> = (0..2 * rows)
        .map(|i| {
            if i < rows {
                time[i] * 0.5
            } else {
                7.3 - time[i] * 0.5
            }
        })
        .map(|turns| turns * std::f64::consts::TAU)
        .collect();
    let target = angle.iter().map(|a| (7.0 * a).sin() + 0.1 * rng.normal());
    let target: Vec<f64> = target.collect();
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N\" }\n\
         roles.angle = { column = \"a\", unit = \"rad\" }\n\
         [[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
    let data = Data::from_columns(time, [("angle", angle), ("target", target)])
        .sequences([0..rows, rows..2 * rows])
        .groups((0..2 * rows).map(|i| i / 400).collect())
        .build()
        .unwrap();
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let names: Vec<&str> = report.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["periodic_angle"], "{}", report.markdown());
    assert!((report.effects[0].params["order"] - 7.0).abs() < 0.01);
}

/// Of two tones with phases of their own in each run, each has its own amplitude.
#[test]
fn two_tones_have_an_amplitude_each() {
    let report = crate::rig::simulate(&Default::default(), 1.0, &mut |s| {
        let wave = |f: f64, phase: f64| {
            let group = f64::from(s.group);
            (std::f64::consts::TAU * f * s.elapsed + phase * group).sin()
        };
        0.3 * wave(3.7, 1.0) + 0.1 * wave(5.3, 2.3)
    });
    let tones: Vec<f64> = (report.effects.iter())
        .filter(|e| e.name == "tone")
        .map(|e| e.params["amplitude"])
        .collect();
    assert_eq!(tones.len(), 2, "{}", report.markdown());
    for (found, truth) in tones.iter().zip([0.3, 0.1]) {
        assert!((found / truth - 1.0).abs() < 0.1, "{tones:?}");
    }
}

#[test]
fn is_named() {
    crate::rig::names("tone", |s| {
        0.3 * (std::f64::consts::TAU * 3.7 * s.elapsed + f64::from(s.group)).sin()
    });
}

/// The tones that are found, in Hz, in values that were measured at some times and stamped with
/// others, in s.
fn tones(times: &[f64], stamps: Vec<f64>, truth: &[(f64, f64)]) -> Vec<f64> {
    use residual::{analyse, spec::Spec, Data};
    let mut rng = residual_columns::stats::Rng::new(3);
    let mut value = |t: &f64| -> f64 {
        let sine = |(f, a): &(f64, f64)| a * (std::f64::consts::TAU * f * t + 0.4).sin();
        truth.iter().map(sine).sum::<f64>() + 0.1 * rng.normal()
    };
    let target: Vec<f64> = times.iter().map(&mut value).collect();
    let half = stamps.len() / 2;
    let model = "roles.time = { column = \"t\", unit = \"s\" }\n\
         roles.target = { column = \"y\", unit = \"N\" }\n\
         [[terms]]\nname = \"zero\"\nexpr = \"1\"\n";
    let data = Data::from_columns(stamps, [("target", target)])
        .sequences([0..half, half..2 * half])
        .groups((0..2 * half).map(|i| i / 400).collect())
        .build()
        .unwrap();
    let report = analyse(&Spec::parse(model).unwrap(), data, &mut ()).unwrap();
    let mut out: Vec<f64> = (report.effects.iter())
        .filter(|e| e.name == "tone")
        .map(|e| e.params["frequency"])
        .collect();
    out.sort_by(f64::total_cmp);
    out
}

/// 80 rows in a second with stamps on a grid of 5 ms: 30 Hz show at 10 Hz, too.
#[test]
fn an_image_by_stamps_on_a_grid_is_no_tone() {
    let times: Vec<f64> = (0..4000).map(|k| f64::from(k) / 80.0).collect();
    let stamps = times.iter().map(|t| (t / 0.005 - 1e-9).ceil() * 0.005);
    let found = tones(&times, stamps.collect(), &[(30.0, 1.0)]);
    assert_eq!(found.len(), 1, "{found:?}");
    assert!((found[0] - 30.0).abs() < 0.05, "{found:?}");
}

/// 75 Hz are half of the row rate less 25 Hz, and no image of them.
#[test]
fn a_tone_beside_another_in_uneven_rows_is_a_tone() {
    let mut rng = residual_columns::stats::Rng::new(9);
    let times: Vec<f64> = (0..6000)
        .map(|k| (f64::from(k) + 0.25 * rng.normal().clamp(-1.6, 1.6)) / 200.0)
        .collect();
    let found = tones(&times, times.clone(), &[(25.0, 1.0), (75.0, 0.4)]);
    assert_eq!(found.len(), 2, "{found:?}");
    assert!((found[0] - 25.0).abs() < 0.05 && (found[1] - 75.0).abs() < 0.05);
}
