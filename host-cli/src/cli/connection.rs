//! Options of the commands that talk to a rig, and the connection that they describe.
//!
//! A rig is reached in one of three ways ([`Target`]): through the service that owns its link
//! (`forcectl rig` or `forcectl serve`; the latter is started on demand), directly, or as an
//! embedded rig that lives as long as the command.

use super::exit::{self, Failure, Result};
use super::Context;
use super::{tested, values};
use clap::Args;
use control::SystemState;
use known::base;
use known::ZeroStore;
use rig::{LinkChoice, Rig};
use run::Zeroing;
#[cfg(unix)]
use service::{self, client::ServiceLink, protocol::Welcome, socket, Client};
use session::link::fast::plant_of;
use session::link::of_board::OfBoard;
use session::link::{self, EmbeddedOptions, RigLink};
use session::Session;
#[cfg(unix)]
use std::cell::Cell;
use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Heading of the options that only the embedded rig has.
pub const EMBEDDED: &str = "Embedded rig";

/// Seed of an emulated rig where none is given.
const DEFAULT_SEED: u64 = 1;

/// A rig that exists, and how it is reached: options of the commands that never start an emulation.
#[derive(Debug, Args, Default)]
#[command(next_help_heading = "Connection")]
pub struct Existing {
    /// Connection to the rig: usb, serial:PORT, rig:NAME for a rig that `forcectl rig` keeps,
    /// embedded for one of the command's own, or fast for one without the emulated controller
    /// [default: the rig file's; where that is embedded, a rig that is kept comes first]
    #[arg(long, value_name = "LINK", value_parser = values::link)]
    pub link: Option<LinkChoice>,
    /// Rig file (TOML) [default: that of the rig's service, else the built-in example rig]
    #[arg(long, value_name = "FILE", value_parser = values::rig_file)]
    pub rig: Option<PathBuf>,
    /// Open the port in this process instead of through a service; others can't watch or stop then
    #[arg(long)]
    pub direct: bool,
    /// The client of the service, from `load` to `open`.
    #[cfg(unix)]
    #[arg(skip)]
    client: RefCell<Option<Client>>,
    /// The service, for a command that opens its connection several times.
    #[cfg(unix)]
    #[arg(skip)]
    service: RefCell<Option<(String, Option<LinkChoice>)>>,
    /// Process of the service and the stops of others that it had seen, when it was reached first.
    #[cfg(unix)]
    #[arg(skip)]
    stops: Cell<Option<(u32, u64)>>,
    /// A connection that keeps the service, and its count of stops, while nothing is driven.
    #[cfg(unix)]
    #[arg(skip)]
    kept: RefCell<Option<Client>>,
    /// Where zeros come from, once the connection is open.
    #[arg(skip)]
    zeroing: RefCell<Zeroing>,
    /// The rig as its file has it, from `load` on.
    #[arg(skip)]
    of_file: RefCell<Option<Rig>>,
    /// How the rig is reached, from `load` on: once for a command, whatever starts or ends
    /// meanwhile.
    #[arg(skip)]
    target: RefCell<Option<Target>>,
    /// Number of the board that the rig was tested with, after `require_unchanged`.
    #[arg(skip)]
    tested: RefCell<Option<Option<String>>>,
}

/// An emulated rig of the command's own.
#[derive(Debug, Args, Default)]
#[command(next_help_heading = EMBEDDED)]
pub struct New {
    /// Seed of all random values in the embedded rig
    #[arg(long, value_name = "N", value_parser = values::seed)]
    pub seed: Option<u64>,
    /// Physics of the embedded rig (TOML) [default: the rig of the thesis]
    #[arg(long, value_name = "FILE")]
    pub plant: Option<PathBuf>,
    /// Limit the embedded rig to real time
    #[arg(long)]
    pub paced: bool,
    /// Reach the embedded rig by its USB port instead of its serial line
    #[arg(long)]
    pub usb: bool,
}

