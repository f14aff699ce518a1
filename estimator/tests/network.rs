//! Networks learn what a line can't, give the same forces in every form, and refuse what they can't
//! use.
#![cfg(feature = "networks")]

use estimator::{
    model::{Keep, Model, ModelError},
    network::{load, train, train_kept, Backend, Config, Kind, Loss, Network},
    sequence::Sequence,
};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

const KINDS: [Kind; 5] = [
    Kind::Mlp,
    Kind::Gru,
    Kind::Lstm,
    Kind::Convolution,
    Kind::CarriedGru,
];

/// Two inputs that wander, and a force that no linear model of the current row gives: 3 N times
/// their product, and 2 N by the side on which the first last left +-0.5 (a relay, so with memory).
fn sequence(trial: usize, rows: usize) -> Sequence {
    let mut random = ChaCha8Rng::seed_from_u64(trial as u64);
    let waves: Vec<[f64; 4]> = (0..2)
        .map(|_| {
            [
                random.random_range(0.5..0.8),
                random.random_range(0.9..1.3),
                random.random_range(0.0..TAU),
                random.random_range(0.0..TAU),
            ]
        })
        .collect();
    let (mut input, mut target, mut side) = (Vec::new(), Vec::new(), 1.0);
    for row in 0..rows {
        let time = row as f64 * 0.02;
        let values: Vec<f64> = (waves.iter())
            .map(|[slow, fast, phase, other]| {
                0.6 * (slow * PI * time + phase).sin() + 0.6 * (fast * PI * time + other).sin()
            })
            .collect();
        if values[0].abs() > 0.5 {
            side = values[0].signum();
        }
        input.extend([5.0 + values[0] as f32, 0.01 * values[1] as f32]);
        target.push((1.0 + 3.0 * values[0] * values[1] + 2.0 * side) as f32);
    }
    Sequence {
        trial,
        start_s: 0.0,
        step_s: 0.02,
        input,
        inputs: 2,
        target,
        targets: 1,
    }
}

/// A network that learns in seconds.
fn quick(kind: Kind) -> Config {
    let base = Config {
        epochs: 20,
        batch: 64,
        rate: 0.005,
        loss: Loss::Squared,
        final_rate: 0.02,
        ..Config::small(kind)
    };
    match kind {
        Kind::Mlp => Config {
            layers: vec![32, 32],
            batch_norm: true,
            ..base
        },
        Kind::Gru | Kind::Lstm => Config {
            layers: vec![16, 16],
            window: 12,
            epochs: 8,
            ..base
        },
        Kind::Convolution => Config {
            layers: vec![16, 16, 16],
            window: 16,
            ..base
        },
        Kind::CarriedGru => Config {
            layers: vec![16, 16],
            window: 32,
            batch: 8,
            epochs: 60,
            rate: 0.01,
            ..base
        },
    }
}

fn trained(config: &Config) -> Network {
    let training: Vec<Sequence> = (1..5).map(|trial| sequence(trial, 1500)).collect();
    train(config, &training, &[sequence(5, 500)], &mut |_| {}).expect("good data")
}

fn mae(forces: &[f32], truth: &[f32]) -> f64 {
    forces
        .iter()
        .zip(truth)
        .map(|(force, truth)| f64::from((force - truth).abs()))
        .sum::<f64>()
        / truth.len() as f64
}

/// The error of the best line of the current row, by least squares on the tested rows themselves.
fn linear_mae(sequence: &Sequence) -> f64 {
    let rows: Vec<[f64; 3]> = (0..sequence.rows())
        .map(|row| {
            [
                1.0,
                f64::from(sequence.input_row(row)[0]) - 5.0,
                100.0 * f64::from(sequence.input_row(row)[1]),
            ]
        })
        .collect();
    let mut normal = [[0.0; 4]; 3];
    for (row, &truth) in rows.iter().zip(&sequence.target) {
        for a in 0..3 {
            for b in 0..3 {
                normal[a][b] += row[a] * row[b];
            }
            normal[a][3] += row[a] * f64::from(truth);
        }
    }
    for pivot in 0..3 {
        let row = normal[pivot].map(|value| value / normal[pivot][pivot]);
        normal[pivot] = row;
        for other in (0..3).filter(|&other| other != pivot) {
            let factor = normal[other][pivot];
            (0..4).for_each(|at| normal[other][at] -= factor * row[at]);
        }
    }
    let line: Vec<f32> = (rows.iter())
        .map(|row| (0..3).map(|at| row[at] * normal[at][3]).sum::<f64>() as f32)
        .collect();
    mae(&line, &sequence.target)
}

