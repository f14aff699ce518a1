//! The test of the amplifiers' power: a pulse moves nothing while the alive line is unplugged.
//!
//! The board does not know that its line is unplugged: it arms and pulses as ever, and only the PLC
//! keeps the motors still. A pulse with an open E-stop would need a firmware that drives with an
//! open E-stop; there is none (docs/safety.md). That the PLC sees the E-stop is what a person tells
//! by the lamps.

use super::{Bench, SETTLE};
use crate::figures::{Figures, PowerFigures};
use crate::hands::{Action, Answer};
use crate::{pulse, BringUpError};

impl Bench<'_, '_> {
    pub(super) fn power(&mut self, figures: &mut Figures) -> Result<(), BringUpError> {
        self.clear()?;
        self.settled(SETTLE)?;
        let lit_ready = self.look()?;
        // The plug is handled while the E-stop is pressed.
        if self.act(Action::PressEStop)? == Answer::Skip {
            return Ok(());
        }
        let lit_pressed = self.look()?;
        if self.act(Action::UnplugAlive)? == Answer::Skip {
            return self.release();
        }
        self.release()?;
        let lit_unplugged = self.look()?;
        let power = figures.power.insert(PowerFigures {
            lit_ready,
            lit_pressed,
            lit_unplugged,
            unplugged: Default::default(),
        });
        let pulsed = match self.act(Action::StandBack)? {
            Answer::Skip => Ok(()),
            _ => self.pulses(pulse::BLIND_N, &mut power.unplugged),
        };
        // Also after pulses that failed: the line does not stay unplugged without a word. Not
        // with the E-stop released: the amplifiers would get their power with a hand at the plug.
        while self.act(Action::PressEStop)? == Answer::Skip {}
        self.act(Action::PlugAlive)?;
        self.release()?;
        pulsed
    }

    /// Releases the E-stop, and waits until the board has given the power.
    fn release(&mut self) -> Result<(), BringUpError> {
        self.act(Action::ReleaseEStop)?;
        self.clear()?;
        self.settled(SETTLE)?;
        Ok(())
    }

    fn look(&mut self) -> Result<Option<bool>, BringUpError> {
        Ok(match self.act(Action::LookAtPower)? {
            Answer::Done => Some(true),
            Answer::No => Some(false),
            Answer::Skip => None,
        })
    }
}
