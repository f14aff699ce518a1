//! How long a step of the board may take, by the clock of the board.
//!
//! An emulated board on a serial line can run at a tenth of real time. What takes it 2 s takes the
//! host 20 s, and nothing is wrong. So the time that counts is the board's, from its status frames,
//! wherever that clock is the slower one.

use std::time::Duration;

/// How much more than the permitted time may pass on the host's clock, whatever the board's clock
/// says.
const MOST: u64 = 20;

/// The time that a step has taken and may take.
#[derive(Debug, Clone, Copy)]
pub struct Patience {
    timeout_ns: u64,
    since_ns: u64,
    /// Board time of the newest status in microseconds, and how much of it has passed in
    /// nanoseconds.
    board: Option<(u32, u64)>,
}

impl Patience {
    /// From now on; `now_ns` is [`super::Session::now_ns`].
    #[must_use]
    pub const fn new(timeout: Duration, now_ns: u64) -> Self {
        Self {
            timeout_ns: timeout.as_nanos() as u64,
            since_ns: now_ns,
            board: None,
        }
    }

    /// Takes the board time of the newest status, if there is one, and returns whether the time is
    /// over.
    pub fn is_over(&mut self, now_ns: u64, board_us: Option<u32>) -> bool {
        if let Some(t_us) = board_us {
            let passed_ns = self.board.map_or(0, |(last_us, passed_ns)| {
                let step_us = t_us.wrapping_sub(last_us);
                // A clock that goes back is one of another start of the board.
                let step_us = if step_us > u32::MAX / 2 { 0 } else { step_us };
                passed_ns + u64::from(step_us) * 1_000
            });
            self.board = Some((t_us, passed_ns));
        }
        let host_ns = now_ns.saturating_sub(self.since_ns);
        let counted_ns = self
            .board
            .map_or(host_ns, |(_, passed_ns)| passed_ns.min(host_ns));
        counted_ns > self.timeout_ns || host_ns > self.timeout_ns.saturating_mul(MOST)
    }
}

/// How much slower than the host's clock the board's clock goes. A real board's goes as fast.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pace {
    /// Host's nanoseconds and board's microseconds at the start of the measurement under way.
    since: Option<(u64, u64)>,
    factor: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self {
            since: None,
            factor: 1.0,
        }
    }
}

impl Pace {
    /// Time on the host's clock that a measurement takes at least: some frames of a board at a
    /// tenth of real time.
    const LEAST_NS: u64 = 500_000_000;

    /// A frame with the board's time has come.
    pub(super) fn frame(&mut self, now_ns: u64, board_us: u64) {
        let Some((since_ns, since_us)) = self.since else {
            self.since = Some((now_ns, board_us));
            return;
        };
        if board_us < since_us {
            // Another start of the board.
            self.since = Some((now_ns, board_us));
            return;
        }
        let host_ns = now_ns.saturating_sub(since_ns);
        if host_ns >= Self::LEAST_NS {
            let board_ns = (board_us - since_us).max(1) * 1_000;
            self.factor = (host_ns as f64 / board_ns as f64).clamp(1.0, MOST as f64);
            self.since = Some((now_ns, board_us));
        }
    }

    /// What `of` the board's time takes on the host's clock.
    pub(super) fn on_host(&self, of: Duration) -> Duration {
        of.mul_f64(self.factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pace_is_that_of_the_slower_clock() {
        let limit = Duration::from_millis(400);
        let mut pace = Pace::default();
        assert_eq!(pace.on_host(limit), limit);
        // A sixth of real time.
        for n in 0..20 {
            pace.frame(n * 300_000_000, n * 50_000);
        }
        assert_eq!(pace.on_host(limit), 6 * limit);
        // The board stands still: at most MOST.
        for n in 20..30 {
            pace.frame(n * 300_000_000, 1_000_000);
        }
        assert_eq!(pace.on_host(limit), MOST as u32 * limit);
        // Another start of the board says nothing of its clock.
        let mut fresh = Pace::default();
        fresh.frame(0, 5_000_000);
        fresh.frame(600_000_000, 1);
        assert_eq!(fresh.on_host(limit), limit);
        // A board on a desk, and one whose clock is ahead.
        for n in 30..50 {
            pace.frame(n * 300_000_000, n * 320_000);
        }
        assert_eq!(pace.on_host(limit), limit);
    }

    const S: u64 = 1_000_000_000;

    #[test]
    fn a_board_in_real_time_has_the_time_that_was_given() {
        let mut patience = Patience::new(Duration::from_secs(5), 7 * S);
        assert!(!patience.is_over(7 * S, Some(100)));
        assert!(!patience.is_over(12 * S, Some(5_000_000)));
        assert!(patience.is_over(12 * S + 1_000_000, Some(5_001_000)));
    }

    #[test]
    fn a_slow_board_has_its_own_time_and_not_for_ever() {
        let mut patience = Patience::new(Duration::from_secs(5), 0);
        // A sixth of real time, over the end of its 32 bits.
        let mut over = None;
        for second in 0..60_u64 {
            let t_us = (u32::MAX - 2_000_000).wrapping_add(second as u32 * 160_000);
            if patience.is_over(second * S, Some(t_us)) {
                over = Some(second);
                break;
            }
        }
        assert_eq!(over, Some(32));
        let mut patience = Patience::new(Duration::from_secs(5), 0);
        assert!(!patience.is_over(100 * S, Some(5)));
        assert!(patience.is_over(101 * S, Some(5)));
    }

    #[test]
    fn without_a_status_the_hosts_clock_counts() {
        let mut patience = Patience::new(Duration::from_secs(5), 0);
        assert!(!patience.is_over(5 * S, None));
        assert!(patience.is_over(5 * S + 1, None));
    }
}