/// On a trial that it has not seen, each network has at most this share of the error of the best
/// line.
#[test]
fn a_network_beats_a_line() {
    let unseen = sequence(6, 2000);
    let line = linear_mae(&unseen);
    for (kind, share) in KINDS.into_iter().zip([0.8, 0.65, 0.65, 0.65, 0.35]) {
        let network = trained(&quick(kind));
        let error = mae(&network.predict(&unseen), &unseen.target);
        println!(
            "{kind:?}: {error:.3} N, line {line:.3} N, epochs {:?}",
            network.epochs().last()
        );
        assert!(
            error < share * line,
            "{kind:?}: {error:.3} N is not below {share} of the line's {line:.3} N"
        );
    }
}

/// A perceptron can't know the relay's side; a network with a memory can.
#[test]
fn memory_pays_where_the_force_has_memory() {
    let unseen = sequence(6, 2000);
    let error = |kind| mae(&trained(&quick(kind)).predict(&unseen), &unseen.target);
    let (without, with) = (error(Kind::Mlp), error(Kind::CarriedGru));
    assert!(
        with < 0.6 * without,
        "{with:.3} N with a memory, {without:.3} N without"
    );
}

/// The plain steps are the batches of burn, also on the rows before a window is full.
#[test]
fn steps_are_predictions() {
    let unseen = sequence(6, 300);
    for kind in KINDS {
        let network = trained(&Config {
            epochs: 1,
            ..quick(kind)
        });
        let forces = network.predict(&unseen);
        let mut stepper = network.stepper();
        // The second time after a reset: nothing of the first may be left.
        for _ in 0..2 {
            stepper.reset();
            let mut force = [0.0];
            for (row, expected) in forces.iter().enumerate() {
                stepper.step(unseen.input_row(row), &mut force);
                assert!(
                    (force[0] - expected).abs() < 1e-5,
                    "{kind:?}, row {row}: {} and {expected}",
                    force[0]
                );
            }
        }
    }
}

/// The carried network's plain steps against the batch form in which it was trained, through a
/// window of training.
#[test]
fn carried_steps_are_the_windowed_network_of_the_same_weights() {
    let unseen = sequence(6, 12);
    let carried = trained(&Config {
        epochs: 1,
        window: 12,
        ..quick(Kind::CarriedGru)
    });
    // The same weights read as a network of windows: burn's batch form, begun at the first row.
    let windowed = as_kind(&carried, Kind::Gru);
    let last = unseen.rows() - 1;
    let (plain, batch) = (
        carried.predict(&unseen)[last],
        windowed.predict(&unseen)[last],
    );
    assert!((plain - batch).abs() < 1e-5, "{plain} and {batch}");
}

/// The network with another kind in its settings.
fn as_kind(network: &Network, kind: Kind) -> Network {
    let bytes = network.to_bytes();
    let length = u64::from_le_bytes(bytes[..8].try_into().expect("eight bytes")) as usize;
    let header = std::str::from_utf8(&bytes[8..8 + length])
        .expect("JSON")
        .replace("carried-gru", &kind_name(kind));
    let mut changed = (header.len() as u64).to_le_bytes().to_vec();
    changed.extend_from_slice(header.as_bytes());
    changed.extend_from_slice(&bytes[8 + length..]);
    Network::from_bytes(&changed).expect("the same shapes")
}

fn kind_name(kind: Kind) -> String {
    serde_json::to_string(&kind)
        .expect("a name")
        .trim_matches('"')
        .to_owned()
}

#[test]
fn the_same_run_gives_the_same_bytes_and_another_seed_others() {
    for kind in KINDS {
        let config = Config {
            epochs: 2,
            dropout: 0.2,
            keep_best: true,
            ..quick(kind)
        };
        let bytes = trained(&config).to_bytes();
        assert!(
            bytes == trained(&config).to_bytes(),
            "{kind:?} trained twice"
        );
        assert!(
            bytes != trained(&Config { seed: 2, ..config }).to_bytes(),
            "{kind:?} with another seed"
        );
    }
}

#[test]
fn a_file_gives_back_the_network() {
    let folder = tempfile::tempdir().expect("a folder");
    for kind in KINDS {
        let network = trained(&Config {
            epochs: 1,
            ..quick(kind)
        });
        let path = folder.path().join("model.safetensors");
        network.save(&path).expect("a file");
        assert!(load(&path).expect("our own file") == network, "{kind:?}");
    }
}

