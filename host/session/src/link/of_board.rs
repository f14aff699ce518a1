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
