//! What is opened, and what a build without ROS says.

#[cfg(not(any(feature = "ros1", feature = "ros2")))]
use robot::source::{Ros1Config, Ros2Config, SourceError};
use robot::source::{SourceConfig, StaticConfig};
use robot_ros::open;

#[cfg(not(any(feature = "ros1", feature = "ros2")))]
#[test]
fn what_is_not_built_in_says_how() {
    for (config, how) in [
        (
            SourceConfig::CrtkRos1(Ros1Config::default()),
            "--features ros1",
        ),
        (
            SourceConfig::CrtkRos2(Ros2Config::default()),
            "--features ros2",
        ),
    ] {
        let error = open(&config).err().unwrap();
        assert!(matches!(error, SourceError::NotBuilt { .. }), "{error}");
        assert!(error.to_string().contains(how), "{error}");
    }
}

#[test]
fn a_source_that_cant_be_opened_says_why() {
    let nowhere = SourceConfig::Static(StaticConfig {
        position_m: [0.0, f64::NAN, 0.0],
    });
    let error = open(&nowhere).err().unwrap();
    assert!(error.to_string().contains("position_m"), "{error}");
}
