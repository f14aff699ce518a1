//! Clock tree, baud rates, prescalers, deadlines and interrupt priorities, computed in one place.
//!
//! ```text
//! HSE 8 MHz (bypass, from the ST-Link) /2 = 4 MHz -> PLL1 x200 = 800 MHz VCO
//!   P /2 = 400 MHz  sysclk = core (VOS1; 480 MHz needs VOS0, and USB is on record as failing there)
//!     HPRE /2 = 200 MHz  AXI, AHB; flash at 2 wait states
//!       D2PPRE1 /2 = 100 MHz  APB1: I2C1, USART3; timers x2 = 200 MHz: TIM2
//!       D2PPRE2, D1PPRE, D3PPRE /2 = 100 MHz  APB2, APB3, APB4
//!   Q /8 = 100 MHz  SPI1 kernel clock
//! HSI48 -> USB OTG kernel clock, trimmed by CRS on the host's start-of-frame
//! LSI 32 kHz -> independent watchdog
//! ```
//!
//! Section numbers are those of RM0433 rev 8. All of it is `const`: a frequency that the part
//! cannot do stops the build, not the rig.

/// The crystal clock that the ST-Link feeds into OSC_IN, in hertz.
pub const HSE_HZ: u32 = 8_000_000;
/// Core clock in hertz.
pub const CORE_HZ: u32 = 400_000_000;
/// AXI and AHB clock in hertz (HPRE /2).
pub const AHB_HZ: u32 = CORE_HZ / 2;
/// Clock of APB1 to APB4 in hertz (all prescalers /2). Kernel clock of I2C1 and USART3.
pub const APB_HZ: u32 = AHB_HZ / 2;
/// Clock of the timers on APB1 in hertz: twice APB1 when its prescaler divides (section 8.5.10,
/// TIMPRE=0).
pub const TIMER_HZ: u32 = APB_HZ * 2;
/// Low-speed internal oscillator in hertz, nominal.
pub const LSI_HZ: u32 = 32_000;

/// PLL1: 4 MHz reference, 800 MHz VCO, P for the core, Q for SPI1.
pub const PLL1: Pll = Pll::new(HSE_HZ, 2, 200, 2, 8);
const _: () = assert!(PLL1.p_hz == CORE_HZ);

/// Internal oscillator in hertz, at its reset divider; right to 1 %.
pub const HSI_HZ: u32 = 64_000_000;
/// PLL1 from the HSI, for a board whose HSE input has no clock: the same frequencies.
pub const PLL1_HSI: Pll = Pll::new(HSI_HZ, 16, 200, 2, 8);
const _: () = assert!(PLL1_HSI.p_hz == PLL1.p_hz && PLL1_HSI.q_hz == PLL1.q_hz);

/// Whether this silicon (REV_ID) reads AXI SRAM wrongly: revisions Z and Y (ES0392 2.2.9).
#[must_use]
pub const fn has_axi_read_defect(rev_id: u16) -> bool {
    matches!(rev_id, 0x1001 | 0x1003)
}

/// TRBUFF of DMA_SxCR (section 15.5.5), for streams that serve a USART; 0 on revisions Z and Y,
/// where the bit is reserved and the lock-up of ES0392 2.20.4 does not occur.
#[must_use]
pub const fn dma_trbuff(rev_id: u16) -> u32 {
    if has_axi_read_defect(rev_id) {
        0
    } else {
        1 << 20
    }
}
const _: () = assert!(
    CORE_HZ <= 400_000_000,
    "VOS1 ends at 400 MHz (datasheet table 'general operating conditions')"
);

/// Kernel clock of SPI1 in hertz: PLL1 Q.
pub const SPI1_KERNEL_HZ: u32 = PLL1.q_hz;

/// Dividers of a PLL and what comes out of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pll {
    /// DIVM: source to reference, 1 to 63.
    pub m: u8,
    /// Multiplication; the register holds n - 1.
    pub n: u16,
    /// Divider of output P; the register holds p - 1.
    pub p: u8,
    /// Divider of output Q; the register holds q - 1.
    pub q: u8,
    /// PLLxRGE: range of the reference (section 8.7.13).
    pub input_range: u8,
    /// PLLxVCOSEL: false: wide VCO, 192 to 836 MHz; true: medium, 150 to 420 MHz.
    pub medium_vco: bool,
    /// Output P in hertz.
    pub p_hz: u32,
    /// Output Q in hertz.
    pub q_hz: u32,
}

