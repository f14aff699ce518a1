//! When a load came on: the code of the cell is watched while the user hangs a weight.
//!
//! A cell that creeps does so from the moment the load changes, and the user presses Enter seconds
//! after that. Taking Enter for that moment makes creep of a short time constant wrong by tens of
//! percent. The change itself is seen in the codes.

use super::Result;
use calibration::stats;
use session::Session;
use std::collections::VecDeque;
use std::time::Duration;

/// Time from one look at the samples to the next.
const STEP: Duration = Duration::from_millis(50);
/// Codes that are kept of each unit: five minutes at 320 Hz. Of a longer wait, the newest count.
const KEPT: usize = 96_000;
/// Part of the change within which a code counts as that of the old load, or of the new one.
const BAND: f64 = 0.25;
/// Least change, in standard deviations of a code, that tells when it happened.
const LEAST_CHANGE_SD: f64 = 8.0;
/// Least standard error of the time, s: two samples and the converter's filter.
const LEAST_SD_S: f64 = 0.01;

/// When a load came on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameOn {
    /// Time, s.
    pub at_s: f64,
    /// Its standard error, s: half of the time that the change took.
    pub sd_s: f64,
}

/// Codes of one unit, with their times.
#[derive(Debug, Clone, Default)]
pub struct Watch {
    codes: VecDeque<(f64, i32)>,
}

/// Lets the link's time go on for a step, and adds what arrived to the watch of each unit. `time_s`
/// is the series' time of the link's time in ns.
///
/// # Errors
/// The link.
pub fn step(
    session: &mut Session<'_>,
    watches: &mut [(u8, Watch)],
    time_s: impl Fn(u64) -> f64,
) -> Result<()> {
    session.exchange(STEP)?;
    let now_s = time_s(session.now_ns());
    let samples = session.drain().samples;
    // The newest sample is as old as a frame; board and link differ by a constant within a step.
    let newest_us = samples.iter().map(|timed| timed.t_us).max().unwrap_or(0);
    for timed in samples {
        let unit = timed.sample.unit + 1;
        if let Some((_, watch)) = watches.iter_mut().find(|(number, _)| *number == unit) {
            let age_s = 1e-6 * newest_us.saturating_sub(timed.t_us) as f64;
            watch.add(now_s - age_s, timed.sample.adc_code);
        }
    }
    Ok(())
}

impl Watch {
    /// Adds a code and its time, s.
    pub fn add(&mut self, time_s: f64, code: i32) {
        if self.codes.len() == KEPT {
            self.codes.pop_front();
        }
        self.codes.push_back((time_s, code));
    }

    /// The code at the beginning: the median of a third of a second. `None` where nothing was seen.
    #[must_use]
    pub fn first_code(&self) -> Option<f64> {
        let first: Vec<f64> = self
            .codes
            .iter()
            .take(107)
            .map(|c| f64::from(c.1))
            .collect();
        Some(stats::median(&first)).filter(|code| code.is_finite())
    }

