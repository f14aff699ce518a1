//! The ONNX files give in `onnxruntime` what the networks give here, to 1e-5 N.
//!
//! Needs Python with `onnxruntime` and `numpy`: that of `FORCE_PYTHON`, else `python3`. Without
//! them the test says so and checks nothing.
#![cfg(feature = "networks")]

#[path = "python/numbers.rs"]
mod numbers;
mod python;

use std::process::Command;

use estimator::{
    model::Model,
    network::{train, Config, Kind},
    sequence::Sequence,
};

/// Reads `model.onnx`, `input.f32`; prints the forces of all rows, and of a carried network also
/// those of single steps.
const SCRIPT: &str = "
import sys, numpy, onnxruntime
folder, window, inputs = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
session = onnxruntime.InferenceSession(folder + '/model.onnx', providers=['CPUExecutionProvider'])
rows = numpy.fromfile(folder + '/input.f32', dtype='<f4').reshape(-1, inputs)
states = [value for value in session.get_inputs() if value.name != 'input']
if states:
    names = ['force'] + ['next_' + value.name for value in states]
    zero = {value.name: numpy.zeros((1, 1, value.shape[2]), dtype='<f4') for value in states}
    whole = session.run(names, {'input': rows[:, None, :], **zero})[0][:, 0, :]
    carried, steps = dict(zero), []
    for row in rows:
        force, *next_states = session.run(names, {'input': row[None, None, :], **carried})
        carried = {value.name: state for value, state in zip(states, next_states)}
        steps.append(force[0, 0])
    forces = [whole, numpy.array(steps)]
else:
    if window == 1:
        batch = rows
    else:
        at = numpy.arange(len(rows))[:, None] - numpy.arange(window)[::-1][None, :]
        batch = rows[numpy.maximum(at, 0)]
    forces = [session.run(['force'], {'input': batch})[0]]
for result in forces:
    print(' '.join(f'{value:.9g}' for value in result.ravel()))
";

fn sequence(trial: usize, rows: usize) -> Sequence {
    let wave = |row: usize, at: usize| ((row * (at + 3) + 17 * trial) as f32 * 0.05).sin();
    Sequence {
        trial,
        start_s: 0.0,
        step_s: 0.02,
        input: (0..rows)
            .flat_map(|row| (0..3).map(move |at| 2.0 + wave(row, at) * 10f32.powi(at as i32)))
            .collect(),
        inputs: 3,
        target: (0..rows)
            .flat_map(|row| [wave(row, 0) * wave(row, 1), 3.0 * wave(row, 2)])
            .collect(),
        targets: 2,
    }
}

#[test]
fn onnxruntime_gives_the_same_forces() {
    let Some(python) = python::python("onnxruntime, numpy") else {
        return;
    };
    let unseen = sequence(2, 80);
    for kind in [
        Kind::Mlp,
        Kind::Gru,
        Kind::Lstm,
        Kind::Convolution,
        Kind::CarriedGru,
    ] {
        let base = Config {
            epochs: 2,
            batch: 32,
            rate: 0.01,
            ..Config::small(kind)
        };
        let config = match kind {
            Kind::Mlp => Config {
                batch_norm: true,
                ..base
            },
            // Two recurrent layers: only then one feeds the other.
            Kind::Gru | Kind::Lstm => Config {
                layers: vec![12, 10, 8],
                window: 9,
                ..base
            },
            Kind::Convolution => Config {
                layers: vec![12, 10, 8],
                window: 9,
                ..base
            },
            Kind::CarriedGru => Config {
                layers: vec![12, 10, 8],
                window: 20,
                batch: 4,
                ..base
            },
        };
        let network = train(&config, &[sequence(1, 600)], &[], &mut |_| {}).expect("good data");
        let folder = tempfile::tempdir().expect("a folder");
        network
            .write_onnx(&folder.path().join("model.onnx"))
            .expect("a file");
        numbers::write(folder.path(), "input.f32", &unseen.input);
        let output = Command::new(&python)
            .args(["-c", SCRIPT])
            .arg(folder.path())
            .args([config.window.to_string(), unseen.inputs.to_string()])
            .output()
            .expect("Python runs");
        assert!(
            output.status.success(),
            "{kind:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        let expected = network.predict(&unseen);
        let text = String::from_utf8_lossy(&output.stdout);
        assert_eq!(
            text.lines().count(),
            if kind == Kind::CarriedGru { 2 } else { 1 }
        );
        for line in text.lines() {
            let forces: Vec<f32> = line
                .split_whitespace()
                .map(|value| value.parse().expect("a number"))
                .collect();
            assert_eq!(forces.len(), expected.len());
            let worst = forces
                .iter()
                .zip(&expected)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            println!("{kind:?}: at most {worst:.1e} N apart");
            assert!(worst < 1e-5, "{kind:?}: {worst} N apart");
        }
    }
}
