//! The monitor as a full-screen view. Only what is drawn; the terminal itself is in `screen`.
//!
//! ```text
//! rig, link                                     time
//! state, E-stop, setpoints, who commands, clients
//! tensions: number, setpoint, bar, curve                six lines
//! force at the tip: commanded, measured, true, estimated; tip
//! latency, what was lost
//! latched faults, then events                           the rest
//! keys
//! ```
//!
//! Whatever is said in colour is said in words as well.

use super::model::{Estimated, Model, Reading, HISTORY_S};
use control::Fault;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style, Stylize};
use ratatui::text::{Line, Span, Text};
use ratatui::widgets::{Block, Borders, Paragraph, Sparkline, Wrap};
use ratatui::Frame;
use session::telemetry::Telemetry;
use session::{explain_fault, LatchedFault};
use std::time::Duration;
use wire::UNITS;

/// A view with more lines than this has titles between its parts.
const TALL: u16 = 20;
/// Width of the number and the setpoint of a unit.
const NUMBERS: u16 = 38;
/// Least width of a bar, and of a curve.
const LEAST_BAR: u16 = 10;
const LEAST_CURVE: u16 = 24;
/// A tension that differs more than this from its setpoint while the unit runs is marked, N.
const OFF_N: f64 = 0.25;

/// Least height of the curves, N.
const LEAST_HEIGHT_N: f64 = 1.0;
const LOSSES_TITLE: &str =
    "Latency edge to DAC (worst of 1 s); frames lost, damaged, dropped; conversions missed";

/// What is drawn.
#[derive(Debug)]
pub struct View<'a> {
    /// The data.
    pub model: &'a Model,
    /// Rig and link.
    pub title: &'a str,
    /// Tension at the right end of the bars, N.
    pub scale_n: f64,
    /// For how long nothing has come.
    pub silence: Option<Duration>,
}

