//! A link that has to lead to one board.

use super::{Exchange, LinkError, RigControls, RigLink};
use std::time::Duration;

/// A link whose board must have a certain number: [`crate::Session::connect`] refuses another one.
pub struct OfBoard {
    link: Box<dyn RigLink>,
    number: String,
}

impl OfBoard {
    /// `link`, which has to lead to the board with this number.
    #[must_use]
    pub fn new(link: Box<dyn RigLink>, number: String) -> Self {
        Self { link, number }
    }
}

impl RigLink for OfBoard {
    fn name(&self) -> String {
        self.link.name()
    }

    fn exchange(&mut self, to_board: &[u8], duration: Duration) -> Result<Exchange, LinkError> {
        self.link.exchange(to_board, duration)
    }

    fn booted_here(&self) -> bool {
        self.link.booted_here()
    }

    fn stopped_by(&self) -> Option<&str> {
        self.link.stopped_by()
    }

    fn board(&self) -> Option<&str> {
        Some(&self.number)
    }

    fn controls(&mut self) -> Option<&mut dyn RigControls> {
        self.link.controls()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::fast::FastRig;
    use crate::link::EmbeddedOptions;
    use crate::{Session, SessionError};
    use wire::message::UnitSetpoint;
    use wire::UNITS;

    fn rig() -> Box<dyn RigLink> {
        Box::new(FastRig::open(&EmbeddedOptions::default()).unwrap())
    }

    #[test]
    fn another_board_is_refused_and_the_right_one_is_not() {
        let mut link = rig();
        let session = Session::connect(link.as_mut()).unwrap();
        let number = session.info().unwrap().number().unwrap();
        let mut right = OfBoard::new(rig(), number.as_str().to_owned());
        assert!(Session::connect(&mut right).is_ok());
        let mut wrong = OfBoard::new(rig(), "0123456789ABCDEF0000000A".to_owned());
        let error = Session::connect(&mut wrong).unwrap_err();
        assert!(
            matches!(&error, SessionError::OtherBoard { is, .. } if *is == number.as_str()),
            "{error}"
        );
    }

    /// What the board refuses ends the session with these values, and not with an expiry later.
    #[test]
    fn a_refused_setpoint_is_told_with_what_was_sent() {
        let mut link = rig();
        let mut session = Session::connect(link.as_mut()).unwrap();
        let units = [UnitSetpoint {
            tension_un: 900_000_000,
            inv_cos_q16: 1 << 16,
            direction_q14: [0; 3],
            reel_um_per_s: None,
        }; UNITS];
        let file = rig::Rig::built_in().unwrap().units;
        session.configure(&file.map(|unit| unit.to_wire())).unwrap();
        let error = session
            .send_setpoints(units, crate::PERIOD)
            .and_then(|()| session.exchange(crate::PERIOD))
            .unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("`setpoints`: unit 1: a tension of 900.00 N"),
            "{text}"
        );
    }
}
