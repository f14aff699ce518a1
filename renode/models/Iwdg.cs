// Independent watchdog of the STM32H7 (RM0433 chapter 45), which reports the reset cause to the RCC.
//
// Renode's own resets the machine too, but nothing shows the firmware why it was reset.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Iwdg : RegisterBlock
    {
        public Iwdg(IMachine machine, Rcc rcc)
        {
            this.machine = machine;
            this.rcc = rcc;
            time = new VirtualTime(machine);
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            prescaler = 0;
            reload = 0xFFF;
            unlocked = false;
            started = false;
            refresh++;
        }

        protected override uint? Read(long offset)
        {
            switch(offset)
            {
            case 0x00:
                return 0;
            case 0x04:
                return prescaler;
            case 0x08:
                return reload;
            case 0x0C:
                return time.Now < updatedAt ? 3u : 0u;
            case 0x10:
                return 0xFFF;
            default:
                return null;
            }
        }

        protected override bool Write(long offset, uint value)
        {
            switch(offset)
            {
            case 0x00:
                unlocked = value == 0x5555;
                started |= value == 0xCCCC;
                if(started && (value == 0xCCCC || value == 0xAAAA))
                {
                    Refresh();
                }
                break;
            case 0x04:
            case 0x08:
                if(!unlocked)
                {
                    this.Log(LogLevel.Warning, "write at offset 0x{0:X} without the key 0x5555", offset);
                    return true;
                }
                if(offset == 4)
                {
                    prescaler = value & 7;
                }
                else
                {
                    reload = value & 0xFFF;
                }
                // The value crosses into the LSI's domain within five of its periods (RM0433 49.4.4).
                updatedAt = time.Now + 5 * LsiPeriodNs;
                break;
            default:
                return false;
            }
            return true;
        }

        private void Refresh()
        {
            var mine = ++refresh;
            var divider = 4UL << (int)(prescaler > 6 ? 6 : prescaler);
            time.At(time.Now + (reload + 1) * divider * LsiPeriodNs, delegate
            {
                if(mine != refresh || !started)
                {
                    return;
                }
                this.Log(LogLevel.Info, "watchdog expired: reset");
                rcc.NoteCause(Rcc.WatchdogFlags);
                machine.RequestReset();
            });
        }

        private uint prescaler;
        private uint reload;
        private bool unlocked;
        private bool started;
        private ulong updatedAt;
        private ulong refresh;

        private readonly IMachine machine;
        private readonly Rcc rcc;
        private readonly VirtualTime time;

        // LSI: 32 kHz.
        private const ulong LsiPeriodNs = 31250;
    }
}
