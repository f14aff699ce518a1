//! Robots on ROS 1 and ROS 2 as sources of robot states; [`open`] opens the source that a
//! configuration names.
//!
//! | feature | module | client |
//! | --- | --- | --- |
//! | `ros1` | `ros1` | roslibrust |
//! | `ros2` | `ros2` | ros2-client on RustDDS |
//!
//! `geometry.rs` and `intake.rs` are what both have in common. docs/robot.md has the topics.

#![forbid(unsafe_code)]

#[cfg(any(feature = "ros1", feature = "ros2"))]
mod geometry;
#[cfg(any(feature = "ros1", feature = "ros2"))]
mod intake;
#[cfg(feature = "ros1")]
pub mod ros1;
#[cfg(feature = "ros2")]
pub mod ros2;

use robot::source::{Fed, Fixed, Ros1Config, Ros2Config, Source, SourceConfig, SourceError, Udp};

/// Opens what `[robot]` names.
///
/// # Errors
/// [`SourceError`] with the key or what to do.
pub fn open(config: &SourceConfig) -> Result<Box<dyn Source>, SourceError> {
    match config {
        SourceConfig::Virtual(c) => Ok(Box::new(Fed::new("virtual arm", c.watch.clone()))),
        SourceConfig::Udp(c) => Ok(Box::new(Udp::listen(c)?)),
        SourceConfig::Static(c) => Ok(Box::new(Fixed::new(c)?)),
        SourceConfig::CrtkRos1(c) => open_ros1(c),
        SourceConfig::CrtkRos2(c) => open_ros2(c),
    }
}

#[cfg(feature = "ros2")]
fn open_ros2(config: &Ros2Config) -> Result<Box<dyn Source>, SourceError> {
    Ok(Box::new(ros2::Ros2::open(config)?))
}

#[cfg(not(feature = "ros2"))]
fn open_ros2(_: &Ros2Config) -> Result<Box<dyn Source>, SourceError> {
    Err(SourceError::NotBuilt {
        kind: "crtk-ros2",
        how: "build with `--features ros2`",
    })
}

#[cfg(feature = "ros1")]
fn open_ros1(config: &Ros1Config) -> Result<Box<dyn Source>, SourceError> {
    Ok(Box::new(ros1::Ros1::open(config)?))
}

#[cfg(not(feature = "ros1"))]
fn open_ros1(_: &Ros1Config) -> Result<Box<dyn Source>, SourceError> {
    Err(SourceError::NotBuilt {
        kind: "crtk-ros1",
        how: "build with `--features ros1`",
    })
}
