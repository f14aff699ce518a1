// Power control of the STM32H7 (RM0433 chapter 6): voltage scaling with its two ready flags.
//
// Renode's platform has a tag here whose ACTVOSRDY reads 0, so a wait for it never ends.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Pwr : RegisterBlock
    {
        public Pwr(IMachine machine)
        {
            time = new VirtualTime(machine);
            // CR1, CR2, CPUCR, WKUPEPR.
            Keep(0x00, 0xF000C000);
            Keep(0x08);
            Keep(0x10);
            Keep(0x28);
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            control3 = 0x6;
            d3Control = Scale3;
            actualScale = Scale3;
            supplyWritten = false;
            change++;
        }

        protected override uint? Read(long offset)
        {
            var ready = actualScale == (d3Control & ScaleMask);
            switch(offset)
            {
            case 0x04:
                // Before the supply is configured ACTVOSRDY stays 0 (RM0433 6.4.1, "Run* mode").
                return actualScale | (ready && supplyWritten ? ReadyBit : 0);
            case 0x0C:
                // VDD33USB is supplied: USB33RDY follows USB33DEN.
                return control3 & ~(1u << 26) | (control3 & 1u << 24) << 2;
            case 0x18:
                return d3Control | (ready ? ReadyBit : 0);
            case 0x20:
            case 0x24:
                return 0;
            default:
                return null;
            }
        }

        protected override bool Write(long offset, uint value)
        {
            switch(offset)
            {
            case 0x0C:
                // The supply part can be written once after power-on (RM0433 6.8.4).
                control3 = supplyWritten ? control3 & 7 | value & ~7u : value;
                supplyWritten = true;
                break;
            case 0x18:
                d3Control = value & ScaleMask;
                var started = ++change;
                time.At(time.Now + SettleNs, delegate
                {
                    if(started == change)
                    {
                        actualScale = d3Control;
                    }
                });
                break;
            case 0x20:
                break;
            default:
                return false;
            }
            return true;
        }

        private uint control3;
        private uint d3Control;
        private uint actualScale;
        private bool supplyWritten;
        private uint change;

        private readonly VirtualTime time;

        private const uint ScaleMask = 3u << 14;
        private const uint Scale3 = 1u << 14;
        private const uint ReadyBit = 1u << 13;
        // Regulator settling; the data sheet gives no figure for scaling alone, 20 us is of the usual size.
        private const ulong SettleNs = 20000;
    }
}
