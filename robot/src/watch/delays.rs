//! The robot's clock against ours, by the states that were on their way for the shortest time.

/// Time over which the fastest state is looked for, ns.
const BLOCK_NS: i64 = 1_000_000_000;
/// Rate of the robot's clock against ours beyond which no state's time can be told: NTP slews by
/// 500 ppm, chrony by up to 8 % while it corrects a large offset.
const MAX_RATE_ERROR: f64 = 0.02;
/// Blocks in a row that differ by such a rate to the same side: one alone may be a delay that
/// changed.
const RATE_BLOCKS: u32 = 3;

/// Our time of a state's arrival less its stamp, for the fastest states of the last one to two
/// seconds. What is above is delay, what falls far below is a clock that jumped, and what drifts is
/// a clock of another rate.
#[derive(Debug, Clone, Copy, Default)]
pub struct Delays {
    now: Option<Block>,
    before: Option<Block>,
    /// Blocks in a row with a wrong rate, and the last rate.
    off: u32,
    rate: f64,
}

/// The fastest state of a second.
#[derive(Debug, Clone, Copy)]
struct Block {
    since_ns: i64,
    least_ns: i64,
}

impl Delays {
    /// A state came at `at_ns` of our clock, `delay_ns` after its stamp.
    pub fn note(&mut self, at_ns: i64, delay_ns: i64) {
        match &mut self.now {
            Some(now) if at_ns - now.since_ns < BLOCK_NS => {
                now.least_ns = now.least_ns.min(delay_ns);
            }
            _ => {
                let ended = self.now.replace(Block {
                    since_ns: at_ns,
                    least_ns: delay_ns,
                });
                if let (Some(before), Some(ended)) = (self.before, ended) {
                    let passed_ns = (ended.since_ns - before.since_ns) as f64;
                    let rate = 1.0 - (ended.least_ns - before.least_ns) as f64 / passed_ns;
                    let same_side = (rate > 1.0) == (self.rate > 1.0);
                    self.off = match (rate - 1.0).abs() > MAX_RATE_ERROR {
                        true if same_side => self.off + 1,
                        is_off => u32::from(is_off),
                    };
                    self.rate = rate;
                }
                self.before = ended;
            }
        }
    }

    /// The least delay, ns; 0 before the first state.
    #[must_use]
    pub fn least_ns(&self) -> i64 {
        let least = |block: &Block| block.least_ns;
        let blocks = [&self.now, &self.before];
        (blocks.into_iter().flatten().map(least).min()).unwrap_or_default()
    }

    /// The rate of the robot's clock where it is wrong for good.
    pub(super) fn rate_off(&self) -> Option<f64> {
        (self.off >= RATE_BLOCKS).then_some(self.rate)
    }
}
