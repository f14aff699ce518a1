//! How far the host's word on a reel's speed is believed.
//!
//! The host knows how the robot moves, and so how fast each reel has to wind in or pay out. The
//! board can see that from the encoder only afterwards: at a reversal the reel first has to be
//! pulled through its presliding distance. The host's speed therefore moves the direction estimate
//! of a reel that rests ([`crate::friction::DirectionEstimator`]). It is a prior: a reel that moves
//! has its travel, and a speed that does not agree with the travel is not used at all.

use crate::friction::ReelSpeed;
use crate::limits::clamp_abs;

/// Largest distance between expected and measured travel, in nanometres: 0.5 mm. The cable's
/// stretch is part of it: a step of the setpoint by 5 N makes 0.2 mm of it with the nominal cable
/// (24 N/mm).
pub const DOUBT_NM: i32 = 500_000;

/// Share of that distance that is forgotten in a sample: 1/128, a time constant of 0.4 s. So an
/// expected speed may be off by 1.25 mm/s for long, ten times the error of an estimate from poses
/// with 10 um of noise.
const FORGET_SHIFT: u32 = 7;

/// Samples for which the host is not believed after that, 0.8 s: two time constants. They begin
/// anew as long as the distance is more than half of [`DOUBT_NM`], so that a speed at the limit is
/// not believed and doubted in turn.
const DOUBT_SAMPLES: u8 = 255;

/// What has become of the speeds that the host expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Preview {
    /// Expected less measured travel, in nanometres times 256.
    lead_q8: i32,
    /// Samples for which the host is still not believed.
    doubt: u8,
}

impl Preview {
    /// Takes the speed that the host expects, and the travel of a sample that spans
    /// 2^`periods_shift` nominal periods. The travel to be expected in this sample in nanometres,
    /// times 256, where it is believed.
    pub fn step(
        &mut self,
        expected: Option<ReelSpeed>,
        travel_nm: i32,
        periods_shift: u32,
    ) -> Option<i32> {
        self.doubt = self.doubt.saturating_sub(1);
        match expected {
            Some(speed) => self.believe(speed, travel_nm, periods_shift),
            None => {
                // What was wrong stays wrong for a while: a host that speaks now and then is
                // doubted too.
                self.lead_q8 -= self.lead_q8 >> FORGET_SHIFT;
                None
            }
        }
    }

    /// Apart from [`Self::step`], so that a sample without a speed does not pay for it.
    #[inline(never)]
    fn believe(&mut self, speed: ReelSpeed, travel_nm: i32, periods_shift: u32) -> Option<i32> {
        // What saturates here is past every limit below.
        let expected_q8 = speed.nm_q8().saturating_mul(1 << periods_shift);
        let lead = self.lead_q8.saturating_add(expected_q8);
        let lead = lead.saturating_sub(travel_nm.saturating_mul(256));
        let lead = clamp_abs(lead, DOUBT_NM << 10);
        self.lead_q8 = lead - (lead >> FORGET_SHIFT);
        let most = if self.doubt == 0 {
            DOUBT_NM << 8
        } else {
            DOUBT_NM << 7
        };
        if self.lead_q8.abs() > most {
            self.doubt = DOUBT_SAMPLES;
        }
        (self.doubt == 0).then_some(expected_q8)
    }
}
