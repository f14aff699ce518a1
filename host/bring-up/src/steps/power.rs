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

/// How often a person is asked to press the E-stop whose loop stays closed.
const ATTEMPTS: usize = 3;

impl Bench<'_, '_> {
    pub(super) fn power(&mut self, figures: &mut Figures) -> Result<(), BringUpError> {
        // A record has forgotten what is measured anew (`Record::forget`).
        let power = figures.power.get_or_insert_with(PowerFigures::default);
        self.clear()?;
        power.alive_withheld = Some(self.settled(SETTLE)?.alive_withheld);
        power.lit_ready = self.look()?;
        // The plug is handled while the E-stop is pressed, and only if the board sees that it is.
        power.closed_pressed = self.press()?;
        if power.closed_pressed != Some(false) {
            return self.release().map(drop);
        }
        power.lit_pressed = self.look()?;
        if self.act(Action::UnplugAlive)? == Answer::Skip {
            return self.release().map(drop);
        }
        power.closed_released = Some(self.release()?);
        power.lit_unplugged = self.look()?;
        let pulsed = match self.act(Action::StandBack)? {
            Answer::Skip => Ok(()),
            _ => self.pulses(pulse::BLIND_N, &mut power.unplugged),
        };
        // Also after pulses that failed: the line does not stay unplugged without a word. Not
        // with the E-stop released: the amplifiers would get their power with a hand at the plug.
        while self.press()? != Some(false) {
            self.hands
                .say("the alive line is still unplugged; plug it in with the E-stop pressed only");
        }
        self.act(Action::PlugAlive)?;
        self.release()?;
        pulsed
    }

    /// Has the E-stop pressed. Whether the board's loop is still closed; `None`: it was left out.
    fn press(&mut self) -> Result<Option<bool>, BringUpError> {
        let mut closed = None;
        for _ in 0..ATTEMPTS {
            if self.act(Action::PressEStop)? == Answer::Skip {
                return Ok(closed);
            }
            closed = Some(self.closed()?);
            if closed == Some(false) {
                break;
            }
            self.hands.say("the board sees its E-stop loop closed");
        }
        Ok(closed)
    }

    /// Has the E-stop released, and waits until the board has given the power. Whether its loop is
    /// closed.
    fn release(&mut self) -> Result<bool, BringUpError> {
        self.act(Action::ReleaseEStop)?;
        let closed = self.closed()?;
        self.clear()?;
        self.settled(SETTLE)?;
        Ok(closed)
    }

    fn look(&mut self) -> Result<Option<bool>, BringUpError> {
        Ok(match self.act(Action::LookAtPower)? {
            Answer::Done => Some(true),
            Answer::No => Some(false),
            Answer::Skip => None,
        })
    }
}
