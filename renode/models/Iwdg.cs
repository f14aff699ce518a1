// Independent watchdog of the STM32H7 (RM0433 chapter 45), which reports the reset cause to the RCC.
//
// Renode's own resets the machine too, but nothing shows the firmware why it was reset.

using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Iwdg : BasicDoubleWordPeripheral, IKnownSize
    {
        public Iwdg(IMachine machine, Rcc rcc) : base(machine)
        {
            this.rcc = rcc;
            time = new VirtualTime(machine);
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            unlocked = false;
            started = false;
            refresh++;
        }

        public override void WriteDoubleWord(long offset, uint value)
        {
            if((offset == (long)Registers.PR || offset == (long)Registers.RLR) && !unlocked)
            {
                this.Log(LogLevel.Warning, "write at offset 0x{0:X} without the key 0x5555", offset);
                return;
            }
            base.WriteDoubleWord(offset, value);
        }

        public long Size { get { return 0x400; } }

        private void DefineRegisters()
        {
            Registers.KR.Define(this)
                .WithValueField(0, 16, FieldMode.Write, writeCallback: (_, value) => WriteKey((uint)value), name: "KEY");
            Registers.PR.Define(this)
                .WithValueField(0, 3, out prescaler, writeCallback: (_, __) => Cross(), name: "PR");
            Registers.RLR.Define(this, 0xFFF)
                .WithValueField(0, 12, out reload, writeCallback: (_, __) => Cross(), name: "RL");
            Registers.SR.Define(this)
                .WithFlag(0, FieldMode.Read, valueProviderCallback: _ => IsCrossing, name: "PVU")
                .WithFlag(1, FieldMode.Read, valueProviderCallback: _ => IsCrossing, name: "RVU")
                .WithTaggedFlag("WVU", 2);
            Registers.WINR.Define(this, 0xFFF)
                .WithTag("WIN", 0, 12);
        }

        private bool IsCrossing { get { return time.Now < updatedAt; } }

        /// The value crosses into the LSI's domain within five of its periods (RM0433 49.4.4).
        private void Cross()
        {
            updatedAt = time.Now + 5 * LsiPeriodNs;
        }

        private void WriteKey(uint key)
        {
            unlocked = key == 0x5555;
            started |= key == 0xCCCC;
            if(started && (key == 0xCCCC || key == 0xAAAA))
            {
                Refresh();
            }
        }

        private void Refresh()
        {
            var mine = ++refresh;
            var divider = 4UL << (int)(prescaler.Value > 6 ? 6 : prescaler.Value);
            time.At(time.Now + (reload.Value + 1) * divider * LsiPeriodNs, delegate
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

        private bool unlocked;
        private bool started;
        private ulong updatedAt;
        private ulong refresh;
        private IValueRegisterField prescaler;
        private IValueRegisterField reload;

        private readonly Rcc rcc;
        private readonly VirtualTime time;

        // LSI: 32 kHz.
        private const ulong LsiPeriodNs = 31250;

        private enum Registers
        {
            KR = 0x00,
            PR = 0x04,
            RLR = 0x08,
            SR = 0x0C,
            WINR = 0x10,
        }
    }
}