impl View<'_> {
    /// Draws the view over the whole area.
    pub fn draw(&self, frame: &mut Frame<'_>) {
        let area = frame.area();
        let tall = area.height > TALL;
        let titled = |rows: u16| Constraint::Length(rows + u16::from(tall));
        let forces = self.forces();
        let rows = u16::try_from(forces.lines.len()).unwrap_or(u16::MAX);
        let [title, state, tensions, tip, link, log, keys] = Layout::vertical([
            Constraint::Length(1),
            Constraint::Length(2),
            titled(UNITS as u16),
            titled(rows),
            titled(1),
            Constraint::Min(0),
            Constraint::Length(1),
        ])
        .areas(area);
        self.title(frame, title);
        frame.render_widget(Paragraph::new(self.state()), state);
        let heading = self.heading(area.width);
        let inner = under(frame, &heading, tensions, tall);
        self.tensions(frame, inner);
        let inner = under(frame, &self.tip(), tip, tall);
        frame.render_widget(Paragraph::new(forces), inner);
        let inner = under(frame, LOSSES_TITLE, link, tall);
        frame.render_widget(Paragraph::new(self.losses()), inner);
        let inner = under(frame, "Faults and events", log, tall);
        self.log(frame, inner);
        frame.render_widget(Paragraph::new(footer()), keys);
    }

    fn now(&self) -> &Telemetry {
        &self.model.now
    }

    fn title(&self, frame: &mut Frame<'_>, area: Rect) {
        let time = format!(" {:.1} s", self.now().t_s);
        let width = u16::try_from(time.len()).unwrap_or(0);
        let [left, right] =
            Layout::horizontal([Constraint::Min(0), Constraint::Length(width)]).areas(area);
        frame.render_widget(Paragraph::new(self.title.bold()), left);
        frame.render_widget(Paragraph::new(time), right);
    }

    /// State of the board in words that say whether it pulls.
    fn state(&self) -> Text<'static> {
        let now = self.now();
        let (text, style) = match (self.silence, now.state.as_str()) {
            _ if self.model.came.is_none() => ("WAITING for data".to_owned(), warning()),
            (Some(age), _) => (
                format!(
                    "NO DATA for {:.0} s; what is shown is old",
                    age.as_secs_f64()
                ),
                alarm(),
            ),
            (None, "no link") => ("LINK LOST; it is tried again".to_owned(), alarm()),
            (None, "no status") => ("THE BOARD IS SILENT".to_owned(), alarm()),
            (None, "fault") => ("FAULT, all motors at 0 V".to_owned(), alarm()),
            (None, "running") => (
                "RUNNING, motors act".to_owned(),
                Style::new().fg(Color::Green).add_modifier(Modifier::BOLD),
            ),
            (None, "ready") => ("DISARMED (ready), 0 V".to_owned(), Style::new().bold()),
            (None, "zeroing") => ("ZEROING, 0 V".to_owned(), warning()),
            (None, "stopping") => ("RAMPING DOWN".to_owned(), warning()),
            (None, "bring-up") => ("BRINGING UP the sensors, 0 V".to_owned(), warning()),
            (None, other) => (other.to_uppercase(), warning()),
        };
        let mut spans = vec![Span::styled(text, style)];
        match now.estop_closed {
            Some(false) => spans.push(Span::styled("  E-STOP OPEN", alarm())),
            Some(true) => spans.push("  E-stop closed".into()),
            None => {}
        }
        if let Some(age) = now.setpoint_age_ms {
            spans.push(format!("  setpoints {age} ms old").into());
        }
        let mut lines = vec![Line::from(spans)];
        // A session of its own knows of nobody else.
        if !now.clients.is_empty() {
            let who = match &now.commander {
                Some(name) => format!("commander: {name}"),
                None => "nobody commands".to_owned(),
            };
            lines.push(Line::from(format!("{who}  clients: {}", now.clients.len())));
        }
        Text::from(lines)
    }

    fn heading(&self, width: u16) -> String {
        let (bar, curve) = widths(width);
        let mut text = "Tension, N: measured / setpoint, difference".to_owned();
        if bar >= LEAST_BAR {
            text.push_str(&format!("; bars to {} N", self.scale_n));
        }
        if curve >= LEAST_CURVE {
            text.push_str(&format!(
                "; last {:.0} s, to {:.1} N",
                f64::from(curve) * HISTORY_S,
                self.height_n()
            ));
        }
        text
    }

    /// Tension at the top of the curves: the largest in the history.
    fn height_n(&self) -> f64 {
        let all = self.model.history.iter().flatten().flatten();
        all.fold(LEAST_HEIGHT_N, |max, tension_n| max.max(*tension_n))
    }

    fn tensions(&self, frame: &mut Frame<'_>, area: Rect) {
        for i in 0..UNITS {
            let Ok(row) = u16::try_from(i) else { return };
            if row >= area.height {
                return;
            }
            let line = Rect::new(area.x, area.y + row, area.width, 1);
            let (bar, _) = widths(area.width);
            let [numbers, bar, curve] = Layout::horizontal([
                Constraint::Length(NUMBERS),
                Constraint::Length(bar),
                Constraint::Min(0),
            ])
            .areas(line);
            let (text, style) = self.unit(i);
            // Words may take the place of the bar.
            frame.render_widget(
                Paragraph::new(Span::styled(text, style)),
                numbers.union(bar),
            );
            let barred = !self.faulted(i);
            if let Some(Reading::Tension(tension_n)) = barred.then(|| self.model.reading(i)) {
                if bar.width >= LEAST_BAR {
                    let setpoint_n = self.now().setpoint_n[i].filter(|_| self.runs(i));
                    let width = usize::from(bar.width) - 1;
                    let text = self.bar(tension_n, setpoint_n, width);
                    frame.render_widget(Paragraph::new(Span::styled(text, style)), bar);
                }
            }
            if curve.width >= LEAST_CURVE {
                self.curve(frame, curve, i);
            }
        }
    }

    fn faulted(&self, i: usize) -> bool {
        let unit = |fault: &LatchedFault| fault.unit.map(usize::from) == Some(i + 1);
        self.now().faults.iter().any(unit)
    }

    fn runs(&self, i: usize) -> bool {
        matches!(
            self.now().unit_state[i].as_deref(),
            Some("running" | "stopping")
        )
    }

    /// A unit in words.
    fn unit(&self, i: usize) -> (String, Style) {
        let now = self.now();
        let state = now.unit_state[i].as_deref().unwrap_or("-");
        let head = format!("{} {state:<9}", i + 1);
        let fault = now
            .faults
            .iter()
            .find(|fault| fault.unit.map(usize::from) == Some(i + 1));
        if let Some(fault) = fault {
            return (format!("{head} {}", short(fault)), alarm());
        }
        match self.model.reading(i) {
            Reading::None => (format!("{head} no sample{}", self.counts(i)), warning()),
            Reading::Offline => (format!("{head}{}", self.counts(i)), Style::new().dim()),
            Reading::Zeroing => (format!("{head} zero is being taken"), warning()),
            Reading::NoZero(value) => {
                let why = if now.zeroed[i].is_none() {
                    "zero not read yet"
                } else {
                    "NO ZERO"
                };
                (
                    format!("{head} {why} (raw {value:.3} N){}", self.counts(i)),
                    warning(),
                )
            }
            Reading::Tension(tension_n) => match now.setpoint_n[i].filter(|_| self.runs(i)) {
                Some(setpoint_n) => {
                    let error_n = tension_n - setpoint_n;
                    let style = if error_n.abs() > OFF_N {
                        warning()
                    } else {
                        Style::new().fg(Color::Green)
                    };
                    (
                        format!("{head}{tension_n:>8.3} /{setpoint_n:>7.3}  {error_n:>+7.3}"),
                        style,
                    )
                }
                None => (
                    format!("{head}{tension_n:>8.3}{}", self.counts(i)),
                    Style::new(),
                ),
            },
        }
    }

    /// Where the encoder of a unit stands, for who turns its reel by hand.
    fn counts(&self, i: usize) -> String {
        self.now().encoder_counts[i].map_or_else(String::new, |counts| format!("  {counts} counts"))
    }

    /// A bar with a mark at the setpoint.
    fn bar(&self, tension_n: f64, setpoint_n: Option<f64>, width: usize) -> String {
        let cell = |value_n: f64| {
            let share = (value_n / self.scale_n).clamp(0.0, 1.0);
            (share * width as f64).round() as usize
        };
        let filled = cell(tension_n);
        let mark = setpoint_n.map(|setpoint_n| cell(setpoint_n).min(width - 1));
        (0..width)
            .map(|column| match mark {
                Some(mark) if mark == column => '|',
                _ if column < filled => '█',
                _ => '·',
            })
            .collect()
    }

    /// The tension until now, as far as it fits.
    fn curve(&self, frame: &mut Frame<'_>, area: Rect, i: usize) {
        let width = usize::from(area.width);
        let history = &self.model.history;
        let skip = history.len().saturating_sub(width);
        let points: Vec<Option<u64>> = history
            .iter()
            .skip(skip)
            .map(|point| point[i].map(|tension_n| (tension_n.max(0.0) * 1e3).round() as u64))
            .collect();
        let curve = Sparkline::default()
            .data(points)
            .max((self.height_n() * 1e3).ceil() as u64)
            .style(Style::new().fg(Color::Cyan));
        frame.render_widget(curve, area);
    }

    fn tip(&self) -> String {
        let tip = self.now().tip_m.map_or_else(String::new, |tip| {
            let mm = tip.map(|x| format!("{:.1}", x * 1e3));
            format!(" at [{}] mm", mm.join(" "))
        });
        format!("Force of the cables at the tip{tip}, N")
    }

    fn forces(&self) -> Text<'static> {
        let now = self.now();
        let cells = |force: [f64; 3]| {
            let length = force.iter().map(|x| x * x).sum::<f64>().sqrt();
            format!(
                "x{:>8.3}  y{:>8.3}  z{:>8.3}  length{:>7.3}",
                force[0], force[1], force[2], length
            )
        };
        let measured = match (now.force_n, now.tip_m) {
            (Some(force), _) => Line::from(format!("measured  {}", cells(force))),
            (None, None) => Line::styled("measured  not known: no pose of the tip", warning()),
            (None, Some(_)) => Line::styled(
                "measured  not known: a unit without a zero or a sample",
                warning(),
            ),
        };
        let commanded = self.model.commanded_n();
        let commanded = commanded.map(|force| Line::from(format!("commanded {}", cells(force))));
        let mut lines: Vec<Line<'_>> = commanded.into_iter().chain([measured]).collect();
        if let Some(force) = now.true_force_n {
            lines.push(Line::from(format!("true      {}", cells(force))));
        }
        if let Some(estimate) = &self.model.estimate {
            let style = match estimate {
                Estimated::Force { misfits: true, .. } => alarm(),
                Estimated::Force { valid: true, .. } => Style::new(),
                Estimated::Force { .. } | Estimated::Silent => warning(),
            };
            lines.push(Line::styled(
                format!("estimated {}", estimate.text()),
                style,
            ));
        }
        Text::from(lines)
    }

    fn losses(&self) -> Line<'static> {
        let drops = &self.now().drops;
        let latency = self.model.worst_latency_us().map_or_else(
            || "-".to_owned(),
            |us| format!("{:.3} ms", f64::from(us) * 1e-3),
        );
        let style = if drops.frames_lost > 0 || drops.conversions_missed > 0 {
            warning()
        } else {
            Style::new()
        };
        Line::from(vec![
            format!("latency {latency}  ").into(),
            Span::styled(
                format!(
                    "lost {}  damaged {}  dropped {}  missed {}",
                    drops.frames_lost,
                    drops.frames_bad + u64::from(drops.board_bad),
                    drops.board_dropped,
                    drops.conversions_missed
                ),
                style,
            ),
        ])
    }

    /// LatchedFault faults on top, then the newest events that fit.
    fn log(&self, frame: &mut Frame<'_>, area: Rect) {
        let faults = &self.now().faults;
        let texts = |words: fn(&LatchedFault) -> String| -> Vec<String> {
            let text = |fault| format!("{}: {}", who(fault), words(fault));
            faults.iter().map(text).collect()
        };
        let mut shown = texts(meaning);
        // In short where the meaning would leave no line for an event; the way out stays.
        if lines_of(&shown, area.width) >= area.height {
            shown = texts(way_out);
        }
        let above = lines_of(&shown, area.width).min(area.height);
        let lines: Vec<Line<'_>> = shown
            .into_iter()
            .map(|t| Line::styled(t, alarm()))
            .collect();
        let [top, rest] =
            Layout::vertical([Constraint::Length(above), Constraint::Min(0)]).areas(area);
        frame.render_widget(Paragraph::new(lines).wrap(Wrap { trim: true }), top);
        let fits = usize::from(rest.height);
        let skip = self.model.log.len().saturating_sub(fits);
        let events: Vec<Line<'_>> = self
            .model
            .log
            .iter()
            .skip(skip)
            .map(|event| {
                let style = match event.kind.as_str() {
                    "fault" | "stop" | "misfit" => Style::new().fg(Color::Red),
                    "link" | "reset" | "robot" => warning(),
                    _ => Style::new(),
                };
                Line::styled(format!("{:>8.1} s  {}", event.t_s, event.text), style)
            })
            .collect();
        frame.render_widget(Paragraph::new(events), rest);
    }
}