/// Which rig, and how it is reached.
#[derive(Debug, Args)]
pub struct Connection {
    #[command(flatten)]
    at: Existing,
    #[command(flatten)]
    new: New,
}

/// How a command reaches its rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Target {
    /// An embedded rig that lives as long as the command.
    Own,
    /// A port that this process opens.
    Direct(LinkChoice),
    /// The service of a rig, and the port for which it is started where it does not run.
    Service(String, Option<LinkChoice>),
}

/// What a command may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Command the rig. Refused where a part of it was exchanged since its bring-up.
    Commander,
    /// Test it, whatever was exchanged: `bring-up`.
    Tester,
    /// End what it does or clear its faults, whatever was exchanged.
    Ender,
    /// Watch it.
    Observer,
}

impl New {
    fn any(&self) -> bool {
        self.seed.is_some() || self.plant.is_some() || self.paced || self.usb
    }
}

impl Existing {
    /// Loads the rig file: that of `--rig`, of the rig's service, or the built-in one. Refuses
    /// options of the embedded rig where the link leads elsewhere.
    fn load_with(&self, new: &New, embedded: &[(&str, bool)], context: &Context) -> Result<Rig> {
        let given = match &self.rig {
            Some(path) => Rig::load(path),
            None => Rig::built_in(),
        }?;
        self.only_embedded(
            &given,
            &[
                ("--seed", new.seed.is_some()),
                ("--plant", new.plant.is_some()),
                ("--paced", new.paced),
                ("--usb", new.usb),
            ],
        )?;
        self.only_embedded(&given, embedded)?;
        if self.direct && !is_port(self.choice(&given)) {
            return Err(Failure::usage(format!(
                "--direct opens a board's port in this process, and the link is {}{}; omit --direct, or name the port with --link usb or \
                 --link serial:PORT; nothing was done",
                self.choice(&given),
                if self.link.is_some() { "" } else { " (from the rig file)" }
            )));
        }
        check_plant(new.plant.as_deref())?;
        let target = self.target(new, &given)?;
        let (rig, name) = self.rig_of(&target, given, context)?;
        *self.of_file.borrow_mut() = Some(rig.clone());
        context.output.detail(&format!(
            "rig file: {name}, rig `{}`, hash {}",
            rig.name,
            rig.hash()
        ));
        Ok(rig)
    }

    /// The rig file to use with a target. Connects to the service, where the target has one.
    #[cfg(unix)]
    fn rig_of(&self, target: &Target, given: Rig, context: &Context) -> Result<(Rig, String)> {
        let name = self
            .rig
            .as_ref()
            .map_or_else(|| "built in".into(), |path| path.display().to_string());
        let Target::Service(service, start) = target else {
            return Ok((given, name));
        };
        let client = super::serve::connect(service, start.as_ref(), self.rig.as_deref(), context)?;
        let welcome = client.welcome();
        // Chosen among those that are kept: its name may have become a board's meanwhile.
        let chosen = self.link.is_none() && start.is_none() && *service != default_name();
        if chosen && welcome.seed.is_none() {
            return Err(Failure::usage(format!(
                "rig `{service}` is a board ({}), and no link is named; nothing was done; --link rig:{service} names it",
                welcome.link
            )));
        }
        let used = if self.rig.is_some() {
            (given, name)
        } else {
            let rig = Rig::parse(&welcome.rig_file, &welcome.rig_text)?;
            (rig, format!("{} (of the service)", welcome.rig_file))
        };
        self.stops.set(Some((welcome.pid, welcome.stops)));
        *self.client.borrow_mut() = Some(client);
        *self.service.borrow_mut() = Some((service.clone(), start.clone()));
        Ok(used)
    }

    #[cfg(not(unix))]
    fn rig_of(&self, _: &Target, given: Rig, _: &Context) -> Result<(Rig, String)> {
        Ok((given, "given or built in".to_owned()))
    }

