//! PyTorch, from the same first weights, gives the same networks after as many epochs: gradients,
//! Adam, windows and normalisation. No gradient is as long here as those that are shortened.
//!
//! One batch holds all rows, so that their order does not matter. Needs Python with `torch`: that
//! of `FORCE_PYTHON`, else `python3`. Without it the test says so and checks nothing.
#![cfg(feature = "networks")]

#[path = "python/numbers.rs"]
mod numbers;
mod python;

use std::{path::Path, process::Command};

use estimator::{
    model::Model,
    network::{train, Config, Kind, Loss, Network},
    sequence::Sequence,
};

/// Reads `start.safetensors` (weights and normalisation), `input.f32`, `target.f32`; trains, and
/// prints the forces of the rows whose window is whole, N.
const SCRIPT: &str = "
import json, struct, sys, torch
folder, kind, window, epochs, rate, loss = sys.argv[1:7]
window, epochs, rate = int(window), int(epochs), float(rate)
torch.set_num_threads(1)

data = open(folder + '/start.safetensors', 'rb').read()
length = struct.unpack('<Q', data[:8])[0]
header = json.loads(data[8:8 + length])
start, scaling = {}, {}
for name, entry in header.items():
    if name != '__metadata__':
        low, high = (8 + length + at for at in entry['data_offsets'])
        group = scaling if name.startswith('scaling.') else start
        group[name.removeprefix('scaling.')] = torch.frombuffer(bytearray(data[low:high]), dtype=torch.float32).reshape(entry['shape'])

def floats(name, columns):
    raw = open(folder + '/' + name, 'rb').read()
    return torch.frombuffer(bytearray(raw), dtype=torch.float32).reshape(-1, columns)

rows = floats('input.f32', len(scaling['input_mean']))
forces = floats('target.f32', len(scaling['target_mean']))
rows = (rows - scaling['input_mean']) / scaling['input_deviation']
goal = (forces - scaling['target_mean']) / scaling['target_deviation']
ends = range(window - 1, len(rows))
batch = torch.stack([rows[end - window + 1:end + 1] for end in ends])
goal = goal[window - 1:]

gates = {'gru': 3, 'lstm': 4}.get(kind, 1)
layers = 1 + max(int(name.split('.')[1]) for name in start)
parameters = []
weights = []
for at in range(layers):
    own = {}
    names = [name for name in start if name.startswith(f'layer.{at}.')]
    recurrent = f'layer.{at}.recurrent' in start
    for name in names:
        parts = start[name].chunk(gates, dim=1) if recurrent else [start[name]]
        own[name.split('.')[2]] = [part.clone().requires_grad_() for part in parts]
    for name, parts in own.items():
        if name not in ('mean', 'variance'):
            parameters += parts
    weights.append(own)

def gru(own, values):
    w, u, b, c = own['input'], own['recurrent'], own['bias'], own['recurrent_bias']
    state = torch.zeros(len(values), u[0].shape[0])
    states = []
    for step in range(values.shape[1]):
        x = values[:, step]
        z = torch.sigmoid(x @ w[0] + state @ u[0] + b[0] + c[0])
        r = torch.sigmoid(x @ w[1] + state @ u[1] + b[1] + c[1])
        n = torch.tanh(x @ w[2] + b[2] + r * (state @ u[2] + c[2]))
        state = z * state + (1 - z) * n
        states.append(state)
    return torch.stack(states, 1)

def lstm(own, values):
    w, u, b = own['input'], own['recurrent'], own['bias']
    state = torch.zeros(len(values), u[0].shape[0])
    cell = torch.zeros_like(state)
    states = []
    for step in range(values.shape[1]):
        i, f, c, o = (values[:, step] @ w[k] + state @ u[k] + b[k] for k in range(4))
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(c)
        state = torch.sigmoid(o) * torch.tanh(cell)
        states.append(state)
    return torch.stack(states, 1)

def network():
    values = batch
    for at, own in enumerate(weights):
        if 'recurrent' in own:
            values = (lstm if kind == 'lstm' else gru)(own, values)
            continue
        if values.dim() == 3:
            values = values[:, -1]
        if 'gamma' in own:
            mean, variance = values.mean(0), values.var(0, unbiased=False)
            values = (values - mean) / torch.sqrt(variance + 1e-3)
            values = torch.relu(values * own['gamma'][0] + own['beta'][0])
            continue
        values = values @ own['weight'][0] + own['bias'][0]
        normalised = at + 1 < layers and 'gamma' in weights[at + 1]
        if at + 1 < layers and not normalised:
            values = torch.relu(values)
    return values