impl Pll {
    /// Checks the dividers against section 8.3.2 and works out the rest.
    ///
    /// # Panics
    /// On dividers that the part forbids; in a `const` that is a build error.
    #[must_use]
    pub const fn new(source_hz: u32, m: u8, n: u16, p: u8, q: u8) -> Self {
        assert!(m >= 1 && m <= 63, "DIVM is 1 to 63");
        assert!(n >= 4 && n <= 512, "DIVN is 4 to 512");
        assert!(p >= 1 && p <= 128, "DIVP is 1 to 128");
        assert!(
            p == 1 || p.is_multiple_of(2),
            "DIVP1 allows 1 and even numbers only"
        );
        assert!(q >= 1 && q <= 128, "DIVQ is 1 to 128");
        let reference = source_hz / m as u32;
        let (input_range, medium_vco) = match reference {
            1_000_000..2_000_000 => (0, true),
            2_000_000..4_000_000 => (1, false),
            4_000_000..8_000_000 => (2, false),
            8_000_000..=16_000_000 => (3, false),
            _ => panic!("PLL reference is 1 to 16 MHz"),
        };
        let vco = reference as u64 * n as u64;
        let (low, high) = if medium_vco {
            (150_000_000, 420_000_000)
        } else {
            (192_000_000, 836_000_000)
        };
        assert!(vco >= low && vco <= high, "VCO out of its range");
        Self {
            m,
            n,
            p,
            q,
            input_range,
            medium_vco,
            p_hz: (vco / p as u64) as u32,
            q_hz: (vco / q as u64) as u32,
        }
    }
}

/// Flash wait states and programming delay (LATENCY, WRHIGHFREQ) for an AXI clock at VOS1: section
/// 4.3.8, table "FLASH recommended number of wait states and programming delay".
#[must_use]
pub const fn flash_latency(axi_hz: u32) -> (u8, u8) {
    match axi_hz {
        0..=70_000_000 => (0, 0),
        70_000_001..=140_000_000 => (1, 1),
        140_000_001..=185_000_000 => (2, 1),
        185_000_001..=210_000_000 => (2, 2),
        210_000_001..=225_000_000 => (3, 2),
        _ => panic!("AXI clock above 225 MHz at VOS1"),
    }
}

/// [`flash_latency`] of the clock tree above.
pub const FLASH_LATENCY: (u8, u8) = flash_latency(AHB_HZ);

// --- I2C1: multiplexer and converters ------------------------------------------------------------

/// SCL frequency in hertz, the fastest that multiplexer and converters allow (Fast-mode).
pub const I2C_HZ: u32 = 400_000;
/// Rise time of SCL and SDA in nanoseconds: 2.2 kOhm pull-ups into about 100 pF give 0.85 R C = 190
/// ns.
pub const I2C_RISE_NS: u32 = 190;
/// Fall time in nanoseconds (open-drain outputs of the part at medium speed).
pub const I2C_FALL_NS: u32 = 20;
/// [`i2c_timingr`] of the bus.
pub const I2C_TIMINGR: u32 = i2c_timingr(APB_HZ, I2C_HZ, I2C_RISE_NS, I2C_FALL_NS);

/// I2C_TIMINGR for Fast-mode (sections 47.4.5 and 47.4.10, and the I2C-bus specification's table of
/// Fast-mode times), analog filter on, digital filter off.
///
/// The controller adds a synchronisation delay to each phase: the edge, the analog filter and 2 to
/// 3 kernel clocks (section 47.4.9). Counted are SCL low and high less the smallest such delay (no
/// edge, filter 50 ns, 2 clocks), low in the specification's proportion of 1.3 to 0.6: never faster
/// than requested, and with the bus's own edges as fast as [`i2c_hz`] says.
///
/// # Panics
/// Where the kernel clock cannot make these times.
#[must_use]
pub const fn i2c_timingr(kernel_hz: u32, scl_hz: u32, rise_ns: u32, fall_ns: u32) -> u32 {
    const LOW_MIN_NS: u32 = 1_300;
    const HIGH_MIN_NS: u32 = 600;
    const SETUP_MIN_NS: u32 = 100;
    const VALID_MAX_NS: u32 = 900;
    // Analog filter delay, datasheet table "I2C analog filter characteristics".
    const FILTER_MIN_NS: u32 = 50;
    const FILTER_MAX_NS: u32 = 260;
    let clock_ns = 1_000_000_000 / kernel_hz;
    let mut prescaler = 1;
    while prescaler <= 16 {
        let step_ns = clock_ns * prescaler;
        // SCLDEL: data settled before SCL rises: rise time plus set-up.
        let scldel = (rise_ns + SETUP_MIN_NS).div_ceil(step_ns);
        // SDADEL: hold after SCL fell, less what filter and synchronisation already give.
        let given = FILTER_MIN_NS + 3 * clock_ns;
        let sdadel = if fall_ns > given {
            (fall_ns - given).div_ceil(step_ns)
        } else {
            0
        };
        let sync_ns = FILTER_MIN_NS + 2 * clock_ns;
        let period_ns = 1_000_000_000 / scl_hz;
        let low_ns = (period_ns * LOW_MIN_NS).div_ceil(LOW_MIN_NS + HIGH_MIN_NS);
        let low = (low_ns - sync_ns).div_ceil(step_ns);
        let high = (period_ns - low * step_ns - 2 * sync_ns).div_ceil(step_ns);
        if scldel <= 16 && sdadel <= 15 && low <= 256 && high <= 256 {
            assert!(
                low * step_ns + sync_ns >= LOW_MIN_NS && high * step_ns + sync_ns >= HIGH_MIN_NS,
                "bus too fast for Fast-mode"
            );
            assert!(
                sdadel * step_ns + rise_ns + FILTER_MAX_NS + 4 * clock_ns <= VALID_MAX_NS,
                "data would come too late after SCL fell"
            );
            return (prescaler - 1) << 28
                | (scldel - 1) << 20
                | sdadel << 16
                | (high - 1) << 8
                | (low - 1);
        }
        prescaler += 1;
    }
    panic!("no I2C prescaler fits");
}