    /// Refuses to drive a real rig with the geometry and limits of the built-in example. A rig file
    /// that `--rig` names is the user's own, whatever it says.
    pub fn require_rig_file(&self, rig: &Rig) -> Result<()> {
        let port = self.choice(rig);
        let real = match port {
            LinkChoice::Usb | LinkChoice::Serial(_) => true,
            LinkChoice::Kept(_) => self.serves_a_board(),
            LinkChoice::Embedded | LinkChoice::Fast => false,
        };
        if !real {
            return Ok(());
        }
        let example = Rig::built_in().is_ok_and(|example| example.hash() == rig.hash());
        if self.rig.is_some() || !example {
            return Ok(());
        }
        Err(Failure::usage(format!(
                "the link {port} leads to a real rig, and without --rig its geometry and limits would be those of the \
                 built-in example; give its own file with --rig FILE (`forcectl init` makes one); nothing was driven"
            ),
        ))
    }

    /// Whether the service that was found leads to a board.
    #[cfg(unix)]
    fn serves_a_board(&self) -> bool {
        let client = self.client.borrow();
        client
            .as_ref()
            .is_some_and(|client| client.welcome().seed.is_none())
    }

    #[cfg(not(unix))]
    fn serves_a_board(&self) -> bool {
        false
    }

    /// `tested::require` with this connection's board: a service tells its number now, any other
    /// link when it is opened. Call it after [`Existing::load`]. A link that commands is opened
    /// with it in any case; a command that asks or shows something before calls it itself.
    pub fn require_unchanged(&self, context: &Context) -> Result<()> {
        self.require_with(&New::default(), context)
    }

    fn require_with(&self, new: &New, context: &Context) -> Result<()> {
        let (of_file, passed) = (self.of_file.borrow(), self.tested.borrow().is_some());
        if let Some(rig) = of_file.as_ref().filter(|_| !passed) {
            let board = tested::require(rig, self.seed(new, rig), self.board(), context)?;
            *self.tested.borrow_mut() = Some(board);
        }
        Ok(())
    }

    /// Number of the board behind the service, where there is one and it has told it.
    #[cfg(unix)]
    fn board(&self) -> Option<String> {
        let client = self.client.borrow();
        let number = client.as_ref()?.welcome().board.as_ref()?.number()?;
        Some(number.as_str().to_owned())
    }

    #[cfg(not(unix))]
    fn board(&self) -> Option<String> {
        None
    }

    /// The link, which has to lead to the board that was tested.
    fn to_tested_board(&self, link: Box<dyn RigLink>) -> Box<dyn RigLink> {
        match self.tested.borrow().clone().flatten() {
            Some(number) => Box::new(OfBoard::new(link, number)),
            None => link,
        }
    }

    /// The link: that of `--link`, else that of the rig file.
    fn choice<'a>(&'a self, rig: &'a Rig) -> &'a LinkChoice {
        self.link.as_ref().unwrap_or(&rig.link)
    }

    /// Seed of the emulated rig that this leads to; `None` for a board.
    fn seed(&self, new: &New, rig: &Rig) -> Option<u64> {
        match self.target(new, rig).ok()? {
            Target::Own => Some(new.seed.unwrap_or(DEFAULT_SEED)),
            Target::Direct(_) => None,
            #[cfg(unix)]
            Target::Service(..) => {
                let client = self.client.borrow();
                client.as_ref().and_then(|client| client.welcome().seed)
            }
            #[cfg(not(unix))]
            Target::Service(..) => None,
        }
    }

