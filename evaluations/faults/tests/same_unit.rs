//! Two faults of one unit, one of which hides the other: a load cell that lies in front of an
//! output that does not follow, or an encoder that stands. The campaign draws its pairs at random
//! and seldom meets these.

use faults::campaign::CURRENT_LIMIT_A;
use faults::case::{run, Bases, EXPECTED_N};
use faults::injection::{Injection as I, Plan};

const UNIT: usize = 3;

/// What a load cell or its converter may do.
const CELL: [I; 14] = [
    I::OpenBridge(UNIT),
    I::Frozen(UNIT),
    I::WrongSign(UNIT),
    I::Sensitivity(UNIT, 0.2),
    I::Offset(UNIT, -4.0),
    I::Offset(UNIT, 4.0),
    I::Drift(UNIT, -5.0),
    I::Drift(UNIT, 5.0),
    I::Saturated(UNIT, false),
    I::Saturated(UNIT, true),
    I::Silent(UNIT),
    I::ReadsFail(UNIT),
    I::CodeBitStuck(UNIT, 20, false),
    I::Noise(UNIT, 1.0),
];

/// What may be wrong with the output or the encoder of the same unit.
const OTHER: [I; 5] = [
    I::DacStuck(UNIT),
    I::DacLink,
    I::DacSelect(UNIT, 1),
    I::EncoderFrozen(UNIT),
    I::EncoderReversed(UNIT),
];

#[test]
fn two_faults_of_one_unit_are_no_hazard() {
    let bases = Bases::between(1, CURRENT_LIMIT_A, EXPECTED_N);
    let mut wrong = Vec::new();
    for cell in CELL {
        for other in OTHER {
            for (first, second) in [(cell, other), (other, cell)] {
                for ms in [5, 150] {
                    for base in [0, 3] {
                        let plan = Plan::holding(base, first, Some((second, ms)));
                        let outcome = run(&bases, 0, plan);
                        if !outcome.hazards.is_empty() {
                            wrong.push(format!(
                                "{base}: {first:?}, {second:?} after {ms} ms: fault {}, {:?}, {:.1} N",
                                outcome.fault, outcome.hazards, outcome.tension_n
                            ));
                        }
                    }
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{}\n{}", wrong.len(), wrong.join("\n"));
}
