//! The independent watchdog of the STM32H7 (RM0433 rev 9 chapter 45), which the engine does not
//! model.
//!
//! Keys (section 45.4.1): 0xCCCC starts the counter from 0xFFF and turns the LSI on, 0xAAAA reloads
//! it from RLR, 0x5555 opens PR, RLR and WINR until the next other key. The three cross into the
//! LSI's domain in up to five LSI periods, shown by PVU, RVU and WVU (45.4.4). At zero, or on a
//! reload while the counter is above WINR, the part resets; the engine's RCC then sets IWDG1RSTF.

use rigless::device::{Device, DeviceContext, Level, RegisterFile};
use rigless::soc::stm32h743::generated::iwdg::{pr, rlr, winr, Register};
use rigless::soc::stm32h743::peripherals::rcc::IWDG_STARTED;
use rigless::time::{EventId, VirtualNanos};

const START: u64 = 0xCCCC;
const RELOAD: u64 = 0xAAAA;
const UNLOCK: u64 = 0x5555;
const FULL: u64 = 0xFFF;
const PVU: u64 = 1;
const RVU: u64 = 2;
const WVU: u64 = 4;
/// LSI periods that a crossing takes.
const CROSSING: u64 = 5;

/// See the module's page.
#[derive(Debug)]
pub struct Iwdg {
    started: bool,
    open: bool,
    /// LSI rate in hertz, 0 while it does not run.
    hz: u64,
    /// What the firmware sees of PR, RLR and WINR, and what the counter uses.
    shown: [u64; 3],
    used: [u64; 3],
    /// LSI periods left to zero at `since`.
    left: u64,
    since: VirtualNanos,
    expiry: Option<EventId>,
    crossing: Option<EventId>,
}

impl Default for Iwdg {
    fn default() -> Self {
        Self {
            started: false,
            open: false,
            hz: 0,
            shown: [0, FULL, FULL],
            used: [0, FULL, FULL],
            left: 0,
            since: VirtualNanos(0),
            expiry: None,
            crossing: None,
        }
    }
}

impl Iwdg {
    fn divider(&self) -> u64 {
        4 << self.used[0].min(6)
    }

    /// LSI periods left at `now`.
    fn left_at(&self, now: VirtualNanos) -> u64 {
        let gone =
            u128::from(now.0.saturating_sub(self.since.0)) * u128::from(self.hz) / 1_000_000_000;
        self.left
            .saturating_sub(u64::try_from(gone).unwrap_or(u64::MAX))
    }

    fn load(&mut self, count: u64, context: &mut DeviceContext<'_>) {
        self.left = (count + 1) * self.divider();
        self.since = context.now();
        self.arm(context);
    }

    fn arm(&mut self, context: &mut DeviceContext<'_>) {
        self.expiry = (self.started && self.hz > 0).then(|| {
            let ns = (u128::from(self.left) * 1_000_000_000).div_ceil(u128::from(self.hz));
            context.schedule(VirtualNanos(
                self.since.0 + u64::try_from(ns).unwrap_or(u64::MAX / 2),
            ))
        });
    }

    fn cross(&mut self, context: &mut DeviceContext<'_>) {
        if let Some(ns) = (CROSSING * 1_000_000_000).checked_div(self.hz) {
            self.crossing = Some(context.schedule(VirtualNanos(context.now().0 + ns)));
        }
    }
}

impl Device for Iwdg {
    type Register = Register;

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let pending = registers.get(Register::Sr);
        match register {
            Register::Kr => {
                self.open = value == UNLOCK;
                if value == START && !self.started {
                    self.started = true;
                    context.request(IWDG_STARTED, Level::High);
                    self.load(FULL, context);
                } else if value == RELOAD && self.started {
                    let count = self.left_at(context.now()).div_ceil(self.divider());
                    if count > self.used[2] + 1 {
                        context.request_reset();
                    }
                    self.load(self.used[1], context);
                }
            }
            Register::Pr | Register::Rlr | Register::Winr => {
                let (index, mask, flag) = match register {
                    Register::Pr => (0, pr::PR.mask(), PVU),
                    Register::Rlr => (1, rlr::RL.mask(), RVU),
                    _ => (2, winr::WIN.mask(), WVU),
                };
                if !self.open {
                    context.tell(
                        register_name(register),
                        "RM0433 rev 9 section 45.4: written without the 0x5555 key, ignored",
                    );
                } else if pending & flag != 0 {
                    context.tell(register_name(register), "RM0433 rev 9 section 45.4: written while its update flag in IWDG_SR stands, ignored");
                } else {
                    self.shown[index] = value & mask;
                    registers.set(Register::Sr, pending | flag);
                    self.cross(context);
                }
                registers.set(register, self.shown[index]);
            }
            Register::Sr => {}
        }
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if self.crossing == Some(event) {
            self.crossing = None;
            let window = self.used[2] != self.shown[2];
            self.left = self.left_at(context.now());
            self.since = context.now();
            // The prescaler changes under a running count: what is left is kept in counts.
            let counts = self.left.div_ceil(self.divider());
            self.used = self.shown;
            self.left = counts * self.divider();
            registers.set(Register::Sr, 0);
            if window {
                // 46.3.2: writing WINR reloads the counter.
                self.left = (self.used[1] + 1) * self.divider();
            }
            self.arm(context);
        }
        if self.expiry == Some(event) {
            self.expiry = None;
            if self.left_at(context.now()) == 0 {
                context.request_reset();
            }
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.left = self.left_at(context.now());
        self.since = context.now();
        self.hz = hz;
        self.arm(context);
        if registers.get(Register::Sr) != 0 && self.crossing.is_none() {
            self.cross(context);
        }
    }

    fn reset(&mut self) {
        *self = Self::default();
    }
}

const fn register_name(register: Register) -> &'static str {
    match register {
        Register::Kr => "KR",
        Register::Pr => "PR",
        Register::Rlr => "RLR",
        Register::Sr => "SR",
        Register::Winr => "WINR",
    }
}