/// Widths of the bars and of the curves, 0 where there is no room.
fn widths(width: u16) -> (u16, u16) {
    let spare = width.saturating_sub(NUMBERS);
    if spare >= LEAST_BAR + LEAST_CURVE {
        let bar = (spare / 2).min(spare - LEAST_CURVE);
        (bar, spare - bar)
    } else {
        (spare, 0)
    }
}

/// Lines that texts take at this width. Words are not split, so each line may lose part of its
/// width.
fn lines_of(texts: &[String], width: u16) -> u16 {
    let width = usize::from(width.max(1));
    let lines = |text: &String| {
        let (mut lines, mut used) = (1, 0);
        for word in text.split(' ') {
            let length = word.chars().count();
            if used > 0 && used + 1 + length > width {
                lines += 1;
                used = length;
            } else {
                used += length + usize::from(used > 0);
            }
        }
        lines
    };
    u16::try_from(texts.iter().map(lines).sum::<usize>()).unwrap_or(u16::MAX)
}

/// The area under a title.
fn under(frame: &mut Frame<'_>, title: &str, area: Rect, titled: bool) -> Rect {
    if !titled {
        return area;
    }
    let block = Block::new()
        .borders(Borders::TOP)
        .border_style(Style::new().dim())
        .title(format!(" {title} "));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    inner
}

