//! The fast rig: the firmware's machine and control core in this process, with the same chips and
//! plant as the embedded rig (`core_sim`). No image, no emulated controller, no second process.

use super::{EmbeddedOptions, Exchange, LinkError, RigControls, RigLink};
use core_sim::{CoreRig, Options};
use emulator_link::{Injection, Report};
use plant::PlantConfig;
use robot::arm::VirtualArm;
use std::path::Path;
use std::time::{Duration, Instant};

/// Seed where none is given: the embedded rig's.
const DEFAULT_SEED: u64 = 1;

/// Reads the configuration of a plant (TOML), for either emulated rig.
///
/// # Errors
/// [`LinkError::Setup`] with the file where it can't be read or holds what the physics can't take.
pub fn plant_of(path: &Path) -> Result<PlantConfig, LinkError> {
    let setup =
        |error: &dyn std::fmt::Display| LinkError::Setup(format!("{}: {error}", path.display()));
    let text = files::read_text(path).map_err(|error| setup(&error))?;
    let plant: PlantConfig = toml::from_str(&text).map_err(|error| setup(&error))?;
    plant.validate().map_err(|error| setup(&error))?;
    Ok(plant)
}

/// A rig in this process.
#[derive(Debug)]
pub struct FastRig {
    rig: CoreRig,
    /// Start of a run that is not to be faster than real time.
    paced: Option<Instant>,
}

impl FastRig {
    /// A rig at power-on.
    ///
    /// # Errors
    /// [`LinkError::Setup`] where the plant's file can't be read or holds what the physics can't
    /// take.
    pub fn open(options: &EmbeddedOptions) -> Result<Self, LinkError> {
        if options.usb {
            return Err(LinkError::Setup(
                "the rig without the emulated controller has no USB core: omit --usb, or use --link embedded".to_owned(),
            ));
        }
        let plant = (options.plant.as_deref()).map_or(Ok(PlantConfig::default()), plant_of)?;
        let seed = options.seed.unwrap_or(DEFAULT_SEED);
        let rig = Self::with(Options {
            seed,
            run: options.run,
            plant,
            ..Options::default()
        })?;
        Ok(Self {
            paced: options.paced.then(Instant::now),
            ..rig
        })
    }

    /// A rig in this process with these options; what an experiment uses, with a virtual arm at the
    /// cables' ends.
    ///
    /// # Errors
    /// [`LinkError::Setup`] where plant or arm can't be.
    pub fn with(options: Options) -> Result<Self, LinkError> {
        let rig = CoreRig::new(options).map_err(|error| LinkError::Setup(error.to_string()))?;
        Ok(Self { rig, paced: None })
    }

    /// The virtual arm that holds the cables' ends, where there is one.
    pub fn arm_mut(&mut self) -> Option<&mut VirtualArm> {
        self.rig.arm_mut()
    }
}

impl RigLink for FastRig {
    fn name(&self) -> String {
        format!(
            "fast rig without emulated controller, seed {}",
            self.rig.seed()
        )
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let duration_ns = u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX);
        let advanced = self.rig.advance(duration_ns, to_board);
        if let Some(began) = self.paced {
            let ahead = Duration::from_nanos(advanced.now_ns).saturating_sub(began.elapsed());
            std::thread::sleep(ahead);
        }
        Ok(advanced.into())
    }

    fn booted_here(&self) -> bool {
        true
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for FastRig {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.rig.set_robot_moving(moving);
        Ok(())
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        self.rig
            .inject(injection)
            .map_err(|error| LinkError::Refused(error.to_string()))
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        Ok(self.rig.report())
    }

    fn seed(&self) -> u64 {
        self.rig.seed()
    }

    fn drive_outside(&mut self, volts: Option<[f64; wire::UNITS]>) -> Result<(), LinkError> {
        self.rig.drive_outside(volts);
        Ok(())
    }

    fn arm(&mut self) -> Option<&mut VirtualArm> {
        self.rig.arm_mut()
    }
}
