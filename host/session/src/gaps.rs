//! Lost frames: gaps in the numbers that a board gives its frames.

/// Follows the count of one board.
#[derive(Debug, Default)]
pub struct Gaps {
    last: Option<u16>,
}

impl Gaps {
    /// Takes the number of the frame that arrived. Returns how many frames are missing before it. A
    /// step of more than half the range is a new count (a reset) and no gap.
    pub fn arrived(&mut self, seq: u16) -> u16 {
        let gap = self
            .last
            .map_or(0, |last| seq.wrapping_sub(last).wrapping_sub(1));
        self.last = Some(seq);
        if gap < u16::MAX / 2 {
            gap
        } else {
            0
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_also_over_the_wrap_and_a_new_count_is_none() {
        let mut gaps = Gaps::default();
        let lost = [u16::MAX - 1, u16::MAX, 2, 10_000, 0].map(|seq| gaps.arrived(seq));
        assert_eq!(lost, [0, 0, 2, 9997, 0]);
    }
}
