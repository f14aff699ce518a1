//! `forcectl monitor`: what a rig does now. A full-screen view on a terminal, lines elsewhere.
//!
//! | question | file |
//! | --- | --- |
//! | where do the data come from | `source` |
//! | what is known | `model` |
//! | the view, and who gets the terminal back | `view`, `screen` |
//! | lines, JSON | `plain` |
//! | the view as a picture | `picture` |
//! | a live source for Foxglove | `foxglove` |
//! | the force that a model tells | `estimate` |
//!
//! With `--json` each line is one object: `{"t_s": ..., "tension_n": [...], "state": ..., "zeroed":
//! [...], "force_n": [...], "encoder_counts": [...], "adc_code":
//! [...]}` for tensions (`null` for a unit without a sample), with `--estimate` also `"estimate":
//! {"estimate_y_n": ..., "half_width_n": ..., "valid": ..., "misfits": ...}` (`null` without
//! states), `{"t_s": ..., "event": ..., "text":
//! ...}` for what happens, with `fault` and `unit` for a fault (`null` for the whole board). An
//! error is the last line: `{"error": ..., "exit_code": ...}`.

#[cfg(feature = "estimate")]
mod estimate;
#[cfg(feature = "foxglove")]
mod foxglove;
mod model;
mod picture;
mod plain;
pub mod screen;
mod source;
#[cfg(test)]
mod tests;
mod view;

use super::connection::{booted_here, configure_embedded, Connection, Role};
use super::exit::{self, Failure, Reply, Result};
use super::output::{stdout_is_terminal, Output};
use super::{values, Context};
use clap::Args;
#[cfg(feature = "estimate")]
use estimator::estimator::Estimator;
#[cfg(feature = "estimate")]
use model::Estimated;
use model::Model;
use plain::Plain;
use rig::Rig;
use screen::{Key, Screen};
use session::Session;
use source::{Event, SessionSource, Source, Update};
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use view::View;

/// How long `monitor` and `record` run on the embedded rig where no duration is given, s.
pub const EMBEDDED_DURATION_S: f64 = 3.0;
/// Time between two pictures of the view.
const FRAME: Duration = Duration::from_millis(50);
/// Silence that the view mentions, and silence that ends the lines.
const SILENT: Duration = Duration::from_secs(1);
const GONE: Duration = Duration::from_secs(3);

/// Arguments of `monitor`.
#[derive(Debug, Args)]
pub struct Monitor {
    /// End after this time
    /// [default: at Ctrl-C or `q`; lines on an embedded rig of the command's own: 3]
    #[arg(long, value_name = "SECONDS", value_parser = values::seconds)]
    duration: Option<f64>,
    /// Print ten lines per second instead of the full-screen view
    /// [default where standard output is no terminal]
    #[arg(long)]
    plain: bool,
    /// Lines with the positions of the encoders in counts, in place of tensions: turn a reel by
    /// hand and look
    #[arg(long)]
    counts: bool,
    /// Write the view as it is at the end to this SVG file
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Stream to Foxglove as well, on this address and port; without one on the loopback
    /// (127.0.0.1:8765)
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = foxglove::DEFAULT_ADDRESS)]
    foxglove: Option<std::net::SocketAddr>,
    #[cfg(feature = "estimate")]
    #[command(flatten)]
    estimate: EstimateArgs,
    #[command(flatten)]
    connection: Connection,
}

/// The force that a model tells.
#[cfg(feature = "estimate")]
#[derive(Debug, Args)]
struct EstimateArgs {
    /// Show the contact force that this model file of `estimate train` tells of the robot's state
    /// as well, with its interval, and whether the model still fits the robot
    #[arg(
        long,
        value_name = "MODEL",
        requires = "robot",
        conflicts_with = "counts"
    )]
    estimate: Option<PathBuf>,
    /// File with the `[robot]` table that names the source of the robot's states
    #[arg(long, value_name = "FILE", requires = "estimate")]
    robot: Option<PathBuf>,
    /// Use the model although it was trained on another robot
    #[arg(long, requires = "estimate")]
    any_robot: bool,
}

/// The end of a command that watches the board.
pub struct End {
    start_ns: u64,
    duration_s: Option<f64>,
}

impl End {
    /// Starts to count. The embedded rig gets a duration, because its time passes as fast as it can
    /// be computed.
    pub fn after(session: &mut Session<'_>, duration_s: Option<f64>) -> Self {
        let default_s = booted_here(session).then_some(EMBEDDED_DURATION_S);
        Self {
            start_ns: session.now_ns(),
            duration_s: duration_s.or(default_s),
        }
    }

    /// Time since the start, s, in whole microseconds.
    pub fn elapsed_s(&self, session: &Session<'_>) -> f64 {
        ((session.now_ns() - self.start_ns) / 1_000) as f64 / 1e6
    }

    /// Part of the duration that is over; 0 where it is not known.
    #[cfg(feature = "record")]
    pub fn fraction(&self, session: &Session<'_>) -> f64 {
        self.duration_s.map_or(0.0, |s| self.elapsed_s(session) / s)
    }

