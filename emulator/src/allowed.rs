//! The allow list: register accesses that the emulated part refuses or does not know and that are
//! right all the same, each with its reason. Everything else fails a run.

use emulator_link::RegisterEvent;

/// One kind of access that is let pass.
#[derive(Debug, Clone, Copy)]
pub struct Allowed {
    /// How [`RegisterEvent::place`] begins.
    pub place: &'static str,
    /// How [`RegisterEvent::what`] begins; empty for anything.
    pub what: &'static str,
    /// Why it is right.
    pub reason: &'static str,
}

/// The list.
pub const ALLOWED: &[Allowed] = &[Allowed {
    place: "CRS.",
    what: "no model",
    reason: "clock recovery trims HSI48 by the USB host's frames; the emulated HSI48 is exact",
}];

/// The reason why `event` is let pass, if it is.
#[must_use]
pub fn reason(event: &RegisterEvent) -> Option<&'static str> {
    ALLOWED
        .iter()
        .find(|allowed| {
            event.place.starts_with(allowed.place) && event.what.starts_with(allowed.what)
        })
        .map(|allowed| allowed.reason)
}

/// The events that are not on the list.
#[must_use]
pub fn unexpected(events: &[RegisterEvent]) -> Vec<RegisterEvent> {
    (events.iter())
        .filter(|event| reason(event).is_none())
        .cloned()
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn event(place: &str, what: &str) -> RegisterEvent {
        RegisterEvent {
            place: place.to_owned(),
            what: what.to_owned(),
            count: 1,
        }
    }

    #[test]
    fn only_what_is_listed_passes() {
        let recovery = event("CRS.CR", "no model behind this register");
        let rcc = event("RCC.PLL1DIVR", "RM0433: DIVN below 4");
        let gated = event("CRS.CR", "is gated by RCC");
        let left = unexpected(&[recovery, rcc.clone(), gated.clone()]);
        assert_eq!(left, [rcc, gated]);
    }

    #[test]
    fn every_entry_says_why() {
        for allowed in ALLOWED {
            assert!(
                !allowed.place.is_empty() && allowed.reason.len() > 20,
                "{allowed:?}"
            );
        }
    }
}
