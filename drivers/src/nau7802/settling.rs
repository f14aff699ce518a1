//! Results that a converter may give before its filter has settled.

/// Counts the results that are discarded after a start, a calibration, or a change of gain, rate or
/// channel.
///
/// The first six conversions then hold a part of the load only (datasheet section 8.4). Sources
/// differ on whether they come with DRDY: the datasheet lines at hand can be read as "DRDY stays
/// quiet for them", Linux's driver counts six ready results away. Discarding six results is right
/// either way. It costs six samples where the part keeps quiet: 19 ms at 320 samples a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settling {
    /// Results up to the first settled one, which counts.
    left: u8,
}

impl Settling {
    /// Results to discard.
    pub const RESULTS: u8 = 6;

    /// Conversions have just been started.
    pub const fn begun() -> Self {
        Self {
            left: Self::RESULTS + 1,
        }
    }

    /// Nothing is left to discard.
    pub const fn over() -> Self {
        Self { left: 0 }
    }

    /// Whether a settled result has been read.
    pub const fn is_over(&self) -> bool {
        self.left == 0
    }

    /// Takes a new result: whether it is settled. Call it once per result that was read, and not
    /// for one that was ready before the start.
    pub const fn result(&mut self) -> bool {
        self.left = self.left.saturating_sub(1);
        self.is_over()
    }
}