    /// Whether the duration is over, or Ctrl-C was pressed.
    pub fn reached(&self, session: &Session<'_>, context: &Context) -> bool {
        let over = self
            .duration_s
            .is_some_and(|s| self.elapsed_s(session) >= s);
        over || context.interrupt.requested()
    }
}

/// One run of the monitor.
struct Watching<'a> {
    context: &'a Context,
    title: String,
    scale_n: f64,
    /// End after this time of the link, s.
    duration_s: Option<f64>,
    /// Time of the link passes as fast as it can be computed.
    own: bool,
    model: Model,
    start_s: Option<f64>,
    started: Instant,
    #[cfg(feature = "foxglove")]
    publisher: Option<foxglove::Publisher>,
    #[cfg(feature = "estimate")]
    estimating: Option<estimate::Estimating<'a>>,
}

impl Monitor {
    /// Runs the command. It ends early where its output is not read.
    pub fn run(&self, context: &Context) -> Result<Reply> {
        self.check_picture()?;
        let rig = self.connection.load(context)?;
        #[cfg(feature = "estimate")]
        let estimator = (self.estimate.estimate.as_deref())
            .map(crate::cli::estimate::model)
            .transpose()?;
        #[cfg(feature = "estimate")]
        let estimator = estimator.as_ref();
        #[cfg(unix)]
        if let Some(client) = self.connection.client(context) {
            let _controlled_stop = context.interrupt.controlled_stop();
            let welcome = client.welcome();
            let title = format!(
                "rig `{}`: {} (service: process {})",
                welcome.name, welcome.link, welcome.pid
            );
            let mut source = source::ServiceSource::new(client)?;
            #[cfg_attr(not(feature = "estimate"), allow(unused_mut))]
            let mut watching = Watching::new(context, title, &rig, self.duration, false);
            #[cfg(feature = "estimate")]
            watching.follow(&self.estimate, estimator)?;
            return self.watch(watching, &mut source);
        }
        self.connection
            .with_session(Role::Observer, context, |session, rig| {
                configure_embedded(session, rig)?;
                let own = booted_here(session);
                let title = format!("rig: {}", session.link().name());
                let duration = self
                    .duration
                    .or((own && !self.full_screen(context)).then_some(EMBEDDED_DURATION_S));
                #[cfg_attr(not(feature = "estimate"), allow(unused_mut))]
                let mut watching = Watching::new(context, title, rig, duration, own);
                #[cfg(feature = "estimate")]
                watching.follow(&self.estimate, estimator)?;
                let mut source = SessionSource::new(session, rig)?;
                self.watch(watching, &mut source)
            })
    }

    /// Refuses a picture that would replace a file that is read.
    fn check_picture(&self) -> Result<()> {
        let Some(picture) = &self.picture else {
            return Ok(());
        };
        #[cfg_attr(not(feature = "estimate"), allow(unused_mut))]
        let mut inputs = self.connection.inputs();
        #[cfg(feature = "estimate")]
        inputs.extend(self.estimate.estimate.as_deref());
        #[cfg(feature = "estimate")]
        inputs.extend(self.estimate.robot.as_deref());
        Ok(files::check_output(picture, &inputs)?)
    }

    /// Whether the view is shown.
    fn full_screen(&self, context: &Context) -> bool {
        let dumb = std::env::var_os("TERM").is_none_or(|term| term.is_empty() || term == "dumb");
        !self.plain && !self.counts && !context.output.json() && stdout_is_terminal() && !dumb
    }

    fn watch(&self, mut watching: Watching<'_>, source: &mut dyn Source) -> Result<Reply> {
        #[cfg(feature = "foxglove")]
        if let Some(address) = self.foxglove {
            let (publisher, at) = foxglove::Publisher::start(address, &watching.title)?;
            let text = format!("Foxglove: open a connection to ws://{at} (Foxglove WebSocket)");
            watching.context.output.note(&text);
            watching.publisher = Some(publisher);
        }
        let screen = if self.full_screen(watching.context) {
            // A terminal that can't be controlled gets lines.
            Screen::open().ok()
        } else {
            None
        };
        let watched = match screen {
            Some(mut screen) => watching.on(&mut screen, source),
            None => watching.as_lines(source, self.counts),
        };
        if let Some(path) = &self.picture {
            let svg = picture::svg(&watching.view(None));
            std::fs::write(path, svg).map_err(|error| Failure::file(path, error))?;
        }
        watched.map(|()| Reply::text(""))
    }
}

impl<'a> Watching<'a> {
    fn new(
        context: &'a Context,
        title: String,
        rig: &Rig,
        duration_s: Option<f64>,
        own: bool,
    ) -> Self {
        let scale_n = rig.units.iter().map(|unit| unit.tension_max_n);
        Self {
            context,
            title,
            scale_n: scale_n.fold(1.0, f64::max),
            duration_s,
            own,
            model: Model::of(rig),
            start_s: None,
            started: Instant::now(),
            #[cfg(feature = "foxglove")]
            publisher: None,
            #[cfg(feature = "estimate")]
            estimating: None,
        }
    }

