//! States that the caller brings: of a virtual arm, or of a log that is replayed.

use super::{sift, Poll, Source, SourceError};
use crate::state::{Mount, RobotState};
use crate::watch::{Watch, WatchConfig};

/// A source that is fed.
#[derive(Debug, Clone)]
pub struct Fed {
    name: String,
    watch: Watch,
    mount: Mount,
    waiting: Vec<RobotState>,
}

impl Fed {
    /// Nothing fed yet; the states are in the rig's frame.
    #[must_use]
    pub fn new(name: &str, watch: WatchConfig) -> Self {
        Self::mounted(name, watch, Mount::default())
    }

    /// Nothing fed yet, from a robot whose frame stands at `mount` in the rig's.
    #[must_use]
    pub fn mounted(name: &str, watch: WatchConfig, mount: Mount) -> Self {
        Self {
            name: name.to_owned(),
            watch: Watch::new(watch),
            mount,
            waiting: Vec::new(),
        }
    }

    /// Adds states, in order. They come out of the next poll if they are in order.
    pub fn feed(&mut self, states: impl IntoIterator<Item = RobotState>) {
        self.waiting.extend(states);
    }
}

impl Source for Fed {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        let mut poll = Poll::default();
        // Each state at its own time on the virtual clock, so that a poll of 10 ms is no burst.
        for state in std::mem::take(&mut self.waiting) {
            let at = state.stamp.t_ns.min(now_ns);
            let one = sift(vec![Ok(state)], &mut self.watch, &self.mount, at);
            poll.extend(one);
        }
        poll.events.extend(self.watch.tick(now_ns));
        Ok(poll)
    }
}
