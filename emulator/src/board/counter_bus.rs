//! The 8-bit bus of the encoder counters: strobes, their widths, contention.

use super::Board;
use crate::devices::ls7266r1;
use crate::wiring::{self, Pin};

impl Board {
    pub(super) fn counter_pins(&mut self, t_ns: u64, before: u16, after: u16) {
        let high = |levels: u16, pin: Pin| levels & pin.bit() != 0;
        let (wr, rd) = (wiring::CNT_WR, wiring::CNT_RD);
        if high(before, wr) && !high(after, wr) {
            self.write_low_ns = t_ns;
        }
        if !high(before, wr) && high(after, wr) {
            let low = t_ns.saturating_sub(self.write_low_ns);
            if low < ls7266r1::WRITE_LOW_NS {
                self.complaints.add(
                    "LS7266R1 bus",
                    format!("WR low for less than {} ns", ls7266r1::WRITE_LOW_NS),
                );
            }
            self.counter_write(t_ns, before);
        }
        if high(before, rd) && !high(after, rd) {
            if (self.read_high_ns).is_some_and(|last| t_ns - last < ls7266r1::READ_GAP_NS) {
                self.complaints.add(
                    "LS7266R1 bus",
                    format!("less than {} ns between two reads", ls7266r1::READ_GAP_NS),
                );
            }
            self.read_low_ns = Some(t_ns);
            self.counter_read(after);
        }
        if !high(before, rd) && high(after, rd) {
            if let Some(since) = self.read_low_ns.take() {
                if t_ns - since < ls7266r1::READ_LOW_NS {
                    self.complaints.add(
                        "LS7266R1 bus",
                        format!("RD low for less than {} ns", ls7266r1::READ_LOW_NS),
                    );
                }
            }
            self.read_high_ns = Some(t_ns);
            let (axis, control) = (
                usize::from(high(before, wiring::CNT_XY)),
                high(before, wiring::CNT_CD),
            );
            for (chip, cs) in wiring::CNT_CS.into_iter().enumerate() {
                if !high(before, cs) {
                    self.counters[chip].read_done(axis, control);
                }
            }
            for bit in 0..8 {
                self.pending.push((data_pin(bit), None));
            }
        }
    }

    pub(super) fn counter_write(&mut self, t_ns: u64, pins: u16) {
        let axis = usize::from(pins & wiring::CNT_XY.bit() != 0);
        let control = pins & wiring::CNT_CD.bit() != 0;
        let data = self.ports[wiring::CNT_D0.port];
        if data.driven & wiring::CNT_DATA != wiring::CNT_DATA {
            self.complaints.add(
                "LS7266R1 bus",
                "WR rose while the controller did not drive D0 to D7",
            );
        }
        let value = (data.seen(wiring::IDLE[wiring::CNT_D0.port]) >> 8) as u8;
        if control {
            // The latch takes the count of this instant.
            self.advance_plant(t_ns);
            self.turn_counters();
        }
        for (chip, cs) in wiring::CNT_CS.into_iter().enumerate() {
            if pins & cs.bit() == 0 {
                self.counters[chip].write(axis, control, value, &mut self.complaints);
            }
        }
    }

    pub(super) fn counter_read(&mut self, pins: u16) {
        let axis = usize::from(pins & wiring::CNT_XY.bit() != 0);
        let control = pins & wiring::CNT_CD.bit() != 0;
        let selected: Vec<usize> = (0..3)
            .filter(|chip| pins & wiring::CNT_CS[*chip].bit() == 0)
            .collect();
        if selected.len() > 1 {
            self.complaints.add(
                "LS7266R1 bus",
                "two chips selected during a read drive against each other",
            );
        }
        self.check_contention();
        let Some(&chip) = selected.first() else {
            self.complaints
                .add("LS7266R1 bus", "RD fell while no chip was selected");
            return;
        };
        let value = self.counters[chip].read(axis, control);
        for bit in 0..8 {
            self.pending
                .push((data_pin(bit), Some(value >> bit & 1 == 1)));
        }
    }

    pub(super) fn check_contention(&mut self) {
        let driven = self.ports[wiring::CNT_D0.port].driven & wiring::CNT_DATA;
        let reading = self.ports[wiring::CNT_RD.port].seen(wiring::IDLE[wiring::CNT_RD.port])
            & wiring::CNT_RD.bit()
            == 0;
        if driven != 0 && reading {
            self.complaints.add(
                "LS7266R1 bus",
                "contention: the controller drives D0 to D7 while RD is low",
            );
        }
    }

    /// The controller samples the counters' data pins.
    pub fn data_sampled(&mut self, t_ns: u64) {
        if (self.read_low_ns).is_some_and(|since| t_ns - since < ls7266r1::READ_LOW_NS) {
            self.complaints.add(
                "LS7266R1 bus",
                format!(
                    "data sampled less than {} ns after RD fell",
                    ls7266r1::READ_LOW_NS
                ),
            );
        }
    }
}

fn data_pin(bit: u8) -> Pin {
    Pin {
        port: wiring::CNT_D0.port,
        pin: wiring::CNT_D0.pin + bit,
    }
}