optimiser = torch.optim.Adam(parameters, lr=rate, eps=1e-7)
for _ in range(epochs):
    optimiser.zero_grad()
    error = network() - goal
    (error.abs() if loss == 'absolute' else error ** 2).mean().backward()
    optimiser.step()
with torch.no_grad():
    forces = network() * scaling['target_deviation'] + scaling['target_mean']
print(*(f'{value:.9g}' for value in forces.flatten().tolist()))
";

/// Two forces of three inputs, one of which acts later.
fn sequence(rows: usize) -> Sequence {
    let wave = |row: usize, at: usize| ((row * (at + 3) + 17) as f32 * 0.05).sin();
    Sequence {
        trial: 1,
        start_s: 0.0,
        step_s: 0.02,
        input: (0..rows)
            .flat_map(|row| (0..3).map(move |at| 2.0 + wave(row, at) * 10f32.powi(at as i32)))
            .collect(),
        inputs: 3,
        target: (0..rows)
            .flat_map(|row| {
                let late = wave(row.saturating_sub(4), 0);
                [late * wave(row, 1), 3.0 * wave(row, 2) + late]
            })
            .collect(),
        targets: 2,
    }
}

/// Forces by PyTorch of the rows whose window is whole.
fn by_torch(program: &Path, start: &Network, config: &Config, data: &Sequence) -> Vec<f32> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("start.safetensors");
    std::fs::write(file, start.to_bytes()).expect("a file");
    numbers::write(folder.path(), "input.f32", &data.input);
    numbers::write(folder.path(), "target.f32", &data.target);
    let kind = format!("{:?}", config.kind).to_lowercase();
    let loss = format!("{:?}", config.loss).to_lowercase();
    let output = Command::new(program)
        .args(["-c", SCRIPT])
        .arg(folder.path())
        .args([kind, config.window.to_string(), config.epochs.to_string()])
        .args([config.rate.to_string(), loss])
        .output()
        .expect("Python runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{:?}: {said}", config.kind);
    let text = String::from_utf8_lossy(&output.stdout);
    let words = text.split_whitespace();
    words.map(|word| word.parse().expect("a number")).collect()
}

#[test]
fn pytorch_gives_the_same_networks_after_as_many_epochs() {
    let Some(python) = python::python("torch") else {
        return;
    };
    let data = sequence(240);
    for (kind, batch_norm, loss) in [
        (Kind::Mlp, false, Loss::Squared),
        (Kind::Mlp, true, Loss::Squared),
        (Kind::Mlp, false, Loss::Absolute),
        (Kind::Gru, false, Loss::Squared),
        (Kind::Lstm, false, Loss::Squared),
    ] {
        let config = Config {
            layers: vec![12, 10, 8],
            batch_norm,
            batch: 1000,
            rate: 0.003,
            final_rate: 1.0,
            epochs: 40,
            window: if kind == Kind::Mlp { 1 } else { 9 },
            loss,
            ..Config::small(kind)
        };
        // So small a step leaves every weight as it was.
        let first = Config {
            rate: 1e-30,
            epochs: 1,
            ..config.clone()
        };
        let run = |config: &Config| {
            train(config, std::slice::from_ref(&data), &[], &mut |_| {}).expect("good data")
        };
        let (start, ours) = (run(&first), run(&config));
        let skipped = data.targets * (config.window - 1);
        let forces = |network: &Network| network.predict(&data)[skipped..].to_vec();
        let rms = |a: &[f32], b: &[f32]| {
            let squares = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2));
            (squares.sum::<f64>() / a.len() as f64).sqrt()
        };
        let (ours, theirs) = (forces(&ours), by_torch(&python, &start, &config, &data));
        assert_eq!(ours.len(), theirs.len(), "{kind:?}");
        let learned = rms(&ours, &forces(&start));
        let apart = rms(&ours, &theirs);
        println!("{kind:?}, normalised {batch_norm}, {loss:?}: {apart:.2e} N apart, {learned:.3} N learned");
        assert!(learned > 0.1, "{kind:?}: nothing was learned");
        assert!(
            apart < 1e-4 * learned,
            "{kind:?} {batch_norm} {loss:?}: {apart} N of {learned} N"
        );
    }
}