    /// Shows what a model tells of the robot as well.
    #[cfg(feature = "estimate")]
    fn follow(&mut self, of: &EstimateArgs, estimator: Option<&'a Estimator>) -> Result<()> {
        if let (Some(estimator), Some(file)) = (estimator, &of.robot) {
            let estimating = estimate::Estimating::open(estimator, file, of.any_robot)?;
            self.estimating = Some(estimating);
            self.model.estimate = Some(Estimated::Silent);
        }
        Ok(())
    }

    /// What a model tells, where one was asked for.
    #[cfg_attr(not(feature = "estimate"), allow(clippy::unused_self))]
    fn estimates(&mut self) -> Vec<Update> {
        #[cfg(feature = "estimate")]
        if let Some(estimating) = &mut self.estimating {
            return estimating.next(self.model.now.t_s);
        }
        Vec::new()
    }

    fn view(&self, silence: Option<Duration>) -> View<'_> {
        View {
            model: &self.model,
            title: &self.title,
            scale_n: self.scale_n,
            silence,
        }
    }

    /// Time of the link since the start, s; that of the wall where the link's time stands still.
    fn elapsed_s(&self) -> f64 {
        let link_s = self.start_s.map_or(0.0, |start| self.model.now.t_s - start);
        if self.model.now.state == "no link" || self.model.silence(SILENT).is_some() {
            link_s.max(self.started.elapsed().as_secs_f64())
        } else {
            link_s
        }
    }

    fn over(&self) -> bool {
        self.context.interrupt.requested() || self.duration_s.is_some_and(|s| self.elapsed_s() >= s)
    }

    /// Takes an update and remembers when it all began.
    fn take(&mut self, update: Update) {
        if let (None, Update::Telemetry(now)) = (self.start_s, &update) {
            self.start_s = Some(now.t_s);
        }
        #[cfg(feature = "foxglove")]
        if let Some(publisher) = &self.publisher {
            publisher.take(&update);
        }
        self.model.take(update);
    }

    /// Lines until the end.
    fn as_lines(&mut self, source: &mut dyn Source, counts: bool) -> Result<()> {
        let output: &Output = &self.context.output;
        let mut plain = Plain::new(output, counts, self.model.estimate.clone());
        while !self.over() && output.is_open() {
            match source.next()? {
                Some(update) => {
                    self.take(update.clone());
                    plain.show(&update, self.start_s.unwrap_or_default());
                }
                None if self.model.silence(GONE).is_some() => {
                    let text = format!("the rig's service sends nothing for {} s", GONE.as_secs());
                    return Err(Failure::new(exit::LINK, text));
                }
                None => {}
            }
            for update in self.estimates() {
                self.take(update.clone());
                plain.show(&update, self.start_s.unwrap_or_default());
            }
        }
        Ok(())
    }

    /// The view until the end.
    fn on(&mut self, screen: &mut Screen, source: &mut dyn Source) -> Result<()> {
        let lost = |error: std::io::Error| {
            Failure::new(exit::FILE, format!("the terminal can't be used: {error}"))
        };
        let mut drawn: Option<Instant> = None;
        while !self.over() {
            if let Some(update) = source.next()? {
                self.take(update);
            }
            for update in self.estimates() {
                self.take(update);
            }
            match screen.key(self.ahead()).map_err(lost)? {
                Some(Key::Quit) => return Ok(()),
                Some(Key::Stop) => self.stop(source),
                Some(Key::Interrupt) => {
                    let flag = self.context.interrupt.flag();
                    flag.store(true, Ordering::SeqCst);
                }
                None => {}
            }
            if drawn.is_none_or(|at| at.elapsed() >= FRAME) {
                drawn = Some(Instant::now());
                let view = self.view(self.model.silence(SILENT));
                screen.draw(|frame| view.draw(frame)).map_err(lost)?;
            }
        }
        Ok(())
    }

    /// How far an embedded rig of the command's own is ahead of the clock on the wall: a view is
    /// for people.
    fn ahead(&self) -> Duration {
        let ahead_s = self.elapsed_s() - self.started.elapsed().as_secs_f64();
        if self.own && ahead_s > 0.0 {
            Duration::from_secs_f64(ahead_s.min(0.1))
        } else {
            Duration::ZERO
        }
    }

    /// Stops the rig. A refusal is shown and ends nothing.
    fn stop(&mut self, source: &mut dyn Source) {
        let text = match source.stop() {
            Ok(()) => {
                "stopped here: all motors at 0 V; `forcectl clear` before arming again".to_owned()
            }
            Err(failure) => format!("THE STOP FAILED: {}", failure.message),
        };
        self.model.note(Event {
            t_s: self.model.now.t_s,
            kind: "stop".to_owned(),
            text,
            ..Event::default()
        });
    }
}
