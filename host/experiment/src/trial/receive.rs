//! What comes in a period of a trial: samples to the joiner and the recorder, states to rows,
//! events and faults to the end.

use super::super::feed::Feed;
use super::{robot_gone, tip_of, End, Run};
use robot::state::TipForce;
use robot::watch::Event;
use run::{Observer, RunError};
use session::{Received, Session};
use wire::message::flags;

impl Run<'_> {
    /// Takes what came in a period.
    pub(super) fn receive(
        &mut self,
        session: &mut Session<'_>,
        feed: &mut Feed,
        t_s: f64,
    ) -> Result<(), End> {
        let now_ns = session.now_ns();
        let fresh = feed
            .poll(session.link(), now_ns)
            .map_err(|error| robot_gone(&error))?;
        let received = session.drain();
        self.log.received(&received);
        self.take(&received);
        self.arm.extend(fresh.truth);
        for event in &fresh.poll.events {
            self.note_event(event, &format!("{t_s:.3} s"));
        }
        for (part, count) in &fresh.poll.left_out {
            let left_out = &mut self.shown.counts.robot_left_out;
            *left_out.entry((*part).to_owned()).or_default() += count;
        }
        // What came together with such an event is in doubt.
        let stop = fresh.poll.stop();
        for state in fresh.poll.states.iter().filter(|_| stop.is_none()) {
            // A state without a tip leaves the one before in force. How old that may get is watched
            // where states come from.
            self.newest = tip_of(&fresh.poll, state).or(self.newest);
            self.row(state, now_ns);
        }
        if let Some(joiner) = &mut self.joiner {
            joiner.join(self.now_board_s, false);
        }
        self.record_rows();
        self.note_requests(&fresh.poll.requests, t_s);
        if let Some(event) = stop {
            return Err(End::Stopped(format!(
                "at {t_s:.2} s: {event}; the cables were ramped down and the rig disarmed"
            )));
        }
        if let Some(command) = ends_trial(&fresh.poll.commands) {
            return Err(End::Stopped(format!(
                "at {t_s:.2} s: the robot's side commanded `{command}` (state_command); the cables were ramped down and the rig disarmed"
            )));
        }
        match session.fault_in(&received) {
            Some(fault) => Err(RunError::from(fault).into()),
            None => Ok(()),
        }
    }

    /// Samples into the joiner, the plant's truth into its queue.
    pub(super) fn take(&mut self, received: &Received) {
        if let Some(joiner) = &mut self.joiner {
            joiner.samples(&received.samples);
            self.shown.counts.samples(&received.samples);
        }
        self.saturated = received
            .samples
            .iter()
            .any(|timed| timed.sample.flags & flags::AT_A_LIMIT != 0);
        if let Some(newest) = received.samples.iter().map(|timed| timed.t_us).max() {
            self.now_board_s = self.now_board_s.max(newest as f64 * 1e-6);
        }
        self.plant.extend(received.truth.iter().cloned());
        while self.plant.len() > 2000 {
            self.plant.pop_front();
        }
        while self.arm.len() > 2000 {
            self.arm.pop_front();
        }
    }

    /// Keeps what is not in order with the robot. What is left out from now on is told at once:
    /// nothing else would tell of it before the end.
    pub(super) fn note_event(&mut self, event: &Event, when: &str) {
        let text = format!("{when}: {event}");
        if matches!(event, Event::LeftOut(_)) {
            self.log.notice(&text);
        }
        self.shown.events.push(text);
        self.shown.counts.robot_events += 1;
    }

    /// A force that the robot's side asks for does not change the profile of a trial. That is said
    /// once.
    fn note_requests(&mut self, requests: &[TipForce], t_s: f64) {
        let Some(request) = requests.first().filter(|_| !self.asked) else {
            return;
        };
        self.asked = true;
        let [x, y, z] = request.force_n;
        let text = format!(
            "{t_s:.3} s: the robot's side asks for a force of ({x:.2}, {y:.2}, {z:.2}) N (servo_cf); an experiment applies its own profile"
        );
        self.log.notice(&text);
        self.shown.events.push(text);
    }
}

/// The first command of the robot's side that ends a trial. Whatever else it says, `enable` among
/// it, changes nothing.
fn ends_trial(commands: &[String]) -> Option<&String> {
    let ends = |command: &&String| matches!(command.as_str(), "disable" | "pause" | "unhome");
    commands.iter().find(ends)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_to_rest_ends_a_trial_and_no_command_begins_anything() {
        let ends = |words: &[&str]| {
            let commands: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
            ends_trial(&commands).cloned()
        };
        assert_eq!(ends(&["enable", "resume", "home", "dance"]), None);
        for word in ["disable", "pause", "unhome"] {
            assert_eq!(ends(&["enable", word]).as_deref(), Some(word));
        }
    }
}