    /// How the rig is reached. Without `--link`, an embedded rig that is kept comes before one of
    /// the command's own; options of a new rig ask for a new one. Refuses to choose among several.
    fn target(&self, new: &New, rig: &Rig) -> Result<Target> {
        if let Some(target) = self.target.borrow().as_ref() {
            return Ok(target.clone());
        }
        let target = match self.choice(rig) {
            LinkChoice::Fast => Target::Own,
            LinkChoice::Embedded if self.link.is_some() || new.any() => Target::Own,
            LinkChoice::Embedded => match the_kept(kept())? {
                Some(name) => Target::Service(name, None),
                None => Target::Own,
            },
            LinkChoice::Kept(name) => Target::Service(name.clone(), None),
            port if self.direct || cfg!(not(unix)) => Target::Direct(port.clone()),
            port => Target::Service(name_of(port), Some(port.clone())),
        };
        *self.target.borrow_mut() = Some(target.clone());
        Ok(target)
    }

    /// Refuses options that only an embedded rig of the command's own has, where the link leads
    /// elsewhere.
    fn only_embedded(&self, rig: &Rig, options: &[(&str, bool)]) -> Result<()> {
        let choice = self.choice(rig);
        let fixed = matches!(choice, LinkChoice::Embedded | LinkChoice::Fast);
        if fixed {
            return Ok(());
        }
        // A rig that is kept is emulated, but was started with its own seed and physics.
        let kept = matches!(choice, LinkChoice::Kept(_));
        let at_start = ["--seed", "--plant", "--paced", "--usb"];
        let wrong = options
            .iter()
            .find(|(name, given)| *given && (!kept || at_start.contains(name)));
        match wrong {
            Some((name, _)) if kept => Err(Failure::usage(format!("{name} belongs to the start of a rig: `forcectl rig {name} ...`; the link is {choice}"),
            )),
            Some((name, _)) => Err(Failure::usage(format!(
                    "{name} works with the embedded rig only, and the link is {choice}{}; omit {name} or use --link embedded",
                    if self.link.is_some() { "" } else { " (from the rig file)" }
                ),
            )),
            None => Ok(()),
        }
    }

    /// Opens the connection, and names the rig.
    fn open_as(
        &self,
        new: &New,
        role: Role,
        rig: &Rig,
        context: &Context,
    ) -> Result<Box<dyn RigLink>> {
        self.open_run(new, role, rig, 0, context)
    }

    /// The same for a command that opens it several times: `run` counts from 0. An emulated rig of
    /// the command's own draws its noise anew for each, as a real one has it.
    fn open_run(
        &self,
        new: &New,
        role: Role,
        rig: &Rig,
        run: u64,
        context: &Context,
    ) -> Result<Box<dyn RigLink>> {
        if role == Role::Commander {
            self.require_with(new, context)?;
        }
        #[cfg(unix)]
        if let Some(client) = self.connected(context)? {
            let welcome = client.welcome();
            context.output.note(&format!(
                "rig `{}`: {} (service: process {})",
                welcome.name, welcome.link, welcome.pid
            ));
            if matches!(role, Role::Commander | Role::Tester) {
                if let Ok(program) = std::env::current_exe() {
                    context.output.note(&format!(
                        "`{} stop` in any terminal stops it",
                        program.display()
                    ));
                }
            }
            let store = if welcome.seed.is_some() {
                ZeroStore::none()
            } else {
                ZeroStore::of_rig(&rig.name)
            };
            *self.zeroing.borrow_mut() = Zeroing::Keep(store);
            let link = match role {
                Role::Commander | Role::Ender => ServiceLink::commander(client),
                Role::Tester => ServiceLink::tester(client),
                Role::Observer => ServiceLink::observer(client),
            };
            return Ok(self.to_tested_board(Box::new(link?)));
        }
        let choice = self.choice(rig);
        let link = link::open(
            choice,
            &EmbeddedOptions {
                seed: new.seed,
                run,
                paced: new.paced,
                plant: new.plant.clone(),
                usb: new.usb,
            },
        )?;
        if matches!(choice, LinkChoice::Embedded | LinkChoice::Fast) {
            context.output.note(&format!(
                "rig of this command only: {}; `forcectl rig` keeps one for many commands",
                link.name()
            ));
        } else {
            *self.zeroing.borrow_mut() = Zeroing::Keep(ZeroStore::of_rig(&rig.name));
            context.output.note(&format!("rig: {}", link.name()));
        }
        Ok(self.to_tested_board(link))
    }

