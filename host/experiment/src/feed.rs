//! The robot's states in a trial: from the virtual arm in the link, or from a source outside.

use robot::arm::Truth as ArmTruth;
use robot::source::{Fed, Poll, Source, SourceConfig, SourceError};
use robot::state::{Mount, Operating, OperatingState, RobotState, TipForce};
use robot::trajectory::Trajectory;
use session::link::RigLink;

/// Changes what the virtual arm publishes: what a test makes go wrong.
pub type Tamper = Box<dyn FnMut(Vec<RobotState>) -> Vec<RobotState> + Send>;

/// See the module's page.
pub enum Feed {
    /// The virtual arm of the link.
    Virtual {
        /// Passes its states through the watch.
        fed: Box<Fed>,
        /// What a test makes go wrong.
        tamper: Option<Tamper>,
    },
    /// A source outside.
    Outside(Box<dyn Source>),
}

impl std::fmt::Debug for Feed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Virtual { fed, .. } => f.debug_tuple("Virtual").field(fed).finish(),
            Self::Outside(source) => f.debug_tuple("Outside").field(&source.name()).finish(),
        }
    }
}

/// What came in a cycle.
#[derive(Debug, Default)]
pub struct Fresh {
    /// Usable states and events.
    pub poll: Poll,
    /// The virtual arm's truth at its cycles of 1 ms.
    pub truth: Vec<ArmTruth>,
}

impl Feed {
    /// Opens what `[robot]` names; the virtual arm begins to follow `trajectory`.
    ///
    /// # Errors
    /// [`SourceError`]; also where the link has no virtual arm.
    pub fn open(
        config: &SourceConfig,
        link: &mut dyn RigLink,
        trajectory: Option<&Trajectory>,
        tamper: Option<Tamper>,
    ) -> Result<Self, SourceError> {
        let SourceConfig::Virtual(config) = config else {
            return Ok(Self::Outside(robot_ros::open(config)?));
        };
        let Some(arm) = link.controls().and_then(|controls| controls.arm()) else {
            return Err(SourceError::Config {
                key: "kind",
                why: "the virtual arm exists in the fast rig only; use `--link fast`, or another kind".to_owned(),
            });
        };
        if let Some(trajectory) = trajectory {
            arm.follow(trajectory.clone());
        }
        arm.keep_messages(true);
        let mount: Mount = config.arm.mount;
        Ok(Self::Virtual {
            fed: Box::new(Fed::mounted("virtual arm", config.watch.clone(), mount)),
            tamper,
        })
    }

    /// What came by `now_ns` of the link's time.
    ///
    /// # Errors
    /// The source is gone.
    pub fn poll(&mut self, link: &mut dyn RigLink, now_ns: u64) -> Result<Fresh, SourceError> {
        let now_ns = i64::try_from(now_ns).unwrap_or(i64::MAX);
        match self {
            Self::Outside(source) => Ok(Fresh {
                poll: source.poll(now_ns)?,
                truth: Vec::new(),
            }),
            Self::Virtual { fed, tamper } => {
                let mut truth = Vec::new();
                if let Some(arm) = link.controls().and_then(|controls| controls.arm()) {
                    let messages = arm.take_messages();
                    let mut states: Vec<_> = messages.iter().map(|m| arm.state_of(m)).collect();
                    truth = arm.take_truths();
                    if let Some(tamper) = tamper {
                        states = tamper(states);
                    }
                    fed.feed(states);
                }
                Ok(Fresh {
                    poll: fed.poll(now_ns)?,
                    truth,
                })
            }
        }
    }

    /// Tells the robot's side the applied force and the one that is aimed at.
    ///
    /// # Errors
    /// The source is gone.
    pub fn publish(&mut self, applied: &TipForce, setpoint: &TipForce) -> Result<(), SourceError> {
        match self {
            Self::Virtual { .. } => Ok(()),
            Self::Outside(source) => source.publish(applied, setpoint),
        }
    }

    /// Tells the robot's side in which state the rig is.
    ///
    /// # Errors
    /// The source is gone.
    pub fn publish_operating(&mut self, state: Operating) -> Result<(), SourceError> {
        match self {
            Self::Virtual { .. } => Ok(()),
            Self::Outside(source) => source.publish_operating(OperatingState {
                state,
                is_homed: true,
                is_busy: state == Operating::Enabled,
            }),
        }
    }

    /// Name in messages.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Virtual { fed, .. } => fed.name(),
            Self::Outside(source) => source.name(),
        }
    }
}
