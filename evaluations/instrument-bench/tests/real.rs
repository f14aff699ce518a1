//! The goals on the real set, where it is: `RESIDUAL_PUBLIC_DATA` names a folder with a clone of
//! it.

use instrument_bench::results::{transfer, Set, OTHER, SET};
use instrument_bench::score::score;
use instrument_bench::split::Apart;
use std::path::Path;

/// Names the folder with clones of public repositories.
const VARIABLE: &str = "RESIDUAL_PUBLIC_DATA";

#[test]
fn loads_that_were_left_out_and_the_other_tool_are_within_the_goals() {
    let Ok(folder) = std::env::var(VARIABLE) else {
        eprintln!(
            "instrument data, skipped: {VARIABLE} names no folder with a clone of {}",
            instrument_bench::data::SOURCE
        );
        return;
    };
    let clone = Path::new(&folder).join("mis-tool-characterization");
    let read = |name| Set::read(&clone, name).expect("the set is read");
    let (set, other) = (read(SET), read(OTHER));
    let labels = set.labels();
    assert!(score(Apart::Level, &labels, &set.causal).rmse_mnm <= 3.0);
    assert!(score(Apart::LevelAndSpeed, &labels, &set.causal).rmse_mnm <= 4.0);
    for (from, to) in [(&set, &other), (&other, &set)] {
        let found = transfer(from, to).expect("the sets can be fitted");
        assert!(
            found.corrected_mnm <= 4.5,
            "{} to {}: {}",
            found.from,
            found.to,
            found.corrected_mnm
        );
    }
}
