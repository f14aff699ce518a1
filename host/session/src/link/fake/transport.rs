//! The board as a link: bytes in and out with the errors of its behaviour, and the controls of an
//! emulated rig.

use super::{Behavior, FakeBoard, MS};
use crate::link::{Exchange, LinkError, RigControls, RigLink};
use control::{Fault, SystemState};
use emulator_link::{Injection, Pose, Report};
use std::time::Duration;
use wire::UNITS;

impl RigLink for FakeBoard {
    fn name(&self) -> String {
        "fake board".to_owned()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        let end = self.now_ns + duration.as_nanos() as u64;
        let muted = |this: &Self| match this.behavior {
            Behavior::Silent => true,
            Behavior::MuteAt(at) => this.now_ns >= at,
            _ => false,
        };
        if let Behavior::BreaksAt(at) = self.behavior {
            if end >= at {
                self.now_ns = self.now_ns.max(at);
                return Err(LinkError::Lost {
                    name: "fake board".to_owned(),
                    cause: "unplugged".to_owned(),
                });
            }
        }
        if !muted(self) {
            self.receive(to_board);
        }
        let mut truth = Vec::new();
        while self.now_ns < end {
            let next_ms = (self.now_ns / MS + 1) * MS;
            let unit = (0..UNITS)
                .filter(|i| !self.unplugged[*i])
                .min_by_key(|i| self.next_sample_ns[*i]);
            let sample_at = unit.map_or(u64::MAX, |i| self.next_sample_ns[i]);
            self.now_ns = next_ms.min(sample_at).min(end).max(self.now_ns);
            self.plant.advance_to(self.now_ns);
            if let Some(i) = unit.filter(|_| sample_at <= self.now_ns) {
                // The converters' own clocks: 310 to 330 SPS.
                self.next_sample_ns[i] = self.now_ns + 3_125_000 - 20_000 * i as u64 + 50_000;
                self.sample(i);
            }
            if self.now_ns == next_ms {
                self.tick();
                truth.push(self.truth());
            }
        }
        let mut from_board = std::mem::take(&mut self.out);
        match self.behavior {
            Behavior::Garbage => {
                from_board = (0..duration.as_micros() / 5)
                    .map(|n| (n as u8).wrapping_mul(37) ^ (n >> 3) as u8)
                    .collect();
            }
            Behavior::Noisy(n) => {
                for byte in &mut from_board {
                    self.random = self
                        .random
                        .wrapping_mul(6_364_136_223_846_793_005)
                        .wrapping_add(99);
                    if ((self.random >> 33) as u32).is_multiple_of(n) {
                        *byte ^= 0x55;
                    }
                }
            }
            _ if muted(self) => from_board.clear(),
            _ => {}
        }
        let tells_pose = match self.behavior {
            Behavior::NoPose => false,
            Behavior::PoseUntil(until_ns) => self.now_ns < until_ns,
            _ => true,
        };
        Ok(Exchange {
            now_ns: self.now_ns,
            from_board,
            pose: tells_pose.then(|| Pose {
                position_m: self.plant.tip_position_m(),
                velocity_m_s: self.plant.tip_velocity_m_per_s(),
            }),
            truth,
            resets: self.resets,
        })
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        Some(self)
    }
}

impl RigControls for FakeBoard {
    fn robot(&mut self, moving: bool) -> Result<(), LinkError> {
        self.plant.set_robot_moving(moving);
        Ok(())
    }

    fn inject(&mut self, injection: Injection) -> Result<(), LinkError> {
        match injection {
            Injection::UnplugSensor(unit @ 1..=6) => {
                let i = usize::from(unit) - 1;
                self.unplugged[i] = true;
                self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
                if self.system != SystemState::BringUp {
                    self.latch(Some(i), Fault::SensorSilent, 12_500);
                }
                Ok(())
            }
            Injection::PullCable(unit @ 1..=6, weight_n) => {
                self.weight_n[usize::from(unit) - 1] = weight_n;
                Ok(())
            }
            Injection::EStop(true) => {
                for i in 0..UNITS {
                    self.plant.set_amplifier_volts(i, 0.0).expect("a unit");
                }
                self.latch(None, Fault::EStop, 0);
                Ok(())
            }
            other => Err(LinkError::Refused(format!("{other:?}"))),
        }
    }

    fn report(&mut self) -> Result<Report, LinkError> {
        Ok(Report {
            now_ns: self.now_ns,
            ..Report::default()
        })
    }

    fn seed(&self) -> u64 {
        1
    }
}
