//! A port without interrupts: the counters' strobes and data bus, which carry most of the pin
//! traffic.
//!
//! The engine's own port announces every change of a pin to every instance that might listen, which
//! costs more than the rest of a counter's read. Nothing listens to these two ports: no EXTI line,
//! no chip select. This model keeps what is left (RM0433 rev 9 section 11.4): modes, output levels,
//! BSRR, IDR. LCKR is not modelled.

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32h743::generated::gpioa::Register;
use rigless::time::VirtualNanos;

/// See the module's page.
#[derive(Debug, Default)]
pub struct QuietPort {
    /// Pins that the board drives, and their levels; a level stays on the wire when it is let go.
    driven: u16,
    level: u16,
}

impl QuietPort {
    /// The board drives `pin`, or lets go of it.
    pub fn drive(&mut self, pin: u8, level: Option<bool>) {
        let bit = 1 << pin;
        match level {
            Some(high) => {
                self.driven |= bit;
                self.level = self.level & !bit | if high { bit } else { 0 };
            }
            None => self.driven &= !bit,
        }
    }

    fn input(&self, registers: &RegisterFile) -> u64 {
        let modes = registers.get(Register::Moder);
        let pulls = registers.get(Register::Pupdr);
        let open_drain = registers.get(Register::Otyper);
        let output = registers.get(Register::Odr);
        (0..16).fold(0, |bits, pin| {
            let outside = match pulls >> (2 * pin) & 3 {
                1 if self.driven >> pin & 1 == 0 => 1,
                2 if self.driven >> pin & 1 == 0 => 0,
                _ => u64::from(self.level >> pin & 1),
            };
            let high = output >> pin & 1;
            let level = match modes >> (2 * pin) & 3 {
                3 => 0,
                1 if high == 0 || open_drain >> pin & 1 == 0 => high,
                _ => outside,
            };
            bits | level << pin
        })
    }
}

impl Device for QuietPort {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        _context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        (register == Register::Idr).then(|| self.input(registers))
    }

    fn peek(&self, register: Register, registers: &RegisterFile, _: VirtualNanos) -> Option<u64> {
        (register == Register::Idr).then(|| self.input(registers))
    }

    fn write(
        &mut self,
        register: Register,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) {
        if register == Register::Bsrr {
            // A set beats a reset of the same pin.
            let (set, reset) = (value & 0xFFFF, value >> 16 & 0xFFFF);
            registers.set(Register::Odr, registers.get(Register::Odr) & !reset | set);
        } else if register == Register::Lckr {
            context.tell(
                "LCKR",
                "the rig's model of this port has no configuration lock",
            );
        }
    }
}
