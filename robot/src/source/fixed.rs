//! A clamped tip: one state a poll, always the same place.

use super::{Poll, Source, SourceError, StaticConfig};
use crate::state::{Clock, Frame, RobotState, Stamp, TipState};

/// See the module's page.
#[derive(Debug, Clone)]
pub struct Fixed {
    position_m: [f64; 3],
    sequence: u64,
}

impl Fixed {
    /// A tip at the configured place.
    ///
    /// # Errors
    /// [`SourceError::Config`] where it is none.
    pub fn new(config: &StaticConfig) -> Result<Self, SourceError> {
        if config.position_m.iter().all(|v| v.is_finite()) {
            Ok(Self {
                position_m: config.position_m,
                sequence: 0,
            })
        } else {
            Err(SourceError::Config {
                key: "position_m",
                why: format!("{:?} is not a position in m", config.position_m),
            })
        }
    }
}

impl Source for Fixed {
    fn name(&self) -> String {
        "clamped tip".to_owned()
    }

    fn poll(&mut self, now_ns: i64) -> Result<Poll, SourceError> {
        self.sequence += 1;
        Ok(Poll {
            states: vec![RobotState {
                publisher: "static".into(),
                sequence: Some(self.sequence),
                stamp: Stamp {
                    clock: Clock::HostMonotonic,
                    t_ns: now_ns,
                },
                received: None,
                joints: None,
                tip: Some(TipState {
                    frame: Frame::Rig,
                    frame_id: "".into(),
                    stamp_ns: None,
                    position_m: self.position_m,
                    orientation_xyzw: None,
                    velocity_m_per_s: Some([0.0; 3]),
                    angular_velocity_rad_per_s: None,
                }),
                force: None,
                operating: None,
            }],
            ..Poll::default()
        })
    }
}
