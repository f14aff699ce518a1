// Reset and clock control of the STM32H7 (RM0433 chapter 8): a clock tree that is computed from what the
// firmware writes, ready flags that take their time, and the cause of the last reset.
//
// In Renode's own model the PLL registers and the enable bits read 0 and clocks change nothing.

using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.Timers;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Rcc : IDoubleWordPeripheral, IKnownSize
    {
        /// `hseHz`: what the board feeds into OSC_IN. `timer`: a timer of APB1 that follows the tree.
        public Rcc(IMachine machine, long hseHz, LimitTimer timer)
        {
            this.hseHz = hseHz;
            this.timer = timer;
            time = new VirtualTime(machine);
            resetFlags = PowerOnFlags;
            Reset();
        }

        /// Called for power-on, and for every reset of the machine afterwards. The source of a reset calls
        /// `NoteCause` before; without that call the core is the source (SYSRESETREQ).
        public void Reset()
        {
            registers.Clear();
            foreach(var pair in ResetValues)
            {
                registers[pair.Key] = pair.Value;
            }
            ready = HsiOn;
            epoch++;
            if(running)
            {
                resetFlags |= pendingCause == 0 ? SoftwareFlags : pendingCause;
            }
            running = true;
            pendingCause = 0;
            FollowTree();
        }

        public void NoteCause(uint flags)
        {
            pendingCause = flags;
        }

        public uint ReadDoubleWord(long offset)
        {
            offset = Alias(offset);
            switch(offset)
            {
            case ClockControl:
                return registers[offset] | ReadyFlags();
            case ClockConfiguration:
                return registers[offset] & ~(7u << 3) | SwitchStatus() << 3;
            case ControlStatus:
                return registers[offset] & 1 | (registers[offset] & 1) << 1;
            case ResetStatus:
                return resetFlags;
            }
            uint value;
            if(!registers.TryGetValue(offset, out value))
            {
                this.Log(LogLevel.Warning, "unhandled read at offset 0x{0:X}", offset);
            }
            return value;
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            offset = Alias(offset);
            if(offset == ResetStatus)
            {
                if((value & RemoveFlags) != 0)
                {
                    resetFlags = 0;
                }
                return;
            }
            if(!registers.ContainsKey(offset))
            {
                this.Log(LogLevel.Warning, "unhandled write at offset 0x{0:X}, value 0x{1:X}", offset, value);
                return;
            }
            var before = registers[offset];
            registers[offset] = value;
            if(offset == ClockControl)
            {
                Start(before, value, HsiOn, HsiStartNs);
                Start(before, value, CsiOn, HsiStartNs);
                Start(before, value, Hsi48On, HsiStartNs);
                Start(before, value, HseOn, HseStartNs);
                Start(before, value, Pll1On, PllLockNs);
                Start(before, value, Pll1On << 2, PllLockNs);
                Start(before, value, Pll1On << 4, PllLockNs);
            }
            FollowTree();
        }

        public long Size { get { return 0x400; } }

        /// System clock in Hz (SYSCLK).
        public long SystemHz
        {
            get
            {
                switch(SwitchStatus())
                {
                case 1:
                    return CsiHz;
                case 2:
                    return hseHz;
                case 3:
                    return PllHz(1, 9);
                default:
                    return HsiHz;
                }
            }
        }

        /// Core clock in Hz.
        public long CoreHz { get { return SystemHz / Ahb(registers[D1Configuration] >> 8 & 15); } }

        /// AHB clock in Hz.
        public long AhbHz { get { return CoreHz / Ahb(registers[D1Configuration] & 15); } }

        /// APB1 clock in Hz.
        public long Apb1Hz { get { return AhbHz / Apb(registers[D2Configuration] >> 4 & 7); } }

        /// Clock of the timers on APB1 in Hz (RM0433 8.5.9, TIMPRE).
        public long Timer1Hz
        {
            get
            {
                var divider = Apb(registers[D2Configuration] >> 4 & 7);
                var factor = (registers[ClockConfiguration] >> 15 & 1) != 0 ? 4 : 2;
                return divider <= factor ? AhbHz : Apb1Hz * factor;
            }
        }

        /// Kernel clock of I2C1, 2, 3 in Hz (D2CCIP2R, I2C123SEL).
        public long I2c123Hz
        {
            get
            {
                switch(registers[D2Kernel2] >> 12 & 3)
                {
                case 0:
                    return Apb1Hz;
                case 1:
                    return PllHz(3, 24);
                case 2:
                    return HsiHz;
                default:
                    return CsiHz;
                }
            }
        }

        /// Kernel clock of SPI1, 2, 3 in Hz (D2CCIP1R, SPI123SEL).
        public long Spi123Hz
        {
            get
            {
                switch(registers[D2Kernel1] >> 12 & 7)
                {
                case 0:
                    return PllHz(1, 16);
                case 1:
                    return PllHz(2, 9);
                case 2:
                    return PllHz(3, 9);
                case 4:
                    return PerHz();
                default:
                    return 0;
                }
            }
        }

        /// Kernel clock of USART2, 3, 4, 5, 7, 8 in Hz (D2CCIP2R, USART234578SEL).
        public long Usart234578Hz
        {
            get
            {
                switch(registers[D2Kernel2] & 7)
                {
                case 0:
                    return Apb1Hz;
                case 1:
                    return PllHz(2, 16);
                case 2:
                    return PllHz(3, 16);
                case 3:
                    return HsiHz;
                case 4:
                    return CsiHz;
                default:
                    return 32768;
                }
            }
        }

        /// RCC_RSR, for suites.
        public uint ResetFlags { get { return resetFlags; } }

        private static long Alias(long offset)
        {
            // RCC_C1_xxx: the same registers as seen by the first core (RM0433 8.7.44 on).
            return offset >= 0x130 && offset <= 0x158 ? offset - 0x130 + 0xD0
                : offset >= 0x15C && offset <= 0x17C ? offset - 0x15C + 0xFC : offset;
        }

        private void Start(uint before, uint after, uint on, ulong delayNs)
        {
            if((after & on) == 0)
            {
                ready &= ~on;
            }
            else if((before & on) == 0)
            {
                var started = epoch;
                time.At(time.Now + delayNs, delegate
                {
                    if(started == epoch && (registers[ClockControl] & on) != 0)
                    {
                        ready |= on;
                        FollowTree();
                    }
                });
            }
        }

        private uint ReadyFlags()
        {
            // D1CKRDY and D2CKRDY, then each oscillator's flag beside its enable bit.
            var flags = 3u << 14;
            flags |= (ready & HsiOn) << 2;
            flags |= (ready & (CsiOn | Hsi48On | HseOn | Pll1On * 0x15)) << 1;
            return flags;
        }

        private uint SwitchStatus()
        {
            var requested = registers[ClockConfiguration] & 7;
            var source = requested == 0 ? HsiOn : requested == 1 ? CsiOn : requested == 2 ? HseOn : requested == 3 ? Pll1On : 0;
            if((ready & source) != 0)
            {
                selected = requested;
            }
            return selected;
        }

        private long PllHz(int pll, int shift)
        {
            long source;
            switch(registers[PllSource] & 3)
            {
            case 0:
                source = HsiHz;
                break;
            case 1:
                source = CsiHz;
                break;
            case 2:
                source = hseHz;
                break;
            default:
                return 0;
            }
            if((ready & Pll1On << 2 * (pll - 1)) == 0)
            {
                return 0;
            }
            var m = registers[PllSource] >> 8 * pll - 4 & 63;
            var dividers = registers[0x30 + 8 * (pll - 1)];
            var fraction = (registers[PllConfiguration] >> 4 * (pll - 1) & 1) != 0 ? registers[0x34 + 8 * (pll - 1)] >> 3 & 0x1FFF : 0;
            if(m == 0)
            {
                return 0;
            }
            var vco = source / m * (((dividers & 0x1FF) + 1) * 8192L + fraction) / 8192L;
            return vco / ((dividers >> shift & 127) + 1);
        }

        private long PerHz()
        {
            switch(registers[D1Kernel] >> 28 & 3)
            {
            case 0:
                return HsiHz;
            case 1:
                return CsiHz;
            default:
                return hseHz;
            }
        }

        private static long Ahb(uint code)
        {
            return code < 8 ? 1 : code < 12 ? 2L << (int)(code - 8) : 64L << (int)(code - 12);
        }

        private static long Apb(uint code)
        {
            return code < 4 ? 1 : 2L << (int)(code - 4);
        }

        private void FollowTree()
        {
            var hz = Timer1Hz;
            if(timer != null && hz > 0 && timer.Frequency != (ulong)hz)
            {
                timer.Frequency = (ulong)hz;
            }
        }

        private uint ready;
        private uint selected;
        private uint resetFlags;
        private uint pendingCause;
        private uint epoch;
        private bool running;

        private readonly long hseHz;
        private readonly LimitTimer timer;
        private readonly VirtualTime time;
        private readonly Dictionary<long, uint> registers = new Dictionary<long, uint>();

        private static readonly Dictionary<long, uint> ResetValues = new Dictionary<long, uint>
        {
            { 0x00, 0x00000001 }, { 0x04, 0x40000000 }, { 0x08, 0 }, { 0x0C, 0x20000000 }, { 0x10, 0 },
            { 0x18, 0 }, { 0x1C, 0 }, { 0x20, 0 }, { 0x28, 0x02020200 }, { 0x2C, 0x01FF0000 },
            { 0x30, 0x01010280 }, { 0x34, 0 }, { 0x38, 0x01010280 }, { 0x3C, 0 }, { 0x40, 0x01010280 }, { 0x44, 0 },
            { 0x4C, 0 }, { 0x50, 0 }, { 0x54, 0 }, { 0x58, 0 }, { 0x60, 0 }, { 0x64, 0 }, { 0x68, 0 }, { 0x70, 0 }, { 0x74, 0 },
            { 0x7C, 0 }, { 0x80, 0 }, { 0x84, 0 }, { 0x88, 0 }, { 0x8C, 0 }, { 0x90, 0 }, { 0x94, 0 }, { 0x98, 0 }, { 0x9C, 0 },
            { 0xA0, 0 }, { 0xA8, 0 },
            { 0xD4, 0 }, { 0xD8, 0 }, { 0xDC, 0 }, { 0xE0, 0 }, { 0xE4, 0 }, { 0xE8, 0 }, { 0xEC, 0 }, { 0xF0, 0 }, { 0xF4, 0x00010000 },
            { 0xFC, 0xFFFFFFFF }, { 0x100, 0xFFFFFFFF }, { 0x104, 0xFFFFFFFF }, { 0x108, 0xFFFFFFFF }, { 0x10C, 0xFFFFFFFF },
            { 0x110, 0xFFFFFFFF }, { 0x114, 0xFFFFFFFF }, { 0x118, 0xFFFFFFFF }, { 0x11C, 0xFFFFFFFF },
        };

        private const long ClockControl = 0x00;
        private const long ClockConfiguration = 0x10;
        private const long D1Configuration = 0x18;
        private const long D2Configuration = 0x1C;
        private const long PllSource = 0x28;
        private const long PllConfiguration = 0x2C;
        private const long D1Kernel = 0x4C;
        private const long D2Kernel1 = 0x50;
        private const long D2Kernel2 = 0x54;
        private const long ControlStatus = 0x74;
        private const long ResetStatus = 0xD0;

        private const uint HsiOn = 1u << 0;
        private const uint CsiOn = 1u << 7;
        private const uint Hsi48On = 1u << 12;
        private const uint HseOn = 1u << 16;
        private const uint Pll1On = 1u << 24;

        // Reset causes (RM0433 8.4.4, table "Reset source identification").
        private const uint RemoveFlags = 1u << 16;
        private const uint PowerOnFlags = 0x00FA0000;
        private const uint SoftwareFlags = 1u << 24 | 1u << 22 | 1u << 17;
        /// IWDG1RSTF, PINRSTF, CPURSTF.
        public const uint WatchdogFlags = 1u << 26 | 1u << 22 | 1u << 17;

        private const long HsiHz = 64000000;
        private const long CsiHz = 4000000;
        // Start-up times of the data sheet's order.
        private const ulong HsiStartNs = 5000;
        private const ulong HseStartNs = 2000000;
        private const ulong PllLockNs = 50000;
    }
}
