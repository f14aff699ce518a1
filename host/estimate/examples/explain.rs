//! How often `forcectl estimate explain` names a change of the virtual arm rightly:
//! `cargo run --release -p estimate --example explain -- SEED...` prints the table of
//! docs/estimation.md. With `--words` it prints all words too.
//!
//! For each robot (seed) the model `physics` is trained on 18 minutes of the arm without changes.
//! Each change is alone, in two trials of two minutes under a known force. `cannot tell`: of
//! several names one is right, or it says that the change has no name, or nothing.

#[path = "../tests/common/named.rs"]
mod named;
#[path = "../../../estimator/tests/common/rows.rs"]
mod rows;
#[path = "../../../estimator/tests/common/trials.rs"]
mod trials;

use estimate::explain::JOINTS;
use estimator::estimator::Estimator;
use named::{answers, trained, Answer, CHANGES};
use rayon::prelude::*;

/// Trials of the training.
const TRAINING: u64 = 6;
/// Trials of each change, and of no change.
const TRIALS: u64 = 2;
const UNCHANGED: u64 = 8;

fn main() {
    let (flags, seeds): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|a| a.starts_with("--"));
    let words = flags.iter().any(|flag| flag == "--words");
    let seeds: Vec<u64> = seeds.iter().map(|a| a.parse().expect("a seed")).collect();
    let mut counts = vec![[[0_usize; 3]; 3]; CHANGES.len()];
    let cases: Vec<(usize, u64)> = (0..CHANGES.len())
        .flat_map(|n| {
            let trials = if n == 0 { UNCHANGED } else { TRIALS };
            (11..11 + trials).map(move |session| (n, session))
        })
        .collect();
    for seed in &seeds {
        let estimator = trained(*seed, TRAINING);
        let text = estimator.to_json().expect("stored");
        let found: Vec<_> = cases
            .par_iter()
            .map(|(n, session)| {
                let estimator = Estimator::from_json(&text).expect("a model");
                answers(&estimator, *seed, *session, &CHANGES[*n])
            })
            .collect();
        for ((n, _), motors) in cases.iter().zip(&found) {
            for (joint, (motor, answer)) in motors.iter().enumerate() {
                let place = match answer {
                    Answer::Right => 0,
                    Answer::CannotTell => 1,
                    Answer::Wrong => 2,
                };
                counts[*n][joint][place] += 1;
                if words {
                    eprintln!(
                        "{seed} {} {} ({:.3}, {:.4}) {answer:?}: {}",
                        CHANGES[*n].name,
                        JOINTS[joint].0,
                        motor.friction_in_torque,
                        motor.before,
                        motor.says.join("; ")
                    );
                }
            }
        }
    }
    println!("| change | shoulder: right, cannot tell, wrong | elbow | insertion |");
    println!("| --- | --- | --- | --- |");
    for (change, joints) in CHANGES.iter().zip(counts) {
        let cells = joints.map(|[right, cannot, wrong]| format!("{right}, {cannot}, {wrong}"));
        println!("| {} | {} |", change.name, cells.join(" | "));
    }
}