#[test]
fn a_damaged_file_is_refused_with_its_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let network = trained(&Config {
        epochs: 1,
        ..quick(Kind::Mlp)
    });
    let path = folder.path().join("model.safetensors");
    let good = network.to_bytes();
    let changed = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let at = good
            .windows(from.len())
            .position(|part| part == from.as_bytes())
            .expect("a part of the header");
        let mut bytes = good.clone();
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    let mut not_a_number = good.clone();
    let end = not_a_number.len();
    not_a_number[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    for (bytes, what) in [
        (good[..good.len() - 8].to_vec(), "no model file"),
        (b"neither".to_vec(), "no model file"),
        (
            changed("\\\"format\\\":1", "\\\"format\\\":2"),
            "its format is 2",
        ),
        (changed("[32,32]", "[32,33]"), "not F32"),
        (changed("\\\"inputs\\\":2", "\\\"inputs\\\":3"), "not F32"),
        (
            changed("layer.0.weight", "layer.0.wright"),
            "no tensor `layer.0.weight`",
        ),
        (not_a_number, "is NaN"),
    ] {
        std::fs::write(&path, bytes).expect("a file");
        let error = load(&path).expect_err(what).to_string();
        assert!(
            error.contains(what) && error.contains("model.safetensors"),
            "{error}"
        );
    }
}

#[test]
fn data_that_can_not_be_used_is_refused() {
    let good = || vec![sequence(1, 100), sequence(2, 100)];
    let refused = |config: &Config, training: &[Sequence], what: &str| {
        let error = train(config, training, &[], &mut |_| {}).expect_err(what);
        assert!(
            matches!(error, ModelError::Data(_)) && error.to_string().contains(what),
            "{error}"
        );
    };
    let config = quick(Kind::Gru);
    refused(&config, &[], "no training row");
    let mut bad = good();
    bad[1].input[37] = f32::NAN;
    refused(
        &config,
        &bad,
        "trial 2 from 0.000 s on: row 18, input 1 is NaN",
    );
    let mut bad = good();
    bad[1].step_s = 0.01;
    refused(&config, &bad, "resample");
    let mut bad = good();
    bad[1].inputs = 1;
    refused(&config, &bad, "1 inputs and 1 targets a row, not 2 and 1");
    let mut bad = good();
    bad[0].target.pop();
    refused(&config, &bad, "not whole rows");
    refused(
        &Config {
            window: 101,
            ..config.clone()
        },
        &good(),
        "no training sequence has 101 rows",
    );
    refused(
        &Config {
            layers: vec![16],
            ..config.clone()
        },
        &good(),
        "`layers` is [16]",
    );
    refused(
        &Config {
            dropout: 1.0,
            ..config.clone()
        },
        &good(),
        "`dropout` is 1",
    );
    refused(
        &Config {
            rate: 0.0,
            ..config.clone()
        },
        &good(),
        "`rate` 0",
    );
    refused(
        &Config {
            rate: 1e30,
            ..quick(Kind::Mlp)
        },
        &good(),
        "diverged",
    );
    refused(
        &Config {
            window: 15,
            ..quick(Kind::Convolution)
        },
        &good(),
        "no window of 15 rows",
    );
    if !cfg!(feature = "cuda") {
        refused(
            &Config {
                backend: Backend::Cuda,
                ..config.clone()
            },
            &good(),
            "--features cuda",
        );
    }
    let network = trained(&Config {
        epochs: 1,
        ..quick(Kind::Mlp)
    });
    let other = Sequence {
        step_s: 0.001,
        ..sequence(1, 10)
    };
    assert!(network
        .check(&other)
        .expect_err("another rate")
        .to_string()
        .contains("every 0.001 s"));
}

#[test]
fn a_limit_of_time_ends_a_training_with_a_network() {
    let config = Config {
        epochs: 1_000_000,
        limit_s: Some(0.3),
        ..quick(Kind::Mlp)
    };
    let network = trained(&config);
    assert!(network.epochs().len() < 1_000_000);
    let epochs = network.trained();
    let begun = network.epochs().len() as f64;
    assert!(epochs.cut && epochs.wanted == 1_000_000, "{epochs:?}");
    assert!(
        epochs.done <= begun && epochs.done > begun - 1.0,
        "{epochs:?} of {begun}"
    );
    let whole = trained(&Config {
        epochs: 2,
        ..quick(Kind::Mlp)
    })
    .trained();
    assert_eq!((whole.done, whole.cut), (2.0, false));
    assert_eq!(whole.to_string(), "2 of 2");
    assert!(network
        .predict(&sequence(6, 10))
        .iter()
        .all(|force| force.is_finite()));
}

