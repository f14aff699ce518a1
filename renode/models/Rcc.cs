// Reset and clock control of the STM32H7 (RM0433 chapter 8): a clock tree that is computed from what the
// firmware writes, ready flags that take their time, and the cause of the last reset.
//
// In Renode's own model the PLL registers and the enable bits read 0 and clocks change nothing.

using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.Timers;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Rcc : BasicDoubleWordPeripheral, IKnownSize
    {
        /// `hseHz`: what the board feeds into OSC_IN. `timer`: a timer of APB1 that follows the tree.
        public Rcc(IMachine machine, long hseHz, LimitTimer timer) : base(machine)
        {
            this.timer = timer;
            time = new VirtualTime(machine);
            hse.Hz = hseHz;
            for(var n = 0; n < 3; n++)
            {
                plls[n] = new Pll();
            }
            switchable = new[] { hsi, csi, hse, plls[0].Clock };
            resetFlags = PowerOnFlags;
            DefineRegisters();
            Reset();
        }

        /// Called for power-on, and for every reset of the machine afterwards. The source of a reset calls
        /// `NoteCause` before; without that call the core is the source (SYSRESETREQ).
        public override void Reset()
        {
            base.Reset();
            foreach(var source in new[] { hsi, csi, hsi48, hse, plls[0].Clock, plls[1].Clock, plls[2].Clock })
            {
                source.On = source.Ready = source == hsi;
            }
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

        public override void WriteDoubleWord(long offset, uint value)
        {
            base.WriteDoubleWord(offset, value);
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
                    return csi.Hz;
                case 2:
                    return hse.Hz;
                case 3:
                    return PllHz(1, 'P');
                default:
                    return hsi.Hz;
                }
            }
        }

        /// Core clock in Hz.
        public long CoreHz { get { return SystemHz / Ahb(coreDivider.Value); } }

        /// AHB clock in Hz.
        public long AhbHz { get { return CoreHz / Ahb(ahbDivider.Value); } }

        /// APB1 clock in Hz.
        public long Apb1Hz { get { return AhbHz / Apb(apb1Divider.Value); } }

        /// Clock of the timers on APB1 in Hz (RM0433 8.5.9, TIMPRE).
        public long Timer1Hz
        {
            get
            {
                var divider = Apb(apb1Divider.Value);
                var factor = timerFactor.Value ? 4 : 2;
                return divider <= factor ? AhbHz : Apb1Hz * factor;
            }
        }

        /// Kernel clock of I2C1, 2, 3 in Hz.
        public long I2c123Hz
        {
            get
            {
                switch(i2c123Select.Value)
                {
                case 0:
                    return Apb1Hz;
                case 1:
                    return PllHz(3, 'R');
                case 2:
                    return hsi.Hz;
                default:
                    return csi.Hz;
                }
            }
        }

        /// Kernel clock of SPI1, 2, 3 in Hz.
        public long Spi123Hz
        {
            get
            {
                switch(spi123Select.Value)
                {
                case 0:
                    return PllHz(1, 'Q');
                case 1:
                    return PllHz(2, 'P');
                case 2:
                    return PllHz(3, 'P');
                case 4:
                    return PerHz();
                default:
                    return 0;
                }
            }
        }

        /// Kernel clock of USART2, 3, 4, 5, 7, 8 in Hz.
        public long Usart234578Hz
        {
            get
            {
                switch(usart234578Select.Value)
                {
                case 0:
                    return Apb1Hz;
                case 1:
                    return PllHz(2, 'Q');
                case 2:
                    return PllHz(3, 'Q');
                case 3:
                    return hsi.Hz;
                case 4:
                    return csi.Hz;
                default:
                    return 32768;
                }
            }
        }

        /// RCC_RSR, for suites.
        public uint ResetFlags { get { return resetFlags; } }

        private void DefineRegisters()
        {
            var control = Registers.CR.Define(this, 0x1)
                .WithFlag(1, name: "HSIKERON")
                .WithValueField(3, 2, name: "HSIDIV")
                .WithTaggedFlag("HSIDIVF", 5)
                .WithFlag(9, name: "CSIKERON")
                .WithFlag(14, FieldMode.Read, valueProviderCallback: _ => true, name: "D1CKRDY")
                .WithFlag(15, FieldMode.Read, valueProviderCallback: _ => true, name: "D2CKRDY")
                .WithFlag(18, name: "HSEBYP")
                .WithFlag(19, name: "HSECSSON");
            DefineSource(control, hsi, 0, 2, "HSI");
            DefineSource(control, csi, 7, 8, "CSI");
            DefineSource(control, hsi48, 12, 13, "HSI48");
            DefineSource(control, hse, 16, 17, "HSE");
            for(var n = 0; n < 3; n++)
            {
                DefineSource(control, plls[n].Clock, 24 + 2 * n, 25 + 2 * n, "PLL" + (n + 1));
            }
            Registers.HSICFGR.Define(this, 0x40000000)
                .WithValueField(0, 32, name: "HSICAL, HSITRIM");
            Registers.CRRCR.Define(this)
                .WithTag("HSI48CAL", 0, 10);
            Registers.CSICFGR.Define(this, 0x20000000)
                .WithValueField(0, 32, name: "CSICAL, CSITRIM");
            Registers.CFGR.Define(this)
                .WithValueField(0, 3, out switchRequest, name: "SW")
                .WithValueField(3, 3, FieldMode.Read, valueProviderCallback: _ => SwitchStatus(), name: "SWS")
                .WithFlag(6, name: "STOPWUCK")
                .WithFlag(7, name: "STOPKERWUCK")
                .WithValueField(8, 6, name: "RTCPRE")
                .WithFlag(14, name: "HRTIMSEL")
                .WithFlag(15, out timerFactor, name: "TIMPRE")
                .WithValueField(18, 4, name: "MCO1PRE")
                .WithValueField(22, 3, name: "MCO1")
                .WithValueField(25, 4, name: "MCO2PRE")
                .WithValueField(29, 3, name: "MCO2");
            Registers.D1CFGR.Define(this)
                .WithValueField(0, 4, out ahbDivider, name: "HPRE")
                .WithValueField(4, 3, name: "D1PPRE")
                .WithValueField(8, 4, out coreDivider, name: "D1CPRE");
            Registers.D2CFGR.Define(this)
                .WithValueField(4, 3, out apb1Divider, name: "D2PPRE1")
                .WithValueField(8, 3, name: "D2PPRE2");
            Registers.D3CFGR.Define(this)
                .WithValueField(4, 3, name: "D3PPRE");
            DefinePlls();
            DefineKernelClocks();
            Registers.CIER.Define(this)
                .WithValueField(0, 10, name: "LSIRDYIE to LSECSSIE");
            Registers.CIFR.Define(this)
                .WithTag("LSIRDYF to HSECSSF", 0, 11);
            Registers.CICR.Define(this)
                .WithValueField(0, 11, FieldMode.Write, name: "LSIRDYC to HSECSSC");
            Registers.BDCR.Define(this)
                .WithValueField(0, 32, name: "LSEON to BDRST");
            Registers.CSR.Define(this)
                .WithFlag(0, out lsi, name: "LSION")
                .WithFlag(1, FieldMode.Read, valueProviderCallback: _ => lsi.Value, name: "LSIRDY");
            foreach(var register in new[] { Registers.AHB3RSTR, Registers.AHB1RSTR, Registers.AHB2RSTR, Registers.AHB4RSTR,
                Registers.APB3RSTR, Registers.APB1LRSTR, Registers.APB1HRSTR, Registers.APB2RSTR, Registers.APB4RSTR })
            {
                register.Define(this).WithValueField(0, 32, name: register.ToString());
            }
            Registers.GCR.Define(this)
                .WithFlag(0, name: "WW1RSC");
            Registers.D3AMR.Define(this)
                .WithValueField(0, 32, name: "D3AMR");
            // The first core sees the reset status, the enable bits and the low-power enable bits at a second place.
            var status = Registers.RSR.Define(this)
                .WithFlag(16, FieldMode.Write, writeCallback: (_, remove) => resetFlags = remove ? 0 : resetFlags, name: "RMVF")
                .WithValueField(17, 15, FieldMode.Read, valueProviderCallback: _ => resetFlags >> 17, name: "CPURSTF to LPWRRSTF");
            Registers.C1_RSR.Bind(this, status);
            foreach(var register in new[] { Registers.AHB3ENR, Registers.AHB1ENR, Registers.AHB2ENR, Registers.AHB4ENR,
                Registers.APB3ENR, Registers.APB1LENR, Registers.APB1HENR, Registers.APB2ENR, Registers.APB4ENR })
            {
                DefineTwice(register, Registers.C1_RSR - Registers.RSR, register == Registers.APB4ENR ? 0x00010000 : 0u);
            }
            foreach(var register in new[] { Registers.AHB3LPENR, Registers.AHB1LPENR, Registers.AHB2LPENR, Registers.AHB4LPENR,
                Registers.APB3LPENR, Registers.APB1LLPENR, Registers.APB1HLPENR, Registers.APB2LPENR, Registers.APB4LPENR })
            {
                DefineTwice(register, Registers.C1_AHB3LPENR - Registers.AHB3LPENR, uint.MaxValue);
            }
        }

        private void DefineSource(DoubleWordRegister control, Source source, int enable, int ready, string name)
        {
            control.DefineFlagField(enable, changeCallback: (_, on) => Switch(source, on), name: name + "ON");
            control.DefineFlagField(ready, FieldMode.Read, valueProviderCallback: _ => source.Ready, name: name + "RDY");
        }

        private void DefinePlls()
        {
            Registers.PLLCKSELR.Define(this, 0x02020200)
                .WithValueField(0, 2, out pllSource, name: "PLLSRC")
                .WithValueField(4, 6, out plls[0].M, name: "DIVM1")
                .WithValueField(12, 6, out plls[1].M, name: "DIVM2")
                .WithValueField(20, 6, out plls[2].M, name: "DIVM3");
            Registers.PLLCFGR.Define(this, 0x01FF0000)
                .WithFlag(0, out plls[0].HasFraction, name: "PLL1FRACEN")
                .WithValueField(1, 3, name: "PLL1VCOSEL, PLL1RGE")
                .WithFlag(4, out plls[1].HasFraction, name: "PLL2FRACEN")
                .WithValueField(5, 3, name: "PLL2VCOSEL, PLL2RGE")
                .WithFlag(8, out plls[2].HasFraction, name: "PLL3FRACEN")
                .WithValueField(9, 3, name: "PLL3VCOSEL, PLL3RGE")
                .WithValueField(16, 9, name: "DIVP1EN to DIVR3EN");
            for(var n = 0; n < 3; n++)
            {
                var pll = plls[n];
                ((Registers)((long)Registers.PLL1DIVR + 8 * n)).Define(this, 0x01010280)
                    .WithValueField(0, 9, out pll.N, name: "DIVN")
                    .WithValueField(9, 7, out pll.P, name: "DIVP")
                    .WithValueField(16, 7, out pll.Q, name: "DIVQ")
                    .WithValueField(24, 7, out pll.R, name: "DIVR");
                ((Registers)((long)Registers.PLL1FRACR + 8 * n)).Define(this)
                    .WithValueField(3, 13, out pll.Fraction, name: "FRACN");
            }
        }

        private void DefineKernelClocks()
        {
            Registers.D1CCIPR.Define(this)
                .WithValueField(0, 2, name: "FMCSEL")
                .WithValueField(4, 2, name: "QSPISEL")
                .WithFlag(16, name: "SDMMCSEL")
                .WithValueField(28, 2, out perSelect, name: "CKPERSEL");
            Registers.D2CCIP1R.Define(this)
                .WithValueField(0, 3, name: "SAI1SEL")
                .WithValueField(6, 3, name: "SAI23SEL")
                .WithValueField(12, 3, out spi123Select, name: "SPI123SEL")
                .WithValueField(16, 3, name: "SPI45SEL")
                .WithValueField(20, 2, name: "SPDIFSEL")
                .WithFlag(24, name: "DFSDM1SEL")
                .WithValueField(28, 2, name: "FDCANSEL")
                .WithFlag(31, name: "SWPSEL");
            Registers.D2CCIP2R.Define(this)
                .WithValueField(0, 3, out usart234578Select, name: "USART234578SEL")
                .WithValueField(3, 3, name: "USART16SEL")
                .WithValueField(8, 2, name: "RNGSEL")
                .WithValueField(12, 2, out i2c123Select, name: "I2C123SEL")
                .WithValueField(20, 2, name: "USBSEL")
                .WithValueField(22, 2, name: "CECSEL")
                .WithValueField(28, 3, name: "LPTIM1SEL");
            Registers.D3CCIPR.Define(this)
                .WithValueField(0, 3, name: "LPUART1SEL")
                .WithValueField(8, 2, name: "I2C4SEL")
                .WithValueField(10, 3, name: "LPTIM2SEL")
                .WithValueField(13, 3, name: "LPTIM345SEL")
                .WithValueField(16, 2, name: "ADCSEL")
                .WithValueField(21, 3, name: "SAI4ASEL")
                .WithValueField(24, 3, name: "SAI4BSEL")
                .WithValueField(28, 3, name: "SPI6SEL");
        }

        private void DefineTwice(Registers at, long apart, uint afterReset)
        {
            var register = at.Define(this, afterReset).WithValueField(0, 32, name: at.ToString());
            ((Registers)((long)at + apart)).Bind(this, register);
        }

        private void Switch(Source source, bool on)
        {
            source.On = on;
            if(!on)
            {
                source.Ready = false;
                return;
            }
            var started = epoch;
            time.At(time.Now + source.StartNs, delegate
            {
                if(started == epoch && source.On)
                {
                    source.Ready = true;
                    FollowTree();
                }
            });
        }

        /// The source in force: the switch waits for a source that is ready.
        private uint SwitchStatus()
        {
            var requested = (uint)switchRequest.Value;
            if(requested < switchable.Length && switchable[requested].Ready)
            {
                selected = requested;
            }
            return selected;
        }

        private long PllHz(int number, char output)
        {
            long source;
            switch(pllSource.Value)
            {
            case 0:
                source = hsi.Hz;
                break;
            case 1:
                source = csi.Hz;
                break;
            case 2:
                source = hse.Hz;
                break;
            default:
                return 0;
            }
            var pll = plls[number - 1];
            var m = (long)pll.M.Value;
            if(!pll.Clock.Ready || m == 0)
            {
                return 0;
            }
            var fraction = pll.HasFraction.Value ? (long)pll.Fraction.Value : 0;
            var vco = source / m * (((long)pll.N.Value + 1) * 8192L + fraction) / 8192L;
            var divider = output == 'P' ? pll.P : output == 'Q' ? pll.Q : pll.R;
            return vco / ((long)divider.Value + 1);
        }

        private long PerHz()
        {
            switch(perSelect.Value)
            {
            case 0:
                return hsi.Hz;
            case 1:
                return csi.Hz;
            default:
                return hse.Hz;
            }
        }

        private static long Ahb(ulong code)
        {
            return code < 8 ? 1 : code < 12 ? 2L << (int)(code - 8) : 64L << (int)(code - 12);
        }

        private static long Apb(ulong code)
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

        private uint selected;
        private uint resetFlags;
        private uint pendingCause;
        private uint epoch;
        private bool running;
        private IFlagRegisterField lsi;
        private IFlagRegisterField timerFactor;
        private IValueRegisterField switchRequest;
        private IValueRegisterField ahbDivider;
        private IValueRegisterField coreDivider;
        private IValueRegisterField apb1Divider;
        private IValueRegisterField pllSource;
        private IValueRegisterField perSelect;
        private IValueRegisterField spi123Select;
        private IValueRegisterField usart234578Select;
        private IValueRegisterField i2c123Select;

        private readonly LimitTimer timer;
        private readonly VirtualTime time;
        private readonly Source hsi = new Source { Hz = 64000000, StartNs = HsiStartNs };
        private readonly Source csi = new Source { Hz = 4000000, StartNs = HsiStartNs };
        private readonly Source hsi48 = new Source { Hz = 48000000, StartNs = HsiStartNs };
        private readonly Source hse = new Source { StartNs = HseStartNs };
        private readonly Pll[] plls = new Pll[3];
        private readonly Source[] switchable;

        // Reset causes (RM0433 8.4.4, table "Reset source identification").
        private const uint PowerOnFlags = 0x00FA0000;
        private const uint SoftwareFlags = 1u << 24 | 1u << 22 | 1u << 17;
        /// IWDG1RSTF, PINRSTF, CPURSTF.
        public const uint WatchdogFlags = 1u << 26 | 1u << 22 | 1u << 17;

        // Start-up times of the data sheet's order.
        private const ulong HsiStartNs = 5000;
        private const ulong HseStartNs = 2000000;
        private const ulong PllLockNs = 50000;

        private sealed class Source
        {
            public long Hz;
            public ulong StartNs;
            public bool On;
            public bool Ready;
        }

        private sealed class Pll
        {
            public readonly Source Clock = new Source { StartNs = PllLockNs };
            public IValueRegisterField M;
            public IValueRegisterField N;
            public IValueRegisterField P;
            public IValueRegisterField Q;
            public IValueRegisterField R;
            public IValueRegisterField Fraction;
            public IFlagRegisterField HasFraction;
        }

        private enum Registers : long
        {
            CR = 0x00,
            HSICFGR = 0x04,
            CRRCR = 0x08,
            CSICFGR = 0x0C,
            CFGR = 0x10,
            D1CFGR = 0x18,
            D2CFGR = 0x1C,
            D3CFGR = 0x20,
            PLLCKSELR = 0x28,
            PLLCFGR = 0x2C,
            PLL1DIVR = 0x30,
            PLL1FRACR = 0x34,
            PLL2DIVR = 0x38,
            PLL2FRACR = 0x3C,
            PLL3DIVR = 0x40,
            PLL3FRACR = 0x44,
            D1CCIPR = 0x4C,
            D2CCIP1R = 0x50,
            D2CCIP2R = 0x54,
            D3CCIPR = 0x58,
            CIER = 0x60,
            CIFR = 0x64,
            CICR = 0x68,
            BDCR = 0x70,
            CSR = 0x74,
            AHB3RSTR = 0x7C,
            AHB1RSTR = 0x80,
            AHB2RSTR = 0x84,
            AHB4RSTR = 0x88,
            APB3RSTR = 0x8C,
            APB1LRSTR = 0x90,
            APB1HRSTR = 0x94,
            APB2RSTR = 0x98,
            APB4RSTR = 0x9C,
            GCR = 0xA0,
            D3AMR = 0xA8,
            RSR = 0xD0,
            AHB3ENR = 0xD4,
            AHB1ENR = 0xD8,
            AHB2ENR = 0xDC,
            AHB4ENR = 0xE0,
            APB3ENR = 0xE4,
            APB1LENR = 0xE8,
            APB1HENR = 0xEC,
            APB2ENR = 0xF0,
            APB4ENR = 0xF4,
            AHB3LPENR = 0xFC,
            AHB1LPENR = 0x100,
            AHB2LPENR = 0x104,
            AHB4LPENR = 0x108,
            APB3LPENR = 0x10C,
            APB1LLPENR = 0x110,
            APB1HLPENR = 0x114,
            APB2LPENR = 0x118,
            APB4LPENR = 0x11C,
            C1_RSR = 0x130,
            C1_AHB3LPENR = 0x15C,
        }
    }
}
