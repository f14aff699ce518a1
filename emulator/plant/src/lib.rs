//! The physics of the force rig, once: amplifier, motor, gear, friction, reel, cable, load cell and
//! robot tip, for up to sixteen force units, in plain `f64`.
//!
//! The plant knows nothing of the firmware or of any controller. It is driven by what the boards
//! outside drive (an amplifier voltage per unit, the E-stop relay, "robot moves") and answers with
//! what the boards outside sense (bridge output in V/V, quadrature counts), plus the [`Truth`] that
//! no sensor shows.
//!
//! ```
//! use plant::{Plant, PlantConfig};
//!
//! let mut plant = Plant::new(PlantConfig::default(), 1).unwrap();
//! plant.set_amplifier_power(true);
//! plant.set_amplifier_volts(0, 0.43).unwrap(); // 0.258 A, about 5 N at the reel
//! plant.advance_to(200_000_000); // 0.2 s
//! assert!(plant.tension_n(0) > 3.0);
//! ```
//!
//! # One force unit
//!
//! All mechanics is written at the cable: force in N, positions in m of cable wound, mass as
//! reflected to the reel's rim. `u` is the motor's pull without any loss, `u = i K_t N / r`.
//!
//! ```text
//! amplifier   di/dt = w_c (g V - i)          g V and i limited, back-EMF headroom of the 48 V supply
//! drive       m x'' = gain u + offset - F_friction - c x' - T + (effects)
//! friction    level = (coulomb + per_load |u|) (1 + (breakaway - 1) / (1 + (v/v_s)^2)^2)
//! cable       T     = max(0, EA e + d EA e' ),  0 while slack, e = stretch / free length
//! flexure     M q'' = T cos(theta) + M g.n - k q - d q'
//! bridge      out   = zero + sensitivity (1 + error) k q / (capacity 9.80665)
//! ```
//!
//! Sliding slowly this gives `T = offset + gain u - sign(v) (coulomb + per_load u)`, the form
//! measured on the real rig (`F = 0.155 + 1.018 T - sign(v) (0.909 + 0.154 T)` in N); at rest the
//! reel holds any tension inside the band.
//!
//! # Time
//!
//! Virtual time is in ns. The state lives on a fixed grid ([`PlantConfig::step_ns`]) and moves by
//! semi-implicit Euler steps, so results are bit-identical however the calls of
//! [`Plant::advance_to`] are sliced. Getters show the last grid point at or before the time
//! reached. An input takes effect at the first grid point at or after the time at which it was set.
//!
//! # Randomness
//!
//! All that differs from rig to rig (friction, gain errors, survey errors, the robot's path) is
//! drawn from the seed in [`Plant::new`], each from a stream of its own ([`rng`]). Nothing is
//! random later.

pub mod config;
pub mod effects;
pub mod error;
pub mod friction;
pub mod geometry;
mod plant;
pub mod rng;
mod tip;
mod unit;
pub mod vector;

pub use config::PlantConfig;
pub use effects::Effect;
pub use error::{ConfigError, InputError};
pub use geometry::{nominal_geometry, NominalUnit};
pub use plant::{Plant, Truth, UnitTruth};
pub use tip::TipModel;
pub use unit::UnitParameters;
pub use vector::Vec3;