fn footer() -> Line<'static> {
    Line::from(vec![
        " s ".reversed().bold(),
        " STOP the rig: all motors 0 V   ".bold(),
        " q ".reversed(),
        " end the view".into(),
    ])
}

fn who(fault: &LatchedFault) -> String {
    fault
        .unit
        .map_or_else(|| "board".to_owned(), |unit| format!("unit {unit}"))
}

/// Number and name.
fn short(fault: &LatchedFault) -> String {
    Fault::from_code(fault.code).map_or_else(
        || format!("fault {}", fault.code),
        |known| format!("fault {}, {}", fault.code, known.name()),
    )
}

/// What a fault means, and the way out.
fn meaning(fault: &LatchedFault) -> String {
    match Fault::from_code(fault.code) {
        Some(known) => format!(
            "{}. {} {}",
            short(fault),
            known.meaning(),
            known.what_to_do()
        ),
        None => explain_fault(fault.code, fault.detail),
    }
}

/// What to do about a fault.
fn way_out(fault: &LatchedFault) -> String {
    let what = Fault::from_code(fault.code).map_or("", |known| known.what_to_do());
    format!("{}. {what}", short(fault))
}

fn alarm() -> Style {
    Style::new().fg(Color::Red).add_modifier(Modifier::BOLD)
}

fn warning() -> Style {
    Style::new().fg(Color::Yellow)
}