    /// When the code went from that of the load before to that of the load after it, for good. `sd`
    /// is the standard deviation of a code. `None` where the two loads are too near to each other,
    /// or no code of the load before was seen.
    ///
    /// What happens in between, such as one weight taken off before another is hung, makes the time
    /// less certain.
    #[must_use]
    pub fn came_on(&self, before: f64, after: f64, sd: f64) -> Option<CameOn> {
        let change = (after - before).abs();
        if change < LEAST_CHANGE_SD * sd {
            return None;
        }
        let is_old = |&(_, code): &(f64, i32)| (f64::from(code) - before).abs() < BAND * change;
        let is_other = |&(_, code): &(f64, i32)| (f64::from(code) - after).abs() >= BAND * change;
        // The last code that is not yet that of the new load, and the last before it that is still
        // that of the old one.
        let last_other = self.codes.iter().rposition(is_other)?;
        let last_old = self.codes.iter().take(last_other + 1).rposition(is_old)?;
        let from_s = self.codes[last_old].0;
        let to_s = self
            .codes
            .get(last_other + 1)
            .map_or(self.codes[last_other].0, |next| next.0);
        Some(CameOn {
            at_s: 0.5 * (from_s + to_s),
            sd_s: (0.5 * (to_s - from_s)).max(LEAST_SD_S),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cells;
    use emulator_link::Injection;
    use plant::PlantConfig;
    use rig::Rig;
    use session::link::fake::{Behavior, FakeBoard};
    use session::link::RigLink;

    /// Codes of a course over time, 320 a second, with noise of 20 codes.
    fn watch(seconds: f64, course: impl Fn(f64) -> f64) -> Watch {
        let mut watch = Watch::default();
        for i in 0..(320.0 * seconds) as usize {
            let time_s = i as f64 / 320.0;
            let noise = [20.0, -31.0, 8.0, 3.0][i % 4];
            watch.add(time_s, (course(time_s) + noise) as i32);
        }
        watch
    }

    #[test]
    fn a_weight_that_is_hung_seconds_before_enter_came_on_when_it_was_hung() {
        let hung = watch(8.0, |t| if t < 3.0 { 1e3 } else { 15e3 });
        let found = hung.came_on(1e3, 15e3, 25.0).unwrap();
        assert!(
            (found.at_s - 3.0).abs() < 0.01 && found.sd_s < 0.05,
            "{found:?}"
        );
        // Half a second of lowering, then a swing of a tenth.
        let lowered = |t: f64| {
            let swing = 1.0 + 0.1 * (-(t - 3.5)).exp() * (9.0 * t).sin();
            1e3 + 14e3 * ((t - 3.0) / 0.5).clamp(0.0, 1.0) * swing
        };
        let found = watch(8.0, lowered).came_on(1e3, 15e3, 25.0).unwrap();
        assert!((found.at_s - 3.25).abs() < 2.0 * found.sd_s, "{found:?}");
        assert!((0.05..0.3).contains(&found.sd_s), "{found:?}");
    }

    #[test]
    fn a_weight_taken_off_before_the_next_makes_the_time_less_certain() {
        let course = |t: f64| match t {
            t if t < 2.0 => 100e3,
            t if t < 5.0 => 1e3,
            _ => 50e3,
        };
        let found = watch(8.0, course).came_on(100e3, 50e3, 25.0).unwrap();
        assert!((found.at_s - 3.5).abs() < 0.02 && (found.sd_s - 1.5).abs() < 0.02);
    }

    #[test]
    fn what_was_not_seen_gives_no_time() {
        let same = watch(5.0, |_| 1e3);
        assert_eq!(same.came_on(1e3, 1.1e3, 25.0), None, "too small a change");
        assert_eq!(Watch::default().came_on(1e3, 15e3, 25.0), None);
        let already = watch(5.0, |_| 15e3);
        assert_eq!(already.came_on(1e3, 15e3, 25.0), None, "it hung before");
    }

    #[test]
    fn the_board_is_watched_and_other_units_do_not_count() {
        let rig = Rig::built_in().unwrap();
        let mut board = FakeBoard::with(Behavior::Good, 3, PlantConfig::default());
        let mut session = Session::connect(&mut board as &mut dyn RigLink).unwrap();
        cells::prepare(&mut session, &rig).unwrap();
        let _ = session.drain();
        let begun_ns = session.now_ns();
        let time_s = |now_ns: u64| 1e-9 * (now_ns - begun_ns) as f64;
        let mut watches = [(3, Watch::default())];
        for i in 0..60 {
            if i == 20 {
                let hung = Injection::PullCable(3, 4.9);
                session.link().controls().unwrap().inject(hung).unwrap();
                let other = Injection::PullCable(4, 9.8);
                session.link().controls().unwrap().inject(other).unwrap();
            }
            step(&mut session, &mut watches, time_s).unwrap();
        }
        let codes = &watches[0].1.codes;
        let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
        let all: Vec<f64> = codes.iter().map(|(_, code)| f64::from(*code)).collect();
        let (before, after) = (mean(&all[..200]), mean(&all[all.len() - 200..]));
        let found = watches[0].1.came_on(before, after, 300.0).unwrap();
        assert!((found.at_s - 1.0).abs() < 0.06, "{found:?}");
    }
}