/// Delay of the analog filter as it is used for [`i2c_hz`], in nanoseconds: the datasheet gives 50
/// to 260.
pub const I2C_FILTER_NS: u32 = 100;

/// SCL frequency in hertz that a TIMINGR value makes on a bus with these edges (section 47.4.9):
/// counted phases, and for each one edge, the analog filter and 2.5 kernel clocks.
#[must_use]
pub const fn i2c_hz(kernel_hz: u32, timingr: u32, rise_ns: u32, fall_ns: u32) -> u32 {
    let clock_ns = 1_000_000_000 / kernel_hz;
    let counted = (((timingr >> 8) & 0xFF) + (timingr & 0xFF) + 2) * ((timingr >> 28) + 1);
    let period_ns = counted * clock_ns + rise_ns + fall_ns + 2 * I2C_FILTER_NS + 5 * clock_ns;
    1_000_000_000 / period_ns
}

/// How long a transaction on the I2C bus may take, in microseconds, before it counts as stuck. The
/// longest (a sample: 54 clocks) takes 152 us at 355 kHz; slow edges and clock stretching get twice
/// that.
pub const I2C_DEADLINE_US: u32 = 300;
/// Half a period of the recovery clocks in microseconds: 100 kHz, which any device follows.
pub const RECOVERY_STEP_US: u32 = 5;

// --- SPI1: DACs ----------------------------------------------------------------------------------

/// Fastest SCLK of the DAC7731 in hertz (not confirmed by its maker).
pub const DAC_SCLK_MAX_HZ: u32 = 20_000_000;
/// [`spi_mbr`] of SPI1: 12.5 MHz, 1.28 us a word.
pub const SPI1_MBR: u8 = spi_mbr(SPI1_KERNEL_HZ, DAC_SCLK_MAX_HZ);

/// MBR of SPI_CFG1 (section 50.11.3): the smallest divider 2^(MBR+1) that keeps SCLK at or below
/// the limit.
///
/// # Panics
/// Where even /256 is too fast.
#[must_use]
pub const fn spi_mbr(kernel_hz: u32, limit_hz: u32) -> u8 {
    let mut mbr = 0;
    while mbr < 8 {
        if kernel_hz >> (mbr + 1) <= limit_hz {
            return mbr;
        }
        mbr += 1;
    }
    panic!("SPI kernel clock too fast for this limit");
}

/// How long one DAC word may be on its way, in microseconds, before the DACs are reset.
pub const DAC_DEADLINE_US: u32 = 1_000;

// --- USART3: second link -------------------------------------------------------------------------

/// Baud rate of the virtual COM port.
pub const USART_BAUD: u32 = 2_000_000;
/// [`usart_brr`] of USART3.
pub const USART3_BRR: u16 = usart_brr(APB_HZ, USART_BAUD);

/// USART_BRR with 16 samples a bit (section 48.5.7), rounded to the nearest.
///
/// # Panics
/// Where the rate is out of the part's reach or off by more than 0.5 %.
#[must_use]
pub const fn usart_brr(kernel_hz: u32, baud: u32) -> u16 {
    let divider = (kernel_hz + baud / 2) / baud;
    assert!(divider >= 16 && divider <= 0xFFFF, "baud rate out of reach");
    let real = kernel_hz / divider;
    assert!(
        real.abs_diff(baud) <= baud / 200,
        "baud rate off by more than 0.5 %"
    );
    divider as u16
}

