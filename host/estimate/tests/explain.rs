//! Changes of the virtual arm are named by what has changed, and an arm without changes is not
//! accused.

#[path = "common/named.rs"]
mod named;
#[path = "../../../estimator/tests/common/rows.rs"]
mod rows;
#[path = "../../../estimator/tests/common/trials.rs"]
mod trials;

use named::{answers, trained, Answer, CHANGES};
use rayon::prelude::*;

#[test]
fn each_change_alone_is_named_at_the_elbow_and_nothing_is_said_of_an_unchanged_arm() {
    [1, 11_u64].into_par_iter().for_each(|seed| {
        let estimator = trained(seed, 5);
        for change in &CHANGES {
            let motors = answers(&estimator, seed, 11, change);
            let (elbow, answer) = &motors[1];
            let said = format!("robot {seed}, {}: {elbow:?}", change.name);
            if change.name.starts_with("drag") {
                // What goes back and forth in minutes has no name in the catalogue.
                assert!(!elbow.says.is_empty() && *answer != Answer::Wrong, "{said}");
            } else {
                assert_eq!(*answer, Answer::Right, "{said}");
            }
        }
    });
}
