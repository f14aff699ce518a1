//! The offset between two clocks from one-way messages: the one with the least delay counts.
//!
//! Each message carries its time on the sender's clock and arrives at a time of ours. The difference is the offset plus the
//! message's delay, which is never negative. So the least difference of a window is nearest to the offset, and the delay
//! that even the fastest message has is its error.

use std::collections::VecDeque;

/// Length of the window, s of our clock: long enough for a fast message, short enough for crystals that drift by 50 ppm.
const WINDOW_S: f64 = 20.0;
/// Delay that the fastest message of a window may have, s: a period of the robot's publisher (1 ms) and its way through the
/// operating systems.
const LEAST_DELAY_S: f64 = 0.002;

/// See the module's page.
#[derive(Debug, Clone, Default)]
pub struct LeastDelay {
    /// Our time and the difference, s; differences rise from front to back.
    window: VecDeque<(f64, f64)>,
}

impl LeastDelay {
    /// A message of `sent_s` (sender's clock) came at `came_s` (ours).
    pub fn note(&mut self, sent_s: f64, came_s: f64) {
        let difference = came_s - sent_s;
        while self.window.back().is_some_and(|(_, d)| *d >= difference) {
            self.window.pop_back();
        }
        self.window.push_back((came_s, difference));
        while self
            .window
            .front()
            .is_some_and(|(at, _)| came_s - at > WINDOW_S)
        {
            self.window.pop_front();
        }
    }

    /// What to add to the sender's time to get ours, s, and its uncertainty, s.
    #[must_use]
    pub fn offset_s(&self) -> Option<(f64, f64)> {
        let (_, least) = self.window.front()?;
        Some((*least, LEAST_DELAY_S))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_is_that_of_the_fastest_message_of_the_window() {
        let mut clock = LeastDelay::default();
        assert_eq!(clock.offset_s(), None);
        // Offset 100 s, delays of 0.3 to 9.3 ms, a drift of 20 ppm.
        for n in 0..6000_u32 {
            let sent = f64::from(n) * 0.01;
            let delay = 0.0003 + f64::from(n * 7 % 10) * 0.001;
            clock.note(sent, sent * (1.0 + 20e-6) + 100.0 + delay);
        }
        let (offset, error) = clock.offset_s().unwrap();
        let wanted = 100.0 + 60.0 * 20e-6;
        assert!((offset - wanted).abs() < error, "{offset} {wanted}");
    }
}