// --- Timers and watchdog -------------------------------------------------------------------------

/// Counting rate of TIM2, the board's clock, in hertz: one count is a microsecond.
pub const TIMESTAMP_HZ: u32 = 1_000_000;
/// PSC of TIM2.
pub const TIM2_PSC: u16 = timer_psc(TIMER_HZ, TIMESTAMP_HZ);
/// Rate of the supervisor in hertz.
pub const TICK_HZ: u32 = 1_000;
/// Reload of SysTick, which counts core clocks.
pub const SYSTICK_RELOAD: u32 = CORE_HZ / TICK_HZ - 1;
const _: () = assert!(SYSTICK_RELOAD <= 0xFF_FFFF);

/// PSC of a timer: divides exactly or not at all.
///
/// # Panics
/// Where the division isn't whole or does not fit.
#[must_use]
pub const fn timer_psc(timer_hz: u32, count_hz: u32) -> u16 {
    assert!(
        timer_hz.is_multiple_of(count_hz),
        "timer clock is not a multiple"
    );
    let divider = timer_hz / count_hz;
    assert!(
        divider >= 1 && divider <= 65_536,
        "timer prescaler is 16 bits"
    );
    (divider - 1) as u16
}

/// Time from the last feed of the watchdog to its reset, in milliseconds, nominal.
pub const WATCHDOG_MS: u32 = 50;
/// The watchdog is fed this often, in milliseconds, if every part has checked in.
pub const WATCHDOG_FEED_MS: u32 = 10;
const _: () = assert!(WATCHDOG_FEED_MS * 3 <= WATCHDOG_MS);
/// PR of the watchdog: LSI / 4.
pub const IWDG_PR: u8 = 0;
/// RLR of the watchdog.
pub const IWDG_RLR: u16 = iwdg_rlr(LSI_HZ, IWDG_PR, WATCHDOG_MS);

/// RLR of the independent watchdog (section 45.4.3).
///
/// # Panics
/// Where the time does not fit its 12 bits.
#[must_use]
pub const fn iwdg_rlr(lsi_hz: u32, pr: u8, timeout_ms: u32) -> u16 {
    let counts = lsi_hz / (4 << pr) * timeout_ms / 1_000;
    assert!(counts >= 1 && counts <= 4_096, "watchdog time out of range");
    (counts - 1) as u16
}

// --- Interrupt priorities ------------------------------------------------------------------------

/// Interrupt priorities, 0 the most urgent. The part implements the upper four bits of each.
///
/// | level | interrupts | why |
/// | --- | --- | --- |
/// | [`SAMPLE_PATH`](priority::SAMPLE_PATH) | EXTI0 to 4, EXTI9_5, I2C1_EV, I2C1_ER, TIM2, SPI1, SysTick | one level: none preempts another, so the bus scheduler and the DAC queue need no locks among them. The longest takes about 2 us, which is also the largest error of a DRDY timestamp |
/// | [`LINKS`](priority::LINKS) | DMA1_STR0 (USART3 sends), OTG_FS (wakes the loop, touches no register of the core) | late by 10 us costs nothing: the queues hold 40 ms |
/// | thread | the superloop | everything else |
pub mod priority {
    /// DRDY, I2C, SPI, tick.
    pub const SAMPLE_PATH: u8 = 0x10;
    /// Telemetry.
    pub const LINKS: u8 = 0x40;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_silicon_gets_the_read_fix_and_no_trbuff() {
        for (rev_id, old) in [
            (0x1001, true),
            (0x1003, true),
            (0x2001, false),
            (0x2003, false),
        ] {
            assert_eq!(has_axi_read_defect(rev_id), old, "{rev_id:#x}");
            assert_eq!(dma_trbuff(rev_id) == 0, old, "{rev_id:#x}");
        }
    }

    #[test]
    fn the_tree_is_what_the_docs_say() {
        assert_eq!(PLL1.p_hz, 400_000_000);
        assert_eq!(PLL1.q_hz, 100_000_000);
        assert_eq!((PLL1.input_range, PLL1.medium_vco), (2, false));
        assert_eq!(
            (AHB_HZ, APB_HZ, TIMER_HZ),
            (200_000_000, 100_000_000, 200_000_000)
        );
        assert_eq!(FLASH_LATENCY, (2, 2));
    }