    /// Whether this process opens a board's port. A rig file that can't be read names none.
    pub fn opens_port(&self) -> bool {
        let of_file = || Some(Rig::load(self.rig.as_ref()?).ok()?.link);
        self.direct && (self.link.clone().or_else(of_file)).is_some_and(|link| is_port(&link))
    }

    /// Whether a service is meant: that of `--link`, else any. Asks none, for one that hangs has no
    /// answer.
    #[cfg(unix)]
    pub fn means(&self, socket: &socket::Socket) -> bool {
        let Some(link) = &self.link else {
            return true;
        };
        socket.name == name_of(link) || serves(socket, link)
    }

    /// A connection to the service; `None` where the rig is reached in another way.
    #[cfg(unix)]
    fn connected(&self, context: &Context) -> Result<Option<Client>> {
        if let Some(client) = self.client.borrow_mut().take() {
            return Ok(Some(client));
        }
        let service = self.service.borrow();
        let Some((name, start)) = service.as_ref() else {
            return Ok(None);
        };
        let client = super::serve::connect(name, start.as_ref(), self.rig.as_deref(), context)?;
        self.require_not_stopped(client.welcome())?;
        Ok(Some(client))
    }

    /// Refuses to go on where somebody stopped the rig since the first connection of this command,
    /// and cleared it: between two sessions nobody of this command was there to see it.
    #[cfg(unix)]
    fn require_not_stopped(&self, now: &Welcome) -> Result<()> {
        let since = |(pid, stops)| pid == now.pid && now.stops > stops;
        let why = if self.stops.get().is_some_and(since) {
            let who = now.stopped_by.as_deref().unwrap_or("another client");
            format!("the rig was stopped by {who} since this command began")
        } else if self.kept.borrow().is_some()
            && self.stops.get().is_some_and(|(pid, _)| pid != now.pid)
        {
            "the service of the rig was ended since this command began, and whether the rig was stopped meanwhile is not known"
                .to_owned()
        } else {
            return Ok(());
        };
        let text = format!("{why}; nothing more is driven");
        Err(Failure::new(exit::BOARD, text))
    }

    /// Stays connected, for a command with several sessions: a stop between two of them is not
    /// lost with a service that ends without clients. Call it after [`Existing::load`].
    #[cfg(unix)]
    fn stay(&self, context: &Context) -> Result<()> {
        let service = self.service.borrow();
        if let Some((name, start)) = service.as_ref() {
            let client = super::serve::connect(name, start.as_ref(), self.rig.as_deref(), context)?;
            *self.kept.borrow_mut() = Some(client);
        }
        Ok(())
    }

    #[cfg(not(unix))]
    fn stay(&self, _: &Context) -> Result<()> {
        Ok(())
    }

    /// The client of the service, after [`Existing::load`]; `None` where the rig is reached in
    /// another way.
    #[cfg(unix)]
    pub fn client(&self, context: &Context) -> Option<Client> {
        let client = self.client.borrow_mut().take()?;
        let welcome = client.welcome();
        context.output.note(&format!(
            "rig `{}`: {} (service: process {})",
            welcome.name, welcome.link, welcome.pid
        ));
        Some(client)
    }

    /// Loads the rig file: that of `--rig`, of the rig's service, or the built-in one. Refuses
    /// where no rig exists.
    pub fn load(&self, context: &Context) -> Result<Rig> {
        let rig = self.load_with(&New::default(), &[], context)?;
        if self.target(&New::default(), &rig)? != Target::Own {
            return Ok(rig);
        }
        let why = if self.link.is_some() {
            "this command is for a rig that exists, and `--link embedded` or `fast` means a new one"
                .to_owned()
        } else {
            nothing_kept(&running())
        };
        #[cfg(unix)]
        let why = format!("{why} (looked for a service in {})", folders());
        Err(Failure::new(
            exit::LINK,
            format!(
                "{why}; nothing was done. `forcectl rig` starts an emulated rig that stays; --link usb or --link serial:PORT names a board"
            ),
        ))
    }

