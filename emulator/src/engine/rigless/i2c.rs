//! I2C1 with wires that have edges, a filter in front and a level that can be held: the engine's
//! controller, kept from sending a START while SDA is low.
//!
//! The engine's own model drives every edge itself and does not know a bus that another device
//! holds. On the part a START that finds SDA low never leaves: BUSY stands, no flag and no
//! interrupt follows (RM0433 rev 9 section 47.4.9: the controller waits for a free bus). Clearing
//! PE is the only way out.

use super::peers::Shared;
use rigless::device::{Device, DeviceContext, RegisterFile, RequestChange};
use rigless::soc::stm32h743::generated::i2c1::{cr1, cr2, isr, Register};
use rigless::soc::stm32h743::peripherals::i2c::I2c;
use rigless::time::{EventId, VirtualNanos};

/// What each SCL period takes beyond the engine's count, in nanoseconds: edges of 190 and 20 ns and
/// twice the analog filter's delay (RM0433 rev 9 section 47.4.9; the datasheet gives the filter 50
/// to 260 ns, here 100).
const EDGES_AND_FILTER_NS: u64 = 190 + 20 + 2 * 100;

/// Kernel clock until the clock tree says otherwise (the engine's own value), in hertz.
const RESET_KERNEL_HZ: u64 = 64_000_000;

/// See the module's page.
#[derive(Debug)]
pub struct HeldI2c {
    inner: I2c,
    board: Shared,
    kernel_hz: u64,
    /// TIMINGR as the core wrote it; the engine's copy has a longer SCL low.
    timing: u64,
}

impl HeldI2c {
    /// The controller with the board's bus on its wires.
    pub fn new(board: &Shared) -> Self {
        let mut inner = I2c::default();
        inner.attach(super::peers::SensorBus(board.clone()));
        Self {
            inner,
            board: board.clone(),
            kernel_hz: RESET_KERNEL_HZ,
            timing: 0,
        }
    }

    /// A TIMINGR value whose SCL low contains what edges and filter take.
    fn with_edges(&self, value: u64) -> u64 {
        let prescaler = (value >> 28 & 0xF) + 1;
        let ticks = EDGES_AND_FILTER_NS * self.kernel_hz / 1_000_000_000 / prescaler;
        value & !0xFF | (value & 0xFF).saturating_add(ticks).min(0xFF)
    }
}

impl Device for HeldI2c {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        if register == Register::Timingr {
            return Some(self.timing);
        }
        Device::read(&mut self.inner, register, registers, context)
    }

    fn peek(&self, register: Register, registers: &RegisterFile, now: VirtualNanos) -> Option<u64> {
        Device::peek(&self.inner, register, registers, now)
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        let mut value = value;
        if register == Register::Timingr {
            self.timing = value;
            value = self.with_edges(value);
            registers.set(Register::Timingr, value);
        }
        if register == Register::Cr2 && cr2::START.is_set(value) {
            let free = !isr::BUSY.is_set(registers.get(Register::Isr));
            let enabled = cr1::PE.is_set(registers.get(Register::Cr1));
            let mut board = self.board.lock();
            if enabled && free && board.sda_held() {
                let flags = registers.get(Register::Isr) | isr::BUSY.mask();
                registers.set(Register::Isr, flags);
                return;
            }
            if enabled {
                let address = (value >> 1 & 0x7F) as u8;
                board.i2c_begins(context.now().0, address);
            }
        }
        Device::write(&mut self.inner, register, value, registers, context);
    }

    fn on_event(
        &mut self,
        event: EventId,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_event(&mut self.inner, event, registers, context);
        let in_transfer = isr::BUSY.is_set(registers.get(Register::Isr));
        if in_transfer && self.board.lock().take_bus_error() {
            let flags = registers.get(Register::Isr) | isr::BERR.mask();
            registers.set(Register::Isr, flags);
            // The model updates its interrupt lines with a write of what is there already.
            let control = registers.get(Register::Cr1);
            Device::write(&mut self.inner, Register::Cr1, control, registers, context);
        }
    }

    fn on_request(
        &mut self,
        request: RequestChange,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        Device::on_request(&mut self.inner, request, registers, context);
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.kernel_hz = hz;
        Device::on_clock(&mut self.inner, hz, registers, context);
    }

    fn reset(&mut self) {
        self.timing = 0;
        Device::reset(&mut self.inner);
    }

    fn reset_line(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        Device::reset_line(&mut self.inner, registers, context);
    }
}
