//! The second USB core on the engine's bus: `emulator-usb`'s core and host in the place of the
//! engine's registers.
//!
//! The engine describes three blocks of the core, stores what is written there, and has nothing
//! behind the FIFOs. The blocks get other tables of registers here, with a row for each word, and
//! [`Block`] passes every access on. The FIFOs answer at their first word, which is where drivers
//! access them.

use emulator_usb::core::registers::{ENDPOINTS, FIFO, FIFO_SPACING, PCGCCTL};
use emulator_usb::{Core, Host};
use rigless::device::{DeviceContext, ErasedDevice, Level, RegisterFile, RequestChange};
use rigless::soc::stm32h743::{CPU, MEMORY};
use rigless::soc::{
    Access, Bus, Error, Gate, Peripheral, ReadAction, RegisterSpec, Width, WriteModify,
};
use rigless::time::{EventId, VirtualNanos};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Names of the instances that are replaced.
pub const INSTANCES: [&str; 3] = ["OTG2_HS_GLOBAL", "OTG2_HS_DEVICE", "OTG2_HS_PWRCLK"];
/// `usb2_gbl_it`, position 101 of table 147.
const LINE: &[u16] = &[101];

const fn row(offset: u32) -> RegisterSpec {
    RegisterSpec {
        name: "word",
        offset,
        width: Width::W32,
        reset: 0,
        access: Access::ReadWrite,
        read: ReadAction::None,
        write: WriteModify::None,
        fields: &[],
    }
}

const fn words<const N: usize>() -> [RegisterSpec; N] {
    let mut rows = [row(0); N];
    let mut n = 0;
    while n < N {
        rows[n] = row(4 * n as u32);
        n += 1;
    }
    rows
}

/// PCGCCTL and the first word of each FIFO.
const fn power_and_fifos() -> [RegisterSpec; 1 + ENDPOINTS] {
    let mut rows = [row(0); 1 + ENDPOINTS];
    let mut n = 0;
    while n < ENDPOINTS {
        rows[1 + n] = row(FIFO - PCGCCTL + FIFO_SPACING * n as u32);
        n += 1;
    }
    rows
}

static GLOBAL: [RegisterSpec; 0x100] = words();
static DEVICE: [RegisterSpec; 0x108] = words();
static POWER_AND_FIFOS: [RegisterSpec; 1 + ENDPOINTS] = power_and_fifos();

/// Offset from the core's base and table of each of [`INSTANCES`].
static BLOCKS: [(u32, &[RegisterSpec]); 3] =
    [(0, &GLOBAL), (0x800, &DEVICE), (PCGCCTL, &POWER_AND_FIFOS)];

/// The core, the host, and the level that the interrupt line has.
#[derive(Debug, Default)]
pub struct Usb {
    /// The controller's end.
    pub core: Core,
    /// The other end of the cable.
    pub host: Host,
    line: bool,
    /// Something was changed from outside: the host may have an event.
    touched: bool,
}

/// [`Usb`], shared between the engine's thread and the rig's. They take turns, so a lock never
/// waits.
#[derive(Debug, Clone, Default)]
pub struct SharedUsb(Arc<Mutex<Usb>>);

impl SharedUsb {
    fn lock(&self) -> MutexGuard<'_, Usb> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Uses core and host from outside the engine.
    pub fn with<R>(&self, act: impl FnOnce(&mut Host, &mut Core) -> R) -> R {
        let mut usb = self.lock();
        usb.touched = true;
        let Usb { core, host, .. } = &mut *usb;
        act(host, core)
    }

    /// The controller was reset.
    pub fn reset(&self) {
        let mut usb = self.lock();
        usb.core.power_reset();
        usb.line = false;
        usb.touched = true;
    }

    /// Whether something was changed from outside since the last call.
    pub fn take_touched(&self) -> bool {
        std::mem::take(&mut self.lock().touched)
    }
}

