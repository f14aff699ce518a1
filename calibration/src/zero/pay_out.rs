//! Whether a cable pulls: its reading before and after some of it was paid out.
//!
//! The zero of a power-up is uncertain by 0.3 N, and friction keeps up to 1 N in a cable: one
//! reading can't tell the two apart for sure. Two readings of one power-up can. A slack cable reads
//! the same after the reel was turned; a cable that pulls by 1 N and stretches by 0.1 mm/N is slack
//! after 0.1 mm.

use super::Zero;

/// Travel that has to be paid out, m: ten times the stretch of a cable that pulls with 1 N, and
/// what a hand can see.
pub const LEAST_TRAVEL_M: f64 = 0.003;
/// Change that a slack cable may show, N: creep and drift of a cell between the readings.
const SLACK_CHANGE_N: f64 = 0.02;

/// What paying out did to a reading.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PayOut {
    /// Pull that went away, N.
    pub pull_n: f64,
    /// Its standard error, N.
    pub se_n: f64,
    /// Whether the cable was slack before: the change is not more than a slack cable shows.
    pub slack: bool,
}

/// Compares the zeros before and after a cable was paid out. `n_per_code`: scale, N per code; a
/// pull raises `n_per_code` times the code.
#[must_use]
pub fn pay_out(before: &Zero, after: &Zero, n_per_code: f64) -> PayOut {
    // The end of the first stream is next to the beginning of the second.
    let pull_n = n_per_code * (before.at_end_codes - after.mean_codes);
    let se_n = n_per_code.abs() * before.at_end_se_codes.hypot(after.mean_se_codes);
    PayOut {
        pull_n,
        se_n,
        // Written so that NaN is not slack.
        slack: pull_n.abs() <= SLACK_CHANGE_N + 4.0 * se_n,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn zero(codes: f64, se: f64) -> Zero {
        Zero {
            at_end_codes: codes,
            at_end_se_codes: se,
            mean_codes: codes,
            mean_se_codes: se,
            drift_codes: 0.0,
            drift_se_codes: 0.0,
            noise_sd_codes: 400.0,
            correlation_samples: 1.0,
            used: 900,
            spikes: 0,
        }
    }

    #[test]
    fn a_pull_that_goes_away_is_seen_whatever_the_sign_of_the_cell() {
        let scale = 7e-6;
        let slack = pay_out(&zero(10_000.0, 50.0), &zero(11_000.0, 50.0), scale);
        assert!(slack.slack, "{slack:?}");
        // 0.05 N.
        let pulled = pay_out(&zero(17_200.0, 50.0), &zero(10_000.0, 50.0), scale);
        assert!(
            !pulled.slack && (pulled.pull_n - 0.0504).abs() < 1e-9,
            "{pulled:?}"
        );
        let turned = pay_out(&zero(-17_200.0, 50.0), &zero(-10_000.0, 50.0), -scale);
        assert_eq!(turned.pull_n, pulled.pull_n);
        assert!(!pay_out(&zero(f64::NAN, 50.0), &zero(0.0, 50.0), scale).slack);
    }
}
