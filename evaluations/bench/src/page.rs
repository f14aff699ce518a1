//! The page docs/figures.md.

use crate::figures::{number, verdict, Figures};

/// The page docs/figures.md.
pub fn page(figures: &Figures, quick: bool) -> String {
    let option = if quick { " --quick" } else { "" };
    let mut text = format!(
        "# Figures\n\nPrinted by `cargo xtask bench{option} --markdown docs/figures.md` ({}), which measures them and \
         writes this page and `target/bench/figures.json`. How each one is obtained: `evaluations/bench/src`.\n\n\
         Times of the rig are emulated times: converters, buses and serial lines take the time they take on the part; every \
         instruction takes 4 ns, without wait states or caches. `allocation_us`, `stop_ms` and `emulated_seconds_per_second` \
         are times of the machine the bench ran on.\n\n\
         | figure | reached | goal | what it is |\n| --- | ---: | --- | --- |\n",
        evaluation::sources()
    );
    for figure in &figures.0 {
        text.push_str(&format!(
            "| `{}` | {} | {} | {} |\n",
            figure.key,
            number(figure.value),
            verdict(figure),
            figure.what
        ));
    }
    text
}
