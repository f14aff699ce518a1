//! Recovery of the bus: when a round starts, what a stuck bus reports, and the pause between
//! rounds. The steps of a round are those of [`drivers::tca9548::recovery`].

use super::types::{Event, Sink, Work};
use super::{Bus, STUCK_AFTER, STUCK_PAUSE_US};
use control::Micros;
use drivers::tca9548::recovery::{self, RecoveryStep};

/// State of the recovery.
#[derive(Debug, Clone, Copy)]
pub(super) enum Recovery {
    /// A round starts with the next call.
    Due,
    /// A round is in progress.
    Running {
        round: recovery::Recovery,
        sda_high: bool,
    },
    /// The bus is stuck; the next round starts later.
    Pause { until: Micros },
}

impl Bus {
    /// The next step of the recovery. `None`: the recovery is over (`self.recovery` is `None`) or
    /// pauses.
    pub(super) fn recover(&mut self, now: Micros, sink: &mut impl Sink) -> Option<Work> {
        loop {
            match self.recovery.as_mut()? {
                Recovery::Due => {
                    self.rounds = self.rounds.saturating_add(1);
                    sink.event(Event::Recovery);
                    self.mux.invalidate();
                    self.recovery = Some(Recovery::Running {
                        // A failure before any transaction has worked: the clocks alone did not
                        // help.
                        round: recovery::Recovery::new(self.rounds > 1),
                        sda_high: true,
                    });
                }
                Recovery::Running { round, sda_high } => match round.next(*sda_high) {
                    RecoveryStep::TakeLines => return Some(Work::TakeLines),
                    RecoveryStep::Lines { scl, sda } => {
                        self.stepping = true;
                        return Some(Work::Lines { scl, sda });
                    }
                    RecoveryStep::MuxReset { low } => {
                        self.stepping = true;
                        return Some(Work::MuxReset { low });
                    }
                    RecoveryStep::GiveLines { released } => {
                        self.recovery = None;
                        if self.rounds >= STUCK_AFTER {
                            sink.event(Event::Stuck {
                                rounds: self.rounds,
                                sda_low: !released,
                            });
                            self.recovery = Some(Recovery::Pause {
                                until: now.plus(STUCK_PAUSE_US),
                            });
                        }
                        return Some(Work::GiveLines);
                    }
                },
                Recovery::Pause { until } => {
                    if now.until(*until) > 0 {
                        return None;
                    }
                    self.recovery = None;
                }
            }
        }
    }
}
