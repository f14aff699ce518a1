//! The monitor as lines: a table for people, or one JSON object per line.

use super::model::{reading, Estimated, Reading};
use super::source::{Event, Update};
use crate::cli::output::Output;
use serde_json::json;
use session::telemetry::Telemetry;
use session::{explain_fault, LatchedFault};
use wire::UNITS;

/// Time between two lines, s.
const PERIOD_S: f64 = 0.1;
/// Telemetry that comes a little early counts as in time, s.
const EARLY_S: f64 = 0.005;

/// Prints what it is given.
#[derive(Debug)]
pub struct Plain<'o> {
    output: &'o Output,
    /// Counts of the encoders in place of tensions.
    counts: bool,
    due_s: Option<f64>,
    /// State in the last line.
    last_state: String,
    /// What a model tells of the force, where one was asked for.
    estimate: Option<Estimated>,
}

impl<'o> Plain<'o> {
    /// Prints the head of the table. `estimate`: what a model tells of the force.
    pub fn new(output: &'o Output, counts: bool, estimate: Option<Estimated>) -> Self {
        if !output.json() {
            output.line(&head(if counts { "counts" } else { "N" }));
        }
        Self {
            output,
            counts,
            due_s: None,
            last_state: String::new(),
            estimate,
        }
    }

    /// Prints an update; `start_s` is the link's time at the start.
    pub fn show(&mut self, update: &Update, start_s: f64) {
        match update {
            Update::Event(event) => self.event(event, event.t_s - start_s),
            Update::Telemetry(now) => self.telemetry(now, start_s),
            Update::Estimate(estimate) => self.estimate = Some(estimate.clone()),
        }
    }

    fn telemetry(&mut self, now: &Telemetry, start_s: f64) {
        let Some(due_s) = self.due_s else {
            // The first one: what is latched already.
            self.due_s = Some(now.t_s + PERIOD_S);
            self.last_state.clone_from(&now.state);
            for fault in &now.faults {
                self.event(&latched(fault, now.t_s), now.t_s - start_s);
            }
            return;
        };
        // A change of state is shown at once: time may stand still with it.
        if now.t_s + EARLY_S < due_s && now.state == self.last_state {
            return;
        }
        self.due_s = Some((due_s + PERIOD_S).max(now.t_s + 0.5 * PERIOD_S));
        self.last_state.clone_from(&now.state);
        let t_s = ((now.t_s - start_s) * 1e6).round() / 1e6;
        self.output.line(&if self.output.json() {
            let mut object = json!({
                "t_s": t_s,
                "tension_n": now.tension_n,
                "state": now.state,
                "zeroed": now.zeroed,
                "force_n": now.force_n,
                "encoder_counts": now.encoder_counts,
                "adc_code": now.adc_code,
            });
            if let Some(estimate) = &self.estimate {
                object["estimate"] = estimate.json();
            }
            object.to_string()
        } else if self.counts {
            counts_line(now, t_s)
        } else {
            let estimate = self.estimate.as_ref().map(Estimated::text);
            line(now, t_s) + &estimate.map_or_else(String::new, |text| format!("  {text}"))
        });
    }

    fn event(&self, event: &Event, t_s: f64) {
        if self.output.json() {
            let mut object = json!({"t_s": t_s, "event": event.kind, "text": event.text});
            if let Some(code) = event.fault {
                object["fault"] = code.into();
                object["unit"] = json!(event.unit);
            }
            self.output.line(&object.to_string());
        } else if event.kind == "fault" {
            self.output.error(&printable(&event.text));
        } else {
            self.output.note(&printable(&event.text));
        }
    }
}

/// A fault that was latched before the monitor came, as an event.
fn latched(fault: &LatchedFault, t_s: f64) -> Event {
    let who = fault
        .unit
        .map_or_else(|| "board".to_owned(), |unit| format!("unit {unit}"));
    Event {
        t_s,
        kind: "fault".to_owned(),
        text: format!(
            "{who}: latched: {}",
            explain_fault(fault.code, fault.detail)
        ),
        fault: Some(fault.code),
        unit: fault.unit,
    }
}

/// A text of someone else without the characters that control a terminal.
pub fn printable(text: &str) -> String {
    text.chars()
        .map(|c| if c.is_control() { '?' } else { c })
        .collect()
}

fn head(unit: &str) -> String {
    let units: String = (1..=UNITS)
        .map(|n| format!("{:>9}", format!("unit {n}")))
        .collect();
    format!("{:>9}  {:<9}{units}   ({unit})", "t s", "state")
}

/// One line of the table: where the encoders stand.
pub fn counts_line(now: &Telemetry, t_s: f64) -> String {
    let cell = |counts: Option<i32>| counts.map_or_else(|| "-".to_owned(), |n| n.to_string());
    let cells: String = now
        .encoder_counts
        .iter()
        .map(|counts| format!("{:>9}", cell(*counts)))
        .collect();
    format!("{t_s:>9.2}  {:<9}{cells}", printable(&now.state))
}

/// One line of the table.
pub fn line(now: &Telemetry, t_s: f64) -> String {
    let cells: String = (0..UNITS)
        .map(|i| match reading(now, i) {
            Reading::None => format!("{:>9}", "-"),
            Reading::Offline => format!("{:>9}", "off"),
            Reading::Zeroing => format!("{:>9}", "zeroing"),
            Reading::NoZero(_) => format!("{:>9}", "no zero"),
            Reading::Tension(tension_n) => format!("{tension_n:>9.3}"),
        })
        .collect();
    format!("{t_s:>9.2}  {:<9}{cells}", printable(&now.state))
}