    #[test]
    fn forbidden_dividers_are_caught() {
        // Odd DIVP1, reference too slow, VCO too fast, DIVN too small.
        for (m, n, p, q) in [
            (2, 200, 3, 8),
            (16, 400, 2, 8),
            (2, 210, 2, 8),
            (1, 3, 2, 8),
            (0, 200, 2, 8),
        ] {
            let attempt = std::panic::catch_unwind(|| Pll::new(HSE_HZ, m, n, p, q));
            assert!(attempt.is_err(), "{m} {n} {p} {q}");
        }
        assert!(std::panic::catch_unwind(|| flash_latency(240_000_000)).is_err());
    }

    /// The fields of TIMINGR, in nanoseconds: SCL low, SCL high, SCLDEL, SDADEL.
    fn times(kernel_hz: u32, timingr: u32) -> [u32; 4] {
        let step = 1_000_000_000 / kernel_hz * ((timingr >> 28) + 1);
        [
            ((timingr & 0xFF) + 1) * step,
            (((timingr >> 8) & 0xFF) + 1) * step,
            (((timingr >> 20) & 0xF) + 1) * step,
            ((timingr >> 16) & 0xF) * step,
        ]
    }

    #[test]
    fn i2c_timing_meets_fast_mode_at_many_clocks_and_edges() {
        for kernel in [25_000_000, 50_000_000, 64_000_000, 100_000_000, 125_000_000] {
            for rise in [20, 100, 190, 300] {
                for fall in [10, 20, 100] {
                    let value = i2c_timingr(kernel, 400_000, rise, fall);
                    let [low, high, setup, hold] = times(kernel, value);
                    // The least that the controller adds to each phase: filter and two clocks.
                    let sync = 50 + 2 * (1_000_000_000 / kernel);
                    let (low, high) = (low + sync, high + sync);
                    assert!(low >= 1_300, "{kernel} {rise} {fall}: low {low}");
                    assert!(high >= 600, "{kernel} {rise} {fall}: high {high}");
                    assert!(low + high >= 2_500, "{kernel}: faster than 400 kHz");
                    assert!(
                        setup >= rise + 100,
                        "{kernel} {rise} {fall}: set-up {setup}"
                    );
                    assert!(
                        hold + rise + 260 <= 900,
                        "{kernel} {rise} {fall}: valid {hold}"
                    );
                    let hz = i2c_hz(kernel, value, rise, fall);
                    assert!((300_000..=400_000).contains(&hz), "{kernel}: {hz}");
                }
            }
        }
    }

    #[test]
    fn the_bus_runs_at_355_khz() {
        let hz = i2c_hz(APB_HZ, I2C_TIMINGR, I2C_RISE_NS, I2C_FALL_NS);
        assert!((350_000..360_000).contains(&hz), "{hz}");
        // 54 clocks of a sample fit the deadline with time to spare.
        assert!(3 * 54 * 1_000_000 / hz <= 2 * I2C_DEADLINE_US);
    }

    #[test]
    fn a_bus_beyond_fast_mode_is_refused() {
        assert!(std::panic::catch_unwind(|| i2c_timingr(100_000_000, 700_000, 100, 10)).is_err());
    }

    #[test]
    fn spi_is_the_fastest_within_the_limit() {
        assert_eq!(SPI1_KERNEL_HZ >> (SPI1_MBR + 1), 12_500_000);
        for limit in [500_000, 12_500_000, 20_000_000, 50_000_000] {
            let mbr = spi_mbr(100_000_000, limit);
            assert!(100_000_000 >> (mbr + 1) <= limit);
            assert!(
                mbr == 0 || 100_000_000 >> mbr > limit,
                "a faster one would do"
            );
        }
        assert!(std::panic::catch_unwind(|| spi_mbr(200_000_000, 700_000)).is_err());
    }

    #[test]
    fn usart_timer_and_watchdog_dividers() {
        assert_eq!(USART3_BRR, 50);
        assert_eq!(usart_brr(100_000_000, 115_200), 868);
        assert!(std::panic::catch_unwind(|| usart_brr(100_000_000, 8_000_000)).is_err());
        assert_eq!(TIM2_PSC, 199);
        assert!(std::panic::catch_unwind(|| timer_psc(200_000_000, 3_000_000)).is_err());
        assert_eq!(u32::from(IWDG_RLR) + 1, 400);
        assert!(std::panic::catch_unwind(|| iwdg_rlr(32_000, 0, 600)).is_err());
    }

    #[test]
    fn priorities_use_implemented_bits_in_the_right_order() {
        assert_eq!(priority::SAMPLE_PATH & 0x0F, 0);
        assert_eq!(priority::LINKS & 0x0F, 0);
        const { assert!(priority::SAMPLE_PATH < priority::LINKS) };
    }
}
