//! The allow list: register accesses that the emulated part refuses or does not know and that are right all
//! the same, each with its reason. Everything else fails a run.

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
pub const ALLOWED: &[Allowed] = &[
    Allowed {
        place: "CRS.",
        what: "no model",
        reason: "clock recovery trims HSI48 by the USB host's frames; with no cable in the socket there are none to trim by",
    },
    Allowed {
        place: "OTG2_HS_DEVICE",
        what: "no model",
        reason: "the engine has no USB endpoints; with no cable in the socket the device block only stores its settings",
    },
    Allowed {
        place: "OTG2_HS_PWRCLK",
        what: "no model",
        reason: "power and clock gating of the USB core: set once at start-up, no effect without a host",
    },
    Allowed {
        place: "OTG2_HS_GLOBAL",
        what: "no register",
        reason: "OTG_GSNPSID and its neighbours are missing in the vendor's register file; device stacks read them once",
    },
];

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
        let usb = event(
            "OTG2_HS_DEVICE.OTG_HS_DCFG",
            "no model behind this register",
        );
        let rcc = event("RCC.PLL1DIVR", "RM0433: DIVN below 4");
        let gated = event("OTG2_HS_DEVICE.OTG_HS_DCFG", "is gated by RCC");
        let left = unexpected(&[usb, rcc.clone(), gated.clone()]);
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
