//! The rig without the emulated controller (`--link fast`) against the image in the embedded rig,
//! on the same seed and the same motion of the robot.
//!
//! Both draw the same chips, clocks, noise and physics from the seed and run the same machine and
//! control core. What differs are delays of some microseconds (`core_sim::timing`), so samples fall
//! at other times and noise at other places: traces differ by noise, figures little: over these
//! three seeds by up to 14 mN (tension), 4 mN (mean force), 21 mN (RMS of the force's error) and 98
//! mN (traces). One friction reversal that falls otherwise is some 10 mN of an RMS over 8 s.
//! docs/robot.md states the bounds below.

use run::{self, NoopObserver, Options, Outcome};
use session::link::fast::FastRig;
use session::link::{EmbeddedOptions, RigLink};
use test_stand::{rig, rig_file};

/// Largest difference of a cable's tension error, RMS over the run, N.
const TENSION_RMS_N: f64 = 0.025;
/// Largest difference of the mean force at the tip, N.
const MEAN_FORCE_N: f64 = 0.005;
/// Largest difference of the force error's RMS, N.
const FORCE_RMS_N: f64 = 0.03;
/// Largest RMS of the difference between the two traces of a cable's true tension, N: noise of
/// both, and friction that reverses some milliseconds earlier or later.
const TRACE_N: f64 = 0.15;

fn hold(link: &mut dyn RigLink, force_n: [f64; 3]) -> Outcome {
    run::set_force(
        link,
        &rig_file(),
        &Options::new(force_n, 8.0),
        &mut NoopObserver,
    )
    .unwrap_or_else(|error| panic!("{error}"))
}

fn fast(seed: u64) -> FastRig {
    let options = EmbeddedOptions {
        seed: Some(seed),
        ..EmbeddedOptions::default()
    };
    FastRig::open(&options).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn the_fast_rig_holds_a_force_as_the_image_does() {
    for (seed, force_n) in [
        (1, [0.0, 2.5, 0.0]),
        (2, [1.5, -1.0, 1.0]),
        (3, [0.0, -4.0, 0.0]),
    ] {
        let image = hold(&mut rig(seed), force_n);
        let fast = hold(&mut fast(seed), force_n);
        assert_eq!(image.ended, fast.ended);
        let of = |outcome: &Outcome| outcome.metrics.clone().expect("a run of 8 s has figures");
        let (a, b) = (of(&image), of(&fast));
        let mut worst = 0.0_f64;
        for unit in 0..6 {
            worst = worst.max((a.tension_rms_n[unit] - b.tension_rms_n[unit]).abs());
        }
        let mean = (0..3)
            .map(|axis| (a.applied_n[axis] - b.applied_n[axis]).powi(2))
            .sum::<f64>()
            .sqrt();
        let rms = (a.tip_force_rms_n - b.tip_force_rms_n).abs();
        let trace = trace_difference_n(&image, &fast);
        println!("seed {seed}: tension RMS {worst:.4} N, mean force {mean:.4} N, force RMS {rms:.4} N, traces {trace:.4} N");
        assert!(
            worst <= TENSION_RMS_N,
            "seed {seed}: tension RMS {worst:.4} N"
        );
        assert!(mean <= MEAN_FORCE_N, "seed {seed}: mean force {mean:.4} N");
        assert!(rms <= FORCE_RMS_N, "seed {seed}: force RMS {rms:.4} N");
        assert!(trace <= TRACE_N, "seed {seed}: traces {trace:.4} N");
        // The same motion, or the comparison means nothing.
        for (a, b) in image.steps.iter().zip(&fast.steps) {
            assert!((a.t_s - b.t_s).abs() < 1e-9);
            assert!((a.tip_m - b.tip_m).norm() < 2e-4);
        }
    }
}

/// RMS over the run of the difference of true tensions, the worst cable.
fn trace_difference_n(a: &Outcome, b: &Outcome) -> f64 {
    let mut squares = [0.0; 6];
    let mut count = 0.0;
    for (a, b) in a.steps.iter().zip(&b.steps).filter(|(a, _)| a.t_s > 0.5) {
        let (Some(a), Some(b)) = (a.true_tension_n, b.true_tension_n) else {
            panic!("both know the truth");
        };
        count += 1.0;
        for (square, (a, b)) in squares.iter_mut().zip(a.iter().zip(b)) {
            *square += (a - b).powi(2);
        }
    }
    (squares.iter().copied().fold(0.0, f64::max) / count).sqrt()
}

#[test]
fn a_pulled_plug_and_the_e_stop_end_the_same_way() {
    use emulator_link::Injection;
    for injection in [
        Injection::UnplugSensor(3),
        Injection::EStop(true),
        Injection::FreezeEncoder(4, true),
    ] {
        let mut options = Options::new([0.0, 2.5, 0.0], 3.0);
        options.injections = vec![(1.0, injection)];
        let of = |link: &mut dyn RigLink| {
            run::set_force(link, &rig_file(), &options, &mut NoopObserver).map_or_else(
                |error| error.to_string(),
                |outcome| {
                    let faults: Vec<_> = outcome.faults.iter().map(|f| (f.unit, f.code)).collect();
                    format!("{:?} {faults:?}", outcome.ended)
                },
            )
        };
        let (image, quick) = (of(&mut rig(4)), of(&mut fast(4)));
        // Details of a fault hold times in microseconds.
        let head = |text: &str| text.split("detail").next().unwrap_or_default().to_owned();
        let (image, quick) = (head(&image), head(&quick));
        assert_eq!(
            without_force(&image),
            without_force(&quick),
            "{injection:?}"
        );
        let (a, b) = (force_n(&image), force_n(&quick));
        assert_eq!(a.is_some(), b.is_some());
        // The tip moves on while the fault ripens: one cycle of the host changes the force that is
        // left by up to 0.03 N.
        let apart = a.zip(b).map_or(0.0, |(a, b)| (a - b).abs());
        // The texts have two places.
        assert!(apart < 0.03 + 1e-9, "{injection:?}: {image} / {quick}");
    }
}

/// Where the text names a force in newtons: its bytes.
fn force_at(text: &str) -> Option<std::ops::Range<usize>> {
    let end = text.find(" N ")?;
    let start = text[..end].rfind(' ')? + 1;
    Some(start..end)
}

/// The force that the text names.
fn force_n(text: &str) -> Option<f64> {
    force_at(text).map(|at| text[at].parse().expect("a number"))
}

/// The text without that force.
fn without_force(text: &str) -> String {
    let mut text = text.to_owned();
    if let Some(at) = force_at(&text) {
        text.replace_range(at, "#");
    }
    text
}