impl Usb {
    /// Drives the interrupt line and requests the host's next event.
    fn settle(&mut self, context: &mut DeviceContext<'_>) {
        let level = self.core.interrupt();
        if level != self.line {
            self.line = level;
            context.interrupt(0, Level::from(level));
        }
        if let Some(at) = self.host.next_event(&self.core) {
            context.schedule(VirtualNanos(at));
        }
    }
}

/// One of the three blocks.
#[derive(Debug)]
pub struct Block {
    nth: usize,
    usb: SharedUsb,
}

impl Block {
    /// The blocks of [`INSTANCES`], in their order.
    pub fn all(usb: &SharedUsb) -> [Self; 3] {
        std::array::from_fn(|nth| Self {
            nth,
            usb: usb.clone(),
        })
    }

    fn offset(&self, row: usize) -> u32 {
        let (base, rows) = BLOCKS[self.nth];
        base + rows[row].offset
    }

    /// Lets the host act until now.
    pub fn advance(&mut self, context: &mut DeviceContext<'_>) {
        let mut usb = self.usb.lock();
        let Usb { core, host, .. } = &mut *usb;
        host.advance(core, context.now().0);
        usb.settle(context);
    }
}

impl ErasedDevice for Block {
    fn layout(&self) -> &'static [RegisterSpec] {
        BLOCKS[self.nth].1
    }

    fn read(
        &mut self,
        row: usize,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        let offset = self.offset(row);
        let mut usb = self.usb.lock();
        let value = usb.core.read(offset);
        usb.settle(context);
        Some(value.into())
    }

    fn peek(&self, row: usize, _registers: &RegisterFile, _now: VirtualNanos) -> Option<u64> {
        let offset = self.offset(row);
        self.usb.lock().core.peek(offset).map(u64::from)
    }

    fn write(
        &mut self,
        row: usize,
        value: u64,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let offset = self.offset(row);
        let mut usb = self.usb.lock();
        usb.core.write(offset, value as u32);
        usb.settle(context);
    }

    fn on_event(
        &mut self,
        _event: EventId,
        _registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        self.advance(context);
    }

    fn on_request(&mut self, _: RequestChange, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_clock(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn poll(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn reset(&mut self) {
        self.usb.reset();
    }

    fn on_access(&mut self, _: u64, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}

    fn on_refused(&mut self, _: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {}
}

/// The other slots: on a bus of their own while the engine's are on the part's, and the other way
/// round. At a reset the engine compares the part's bus with its own description, so its slots have
/// to be back then.
#[derive(Debug)]
pub struct Replacement {
    other: Bus,
    slots: [usize; 3],
}

impl Replacement {
    /// Slots with the tables of this module, gated by the clock enable as the engine's.
    ///
    /// # Errors
    /// The engine's description of the part is not the one this module was written for.
    pub fn new(bus: &Bus) -> Result<Self, Error> {
        let instances = bus.slots().iter().map(|slot| {
            let described = *slot.peripheral();
            match INSTANCES.iter().position(|name| *name == described.name) {
                Some(nth) => Peripheral {
                    interrupts: LINE,
                    registers: BLOCKS[nth].1,
                    ..described
                },
                None => described,
            }
        });
        let mut builder = Bus::builder(CPU, &MEMORY, instances);
        for name in INSTANCES {
            builder = builder.gate(name, Gate::by("RCC", "AHB1ENR", "USB2OTGHSEN"));
        }
        let other = builder.build()?;
        let mut slots = [0; 3];
        for (slot, name) in slots.iter_mut().zip(INSTANCES) {
            *slot = bus.slot(name)?;
            // Gates name slots by number, so both buses must have the same order.
            if other.slot(name)? != *slot || other.slot("RCC")? != bus.slot("RCC")? {
                return Err(Error::OtherDescription);
            }
        }
        Ok(Self { other, slots })
    }

    /// Exchanges the bus's slots and these.
    pub fn exchange(&mut self, bus: &mut Bus) {
        for nth in self.slots {
            std::mem::swap(bus.slot_mut(nth), self.other.slot_mut(nth));
        }
    }

    /// Where [`INSTANCES`] are on the bus.
    pub const fn slots(&self) -> [usize; 3] {
        self.slots
    }
}
