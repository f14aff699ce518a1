//! Damages input: what the tests of this package feed to decoders and parsers. Everything comes
//! from a seed, so a failure is the same in every run, and proptest makes it small.
//!
//! `FORCE_FUZZ_CASES` sets the number of cases of each test, `FORCE_FUZZ_SEED` another seed. With
//! `FORCE_FUZZ_MINUTES` each test goes on with one seed after the other for so long.
//! `cargo xtask fuzz` sets them.

use proptest::collection::vec;
use proptest::prelude::{any, Strategy};
use proptest::test_runner::{Config, RngAlgorithm, TestError, TestRng, TestRunner};
use std::fmt::Debug;
use std::time::{Duration, Instant};

/// Cases of a test in `cargo xtask test`.
const CASES: u32 = 300;

/// A change of some bytes.
#[derive(Debug, Clone)]
pub enum Damage {
    /// Invert the bits of a mask in a byte.
    Invert(usize, u8),
    /// Overwrite a byte.
    Set(usize, u8),
    /// Leave out bytes.
    Cut(usize, usize),
    /// Repeat bytes so many times.
    Repeat(usize, usize, usize),
    /// Insert bytes.
    Insert(usize, Vec<u8>),
    /// Move what begins here to the front.
    Turn(usize),
}

/// Some changes, one after the other.
pub fn damages() -> impl Strategy<Value = Vec<Damage>> {
    let place = any::<usize>;
    vec(
        proptest::prop_oneof![
            (place(), 1u8..).prop_map(|(at, mask)| Damage::Invert(at, mask)),
            (place(), any::<u8>()).prop_map(|(at, byte)| Damage::Set(at, byte)),
            (place(), 1usize..40).prop_map(|(at, length)| Damage::Cut(at, length)),
            (place(), 1usize..40, 1usize..200)
                .prop_map(|(at, length, n)| Damage::Repeat(at, length, n)),
            (place(), vec(any::<u8>(), 1..20)).prop_map(|(at, bytes)| Damage::Insert(at, bytes)),
            place().prop_map(Damage::Turn),
        ],
        0..6,
    )
}

/// The bytes with the changes.
#[must_use]
pub fn damaged(bytes: &[u8], damages: &[Damage]) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for damage in damages {
        let length = out.len().max(1);
        let end = |at: usize, n: usize| (at % length + n).min(out.len());
        match damage {
            Damage::Invert(at, mask) => {
                if let Some(byte) = out.get_mut(at % length) {
                    *byte ^= mask;
                }
            }
            Damage::Set(at, value) => {
                if let Some(byte) = out.get_mut(at % length) {
                    *byte = *value;
                }
            }
            Damage::Cut(at, n) => drop(out.drain((at % length).min(out.len())..end(*at, *n))),
            Damage::Repeat(at, n, times) => {
                let (begin, end) = ((at % length).min(out.len()), end(*at, *n));
                let piece = out[begin..end].repeat(*times);
                drop(out.splice(end..end, piece));
            }
            Damage::Insert(at, more) => {
                let at = (at % length).min(out.len());
                drop(out.splice(at..at, more.iter().copied()));
            }
            Damage::Turn(at) => {
                let at = (at % length).min(out.len());
                out.rotate_left(at);
            }
        }
    }
    out
}

/// The text with the changes; what is no text any more becomes the replacement character.
#[must_use]
pub fn damaged_text(text: &str, damages: &[Damage]) -> String {
    String::from_utf8_lossy(&damaged(text.as_bytes(), damages)).into_owned()
}

fn number(variable: &str, default: u32) -> u32 {
    match std::env::var(variable) {
        Ok(text) => text
            .parse()
            .unwrap_or_else(|_| panic!("{variable}={text}: a whole number is needed")),
        Err(_) => default,
    }
}

/// Runs `test` on the cases that `strategy` draws from the seed, or, where minutes are set, from
/// one seed after the other; then prints how many cases there were.
///
/// # Panics
/// On the first input that `test` does not survive.
pub fn check<S: Strategy>(cost: u32, strategy: S, test: impl Fn(S::Value))
where
    S::Value: Debug,
{
    let seed = number("FORCE_FUZZ_SEED", 1);
    let minutes = number("FORCE_FUZZ_MINUTES", 0);
    let end = Instant::now() + Duration::from_secs(60 * u64::from(minutes));
    let (mut cases, mut seeds) = (0, 0);
    loop {
        cases += u64::from(check_seed(cost, seed.wrapping_add(seeds), &strategy, &test));
        seeds += 1;
        if Instant::now() >= end {
            break;
        }
    }
    if minutes > 0 {
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("a test");
        println!(
            "{name}: {cases} cases, seeds {seed} to {}",
            seed.wrapping_add(seeds - 1)
        );
    }
}

/// Runs `test` on the cases that `strategy` draws; a panic within it is a failure, and the smallest
/// input that causes it is shown. `cost`: how many times as long as a short case one takes. Returns
/// the number of cases.
///
/// # Panics
/// On the first input that `test` does not survive.
fn check_seed<S: Strategy>(
    cost: u32,
    seed_number: u32,
    strategy: &S,
    test: impl Fn(S::Value),
) -> u32
where
    S::Value: Debug,
{
    let config = Config {
        cases: (number("FORCE_FUZZ_CASES", CASES) / cost).max(1),
        failure_persistence: None,
        ..Config::default()
    };
    let mut seed = [0; 32];
    seed[..4].copy_from_slice(&seed_number.to_le_bytes());
    let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &seed);
    let cases = config.cases;
    let outcome = TestRunner::new_with_rng(config, rng).run(strategy, |value| {
        test(value);
        Ok(())
    });
    match outcome {
        Ok(()) => cases,
        Err(TestError::Fail(why, input)) => panic!("{why}\nsmallest input: {input:?}"),
        Err(TestError::Abort(why)) => panic!("no case could be drawn: {why}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_damaged_is_the_same_in_every_run() {
        let drawn = || {
            let all = std::cell::RefCell::new(Vec::new());
            check(30, damages(), |damages| {
                all.borrow_mut()
                    .push(damaged(b"some bytes of input", &damages));
            });
            all.into_inner()
        };
        let first = drawn();
        assert_eq!(first, drawn());
        assert!(first.iter().any(|bytes| bytes != b"some bytes of input"));
    }

    #[test]
    #[should_panic(expected = "smallest input")]
    fn an_input_that_is_not_survived_is_shown() {
        check(1, any::<u32>(), |n| assert!(n < 1_000));
    }
}
