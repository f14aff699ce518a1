//! The suite. See the crate's documentation.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(not(target_os = "none"))]
fn main() {
    println!("on-target: these tests run on the board, not on a host; see docs/bring-up.md");
}

#[cfg(target_os = "none")]
use {defmt_rtt as _, panic_probe as _};

#[cfg(target_os = "none")]
#[defmt_test::tests]
mod tests {
    use board::clocks;
    use board::hw::counters::Counters;
    use board::hw::{dac, gpio, pac, startup, time};
    use board::pins;
    use control::{DacCode, UnitIndex, UnitSet};
    use defmt::{assert, assert_eq, unwrap};

    /// What the tests share.
    pub struct Rig {
        counters: Counters,
        broken_counter: Option<u32>,
        core_hz_by_dwt: u32,
        ticks: u32,
    }

    #[init]
    fn start() -> Rig {
        gpio::hold_dacs_at_zero();
        let mut core = unwrap!(cortex_m::Peripherals::take());
        let part = unwrap!(pac::Peripherals::take());
        startup::debug(&part.DBGMCU);
        gpio::configure();
        startup::clocks(&part.RCC, &part.PWR, &part.FLASH);
        startup::caches(&mut core.SCB);
        startup::priorities(&mut core.NVIC, &mut core.SCB);
        time::start(&mut core.SYST);
        core.DCB.enable_trace();
        core.DWT.enable_cycle_counter();

        // Core cycles and millisecond ticks in 100 ms of board time.
        time::take_tick();
        let (from, cycles) = (time::now(), cortex_m::peripheral::DWT::cycle_count());
        let mut ticks = 0;
        while time::now().since(from) < 100_000 {
            ticks += u32::from(time::take_tick());
        }
        let core_hz_by_dwt = cortex_m::peripheral::DWT::cycle_count().wrapping_sub(cycles) * 10;
        dac::start();
        let (counters, broken_counter) = Counters::start();
        Rig {
            counters,
            broken_counter,
            core_hz_by_dwt,
            ticks,
        }
    }

    /// TIM2 and the core come from the same PLL by different dividers: their ratio is exact.
    #[test]
    fn core_runs_at_its_frequency(rig: &mut Rig) {
        assert!(rig.core_hz_by_dwt.abs_diff(clocks::CORE_HZ) < clocks::CORE_HZ / 1_000);
    }

    #[test]
    fn the_supervisor_ticks_once_a_millisecond(rig: &mut Rig) {
        assert!((99..=101).contains(&rig.ticks));
    }

    /// An idle I2C bus is high on both lines: pull-ups are there and nothing holds it low.
    #[test]
    fn i2c_lines_are_pulled_up() {
        assert!(
            gpio::read(pins::I2C_SCL),
            "SCL low: pull-up missing, or held"
        );
        assert!(
            gpio::read(pins::I2C_SDA),
            "SDA low: pull-up missing, or held"
        );
    }

    /// Every counter kept two patterns on all its data lines.
    #[test]
    fn all_counters_answer(rig: &mut Rig) {
        assert_eq!(rig.broken_counter, None);
    }

    /// Motors at rest: two readings of each encoder lie within a few counts of each other.
    #[test]
    fn encoders_stand_still(rig: &mut Rig) {
        for unit in UnitIndex::ALL {
            let first = rig.counters.read(unit).0;
            let from = time::now();
            while time::now().since(from) < 10_000 {}
            assert!((rig.counters.read(unit).0 - first).abs() < 8);
        }
    }

    /// A word goes out within its deadline: SPI1, its clock and its interrupt work.
    #[test]
    fn a_dac_word_goes_out() {
        assert!(
            !dac::is_held(),
            "RST of the DACs is still low after start-up"
        );
        dac::take_done();
        dac::write(UnitIndex::Unit1, DacCode::ZERO_VOLT);
        let from = time::now();
        let mut done = UnitSet::default();
        while done == UnitSet::default() && time::now().since(from) < clocks::DAC_DEADLINE_US {
            done = dac::take_done().0;
        }
        assert!(done.iter().eq([UnitIndex::Unit1]));
        assert_eq!(dac::take_error(), None);
    }
}