#[test]
fn progress_goes_up_to_one() {
    let mut reports = Vec::new();
    let config = Config {
        epochs: 2,
        ..quick(Kind::Mlp)
    };
    train(
        &config,
        &[sequence(1, 500)],
        &[sequence(2, 100)],
        &mut |report| reports.push(report.clone()),
    )
    .expect("good data");
    assert!(reports.windows(2).all(|pair| pair[1].done >= pair[0].done));
    let last = reports.last().expect("reports");
    assert!((last.done - 1.0).abs() < 1e-12);
    assert!(
        last.text.starts_with("epoch 2 of 2: loss ") && last.text.contains("validation error "),
        "{}",
        last.text
    );
}

/// Table 4.1 of the thesis against Keras's count. The perceptron's and the LSTM's fit some number
/// of inputs; the GRU's none.
#[test]
fn parameters_are_counted_as_keras_counts_them() {
    let count = |kind, inputs: usize, targets: usize| {
        let rows = 60;
        let random = |count| (0..count).map(|at| (at % 7) as f32).collect::<Vec<_>>();
        let data = Sequence {
            trial: 1,
            start_s: 0.0,
            step_s: 0.02,
            input: random(rows * inputs),
            inputs,
            target: random(rows * targets),
            targets,
        };
        let config = Config {
            epochs: 1,
            limit_s: Some(1e-9),
            ..Config::thesis(kind)
        };
        train(&config, &[data], &[], &mut |_| {})
            .expect("good data")
            .parameters()
    };
    assert_eq!(count(Kind::Mlp, 30, 3), 2_777_203);
    assert_eq!(count(Kind::Lstm, 264, 3), 236_803);
    // Keras: GRU(100) on 9 inputs 33,300, GRU(100) 60,600, Dense(100) 10,100, Dense(1) 101.
    assert_eq!(count(Kind::Gru, 9, 1), 33_300 + 60_600 + 10_100 + 101);
}

/// Ends the training as a kill does, at the beginning of a pass.
fn broken_off(config: &Config, training: &[Sequence], validation: &[Sequence], keep: &Keep) {
    let killed = std::panic::catch_unwind(|| {
        train_kept(config, training, validation, Some(keep), &mut |progress| {
            assert!(!progress.text.starts_with("epoch 3"), "killed");
        })
    });
    assert!(killed.is_err(), "the training came to the third pass");
}

#[test]
fn a_training_that_was_broken_off_goes_on_to_the_same_weights() {
    let training: Vec<Sequence> = (1..4).map(|trial| sequence(trial, 400)).collect();
    let validation = [sequence(5, 300)];
    let folder = tempfile::tempdir().expect("a folder");
    for kind in KINDS {
        let config = Config {
            epochs: 4,
            dropout: 0.2,
            keep_best: true,
            // A rate that falls: the last pass would be another one at the first rate.
            final_rate: 0.1,
            ..quick(kind)
        };
        let keep = |resume| Keep {
            file: folder.path().join(format!("{kind:?}.training")),
            resume,
        };
        let whole = train(&config, &training, &validation, &mut |_| {}).expect("good data");
        broken_off(&config, &training, &validation, &keep(false));
        let go_on = |config: &Config, training: &[Sequence]| {
            train_kept(
                config,
                training,
                &validation,
                Some(&keep(true)),
                &mut |_| {},
            )
        };
        // A training of other settings or data does not go on from it.
        let other = Config {
            seed: 2,
            ..config.clone()
        };
        for (refused, words) in [
            (go_on(&other, &training), "other settings"),
            (go_on(&config, &training[1..]), "other data"),
        ] {
            let error = refused.expect_err(words).to_string();
            assert!(
                error.contains(words) && error.contains(".training"),
                "{error}"
            );
        }
        let on = go_on(&config, &training).expect("it goes on");
        assert_eq!(on.epochs().len(), 4);
        assert!(on.to_bytes() == whole.to_bytes(), "{kind:?}: other weights");
        // One that is whole has nothing left to do.
        let again = go_on(&config, &training).expect("it goes on");
        assert!(
            again.to_bytes() == whole.to_bytes(),
            "{kind:?}: other weights"
        );
    }
}

#[test]
fn a_training_does_not_go_on_from_a_damaged_file() {
    let training = [sequence(1, 300)];
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("mlp.training");
    let config = Config {
        epochs: 4,
        ..quick(Kind::Mlp)
    };
    let keep = |resume| Keep {
        file: file.clone(),
        resume,
    };
    let error = |words: &str| {
        let refused = train_kept(&config, &training, &[], Some(&keep(true)), &mut |_| {});
        let error = refused.expect_err(words).to_string();
        assert!(
            error.contains(words) && error.contains("--resume"),
            "{error}"
        );
    };
    error("can't be read");
    broken_off(&config, &training, &[], &keep(false));
    let whole = std::fs::read(&file).expect("it was written");
    for length in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        std::fs::write(&file, &whole[..length]).expect("a file");
        error("it is no file of a training");
    }
}