    /// Where the zeros of a run come from. Call it in a session.
    pub fn zeroing(&self) -> Zeroing {
        self.zeroing.borrow().clone()
    }

    /// Opens the connection, does the handshake and runs a command with it. Ctrl-C requests a
    /// controlled stop.
    pub fn with_session<T>(
        &self,
        role: Role,
        context: &Context,
        command: impl FnOnce(&mut Session<'_>, &Rig) -> Result<T>,
    ) -> Result<T> {
        let rig = self.load(context)?;
        self.session(&New::default(), role, &rig, context, command)
    }

    fn session<T>(
        &self,
        new: &New,
        role: Role,
        rig: &Rig,
        context: &Context,
        command: impl FnOnce(&mut Session<'_>, &Rig) -> Result<T>,
    ) -> Result<T> {
        let _controlled_stop = context.interrupt.controlled_stop();
        let mut link = self.open_as(new, role, rig, context)?;
        let mut session = Session::connect(link.as_mut())?;
        if let Some(info) = session.info() {
            context
                .output
                .detail(&format!("firmware: {} (ABI {})", info.version, info.abi));
        }
        command(&mut session, rig)
    }
}

impl Connection {
    /// That of an experiment with a robot that is not virtual: with the experiment's rig file, and
    /// an emulated rig of its own in real time.
    #[cfg(feature = "record")]
    pub fn of_experiment(
        experiment: &experiment::Experiment,
        rig: &Rig,
        link: Option<LinkChoice>,
        direct: bool,
    ) -> Self {
        let choice = link.as_ref().unwrap_or(&rig.link);
        let own = matches!(choice, LinkChoice::Embedded | LinkChoice::Fast);
        Self {
            at: Existing {
                link,
                rig: experiment.rig.clone(),
                direct,
                ..Existing::default()
            },
            new: New {
                paced: own,
                ..New::default()
            },
        }
    }

    /// As [`Existing::require_unchanged`].
    pub fn require_unchanged(&self, context: &Context) -> Result<()> {
        self.at.require_with(&self.new, context)
    }

    /// Ends this command, instead of opening the connection again, where somebody stops the rig
    /// meanwhile, whether it is cleared or not. Call it after [`Connection::load`].
    pub fn stay(&self, context: &Context) -> Result<()> {
        self.at.stay(context)
    }

    /// [`Connection::require_unchanged`] as a warning.
    pub fn warn_of_changes(&self, rig: &Rig, context: &Context) -> Result<()> {
        tested::warn(rig, self.seed(rig), self.at.board(), context)
    }

    /// As [`Existing::require_rig_file`].
    pub fn require_rig_file(&self, rig: &Rig) -> Result<()> {
        self.at.require_rig_file(rig)
    }

    /// Loads the rig file: that of `--rig`, of the rig's service, or the built-in one. Refuses
    /// options of the embedded rig where the link leads elsewhere.
    pub fn load(&self, context: &Context) -> Result<Rig> {
        self.load_for(context, &[])
    }

    /// The same for a command with more options that only the embedded rig has (name, whether it
    /// was given). They are checked before anything is opened.
    pub fn load_for(&self, context: &Context, embedded: &[(&str, bool)]) -> Result<Rig> {
        self.at.load_with(&self.new, embedded, context)
    }

    /// The client of the service, after [`Connection::load`]; `None` where the rig is reached in
    /// another way.
    #[cfg(unix)]
    pub fn client(&self, context: &Context) -> Option<Client> {
        self.at.client(context)
    }

    /// Opens the connection as a commander, and names the rig.
    pub fn open(&self, rig: &Rig, context: &Context) -> Result<Box<dyn RigLink>> {
        self.open_again(rig, 0, context)
    }

    /// Opens the connection to test the rig, whatever was exchanged, and names the rig.
    pub fn open_to_test(&self, rig: &Rig, context: &Context) -> Result<Box<dyn RigLink>> {
        self.at.open_as(&self.new, Role::Tester, rig, context)
    }

    /// The same for run `run` (from 0) of a command that opens it several times: runs of an
    /// emulated rig of its own differ as repetitions on a real one do.
    pub fn open_again(&self, rig: &Rig, run: u64, context: &Context) -> Result<Box<dyn RigLink>> {
        self.at
            .open_run(&self.new, Role::Commander, rig, run, context)
    }

    /// Where the zeros of a run come from: a rig that was just booted measures them, any other
    /// keeps its own. Call it after [`Connection::open`].
    pub fn zeroing(&self) -> Zeroing {
        self.at.zeroing()
    }

    /// Seed of the emulated rig that this leads to; `None` for a board. Call it after
    /// [`Connection::load`].
    pub fn seed(&self, rig: &Rig) -> Option<u64> {
        self.at.seed(&self.new, rig)
    }

    /// The rig with its stored calibration in place of the rig file's numbers, where there is one.
    /// Call it after [`Connection::load`].
    pub fn calibrated(&self, rig: Rig, context: &Context) -> Result<Rig> {
        let seed = self.seed(&rig);
        let rig = base::with_calibration(rig, seed)?;
        if let Some(words) = base::words(&rig) {
            context.output.note(&words);
        }
        Ok(rig)
    }

    /// Path of the rig file, where one was given.
    pub fn rig_path(&self) -> Option<&PathBuf> {
        self.at.rig.as_ref()
    }

    /// The plant's file of an emulated rig of its own, where one was given.
    pub fn plant_file(&self) -> Option<&Path> {
        self.new.plant.as_deref()
    }

    /// Files that are read: of the rig and of its plant.
    pub fn inputs(&self) -> Vec<&Path> {
        let files = [self.at.rig.as_deref(), self.new.plant.as_deref()];
        files.into_iter().flatten().collect()
    }

    /// Whether an embedded rig is limited to real time.
    pub fn paced(&self) -> bool {
        self.new.paced
    }

    /// Opens the connection, does the handshake and runs a command with it. Ctrl-C requests a
    /// controlled stop.
    pub fn with_session<T>(
        &self,
        role: Role,
        context: &Context,
        command: impl FnOnce(&mut Session<'_>, &Rig) -> Result<T>,
    ) -> Result<T> {
        let rig = self.load(context)?;
        self.at.session(&self.new, role, &rig, context, command)
    }
}

/// Whether a link is the port of a board.
const fn is_port(link: &LinkChoice) -> bool {
    matches!(link, LinkChoice::Usb | LinkChoice::Serial(_))
}

/// Whether a service has this port under another name (`usb` and `ttyACM0`).
#[cfg(unix)]
fn serves(socket: &socket::Socket, link: &LinkChoice) -> bool {
    let (LinkChoice::Serial(port), Some((_, theirs))) = (link, socket.holder()) else {
        return false;
    };
    let path = |port: &str| std::fs::canonicalize(port).unwrap_or_else(|_| port.into());
    path(theirs.trim_start_matches(socket::PORT)) == path(port)
}

/// The folders in which services are looked for, for messages.
#[cfg(unix)]
fn folders() -> String {
    let folders = socket::folders();
    let names: Vec<String> = (folders.iter())
        .map(|folder| folder.display().to_string())
        .collect();
    names.join(", ")
}

/// Names of the embedded rigs that are kept, or are being brought up to be.
#[cfg(unix)]
fn kept() -> Vec<String> {
    socket::kept()
}

#[cfg(not(unix))]
fn kept() -> Vec<String> {
    Vec::new()
}

/// Names of the rigs whose service answers.
#[cfg(unix)]
fn running() -> Vec<String> {
    socket::running()
}

#[cfg(not(unix))]
fn running() -> Vec<String> {
    Vec::new()
}

/// The one of the kept rigs that is meant where no link is named: that of the default name, else
/// the only one.
fn the_kept(names: Vec<String>) -> Result<Option<String>> {
    let default = default_name();
    if names.contains(&default) {
        return Ok(Some(default));
    }
    let [_, other, ..] = names.as_slice() else {
        return Ok(names.into_iter().next());
    };
    Err(Failure::usage(format!(
        "several rigs are kept here ({}), none of them is named `{default}`, and --link names none; nothing was done; \
         give --link rig:NAME, for example --link rig:{other}",
        names.join(", ")
    )))
}

/// Why a command that is for a rig that exists finds none without `--link`. `running`: boards.
fn nothing_kept(running: &[String]) -> String {
    match running.last() {
        None => "no rig is running here and no board is named".to_owned(),
        Some(last) => format!(
            "no emulated rig is kept here and no board is named; served here: {} (--link rig:{last})",
            running.join(", ")
        ),
    }
}

#[cfg(unix)]
fn default_name() -> String {
    service::socket::EMBEDDED_NAME.to_owned()
}

#[cfg(not(unix))]
fn default_name() -> String {
    "rig".to_owned()
}

#[cfg(unix)]
fn name_of(link: &LinkChoice) -> String {
    socket::name_of(link)
}

#[cfg(not(unix))]
fn name_of(link: &LinkChoice) -> String {
    link.to_string()
}

/// Refuses a plant that can't be read or that the physics can't take, before a rig is started.
pub fn check_plant(path: Option<&Path>) -> Result<()> {
    match path.map(plant_of) {
        Some(Err(error)) => Err(Failure::usage(format!("--plant {error}"))),
        _ => Ok(()),
    }
}

/// Whether the rig is an embedded one of the command's own.
pub fn booted_here(session: &mut Session<'_>) -> bool {
    session.link().booted_here()
}

/// Configures a freshly booted embedded rig with the rig file, so that its units have values to
/// show. A rig that was there before is left as it is.
pub fn configure_embedded(session: &mut Session<'_>, rig: &Rig) -> Result<()> {
    if booted_here(session) {
        session.stage_board(rig.controller.board_config())?;
        session.configure(&rig.units.map(|unit| unit.to_wire()))?;
        session.wait_for(
            Duration::from_secs(15),
            "bringing up the sensors",
            |status| status.state == SystemState::Ready as u8,
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(unix)]
    #[test]
    fn a_stop_between_two_sessions_of_a_command_ends_it() {
        let welcome = |pid, stops| Welcome {
            pid,
            stops,
            stopped_by: Some("forcectl stop (process 7)".to_owned()),
            ..Welcome::default()
        };
        let connection = Existing::default();
        assert!(connection.require_not_stopped(&welcome(3, 5)).is_ok());
        connection.stops.set(Some((3, 5)));
        assert!(connection.require_not_stopped(&welcome(3, 5)).is_ok());
        // The count of another service begins anew.
        assert!(connection.require_not_stopped(&welcome(4, 6)).is_ok());
        let stopped = connection.require_not_stopped(&welcome(3, 6)).unwrap_err();
        assert_eq!(stopped.code, exit::BOARD);
        assert!(stopped.message.contains("forcectl stop (process 7)"));
    }

    #[test]
    fn the_rig_that_is_kept_is_meant_and_of_several_the_default_one() {
        let of = |names: &[&str]| the_kept(names.iter().map(|&name| name.to_owned()).collect());
        let chosen = |names: &[&str]| of(names).unwrap_or_else(|_| panic!("several"));
        assert_eq!(chosen(&[]), None);
        assert_eq!(chosen(&["one"]).as_deref(), Some("one"));
        assert_eq!(chosen(&["one", "rig"]).as_deref(), Some("rig"));
        assert!(of(&["one", "two"]).is_err());
    }
}
