// Power control of the STM32H7 (RM0433 chapter 6): voltage scaling with its two ready flags.
//
// Renode's platform has a tag here whose ACTVOSRDY reads 0, so a wait for it never ends.

using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Pwr : BasicDoubleWordPeripheral, IKnownSize
    {
        public Pwr(IMachine machine) : base(machine)
        {
            time = new VirtualTime(machine);
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            actualScale = Scale3;
            supplyWritten = false;
            change++;
        }

        public long Size { get { return 0x400; } }

        private bool IsSettled { get { return actualScale == scale.Value; } }

        private void DefineRegisters()
        {
            Registers.CR1.Define(this, 0xF000C000)
                .WithFlag(0, name: "LPDS")
                .WithReservedBits(1, 3)
                .WithFlag(4, name: "PVDE")
                .WithValueField(5, 3, name: "PLS")
                .WithFlag(8, name: "DBP")
                .WithFlag(9, name: "FLPS")
                .WithReservedBits(10, 4)
                .WithValueField(14, 2, name: "SVOS")
                .WithFlag(16, name: "AVDEN")
                .WithValueField(17, 2, name: "ALS")
                .WithReservedBits(19, 13);
            Registers.CSR1.Define(this)
                .WithTaggedFlag("PVDO", 4)
                // Before the supply is configured ACTVOSRDY stays 0 (RM0433 6.4.1, "Run* mode").
                .WithFlag(13, FieldMode.Read, valueProviderCallback: _ => IsSettled && supplyWritten, name: "ACTVOSRDY")
                .WithValueField(14, 2, FieldMode.Read, valueProviderCallback: _ => actualScale, name: "ACTVOS")
                .WithTaggedFlag("AVDO", 16);
            Registers.CR2.Define(this)
                .WithFlag(0, name: "BREN")
                .WithFlag(4, name: "MONEN")
                .WithTaggedFlag("BRRDY", 16)
                .WithTag("VBATL, VBATH, TEMPL, TEMPH", 20, 4);
            Registers.CR3.Define(this, 0x6)
                .WithFlag(0, out bypass, writeCallback: (before, _) => KeepOnceWritten(bypass, before), name: "BYPASS")
                .WithFlag(1, out ldo, writeCallback: (before, _) => KeepOnceWritten(ldo, before), name: "LDOEN")
                .WithFlag(2, out supply, writeCallback: (before, _) => KeepOnceWritten(supply, before), name: "SCUEN")
                .WithReservedBits(3, 5)
                .WithFlag(8, name: "VBE")
                .WithFlag(9, name: "VBRS")
                .WithReservedBits(10, 14)
                .WithFlag(24, out usbDetector, name: "USB33DEN")
                .WithFlag(25, name: "USBREGEN")
                // VDD33USB is supplied.
                .WithFlag(26, FieldMode.Read, valueProviderCallback: _ => usbDetector.Value, name: "USB33RDY")
                .WithReservedBits(27, 5)
                .WithWriteCallback((_, __) => supplyWritten = true);
            Registers.CPUCR.Define(this)
                .WithFlag(0, name: "PDDS_D1")
                .WithFlag(1, name: "PDDS_D2")
                .WithFlag(2, name: "PDDS_D3")
                .WithTag("STOPF, SBF, SBF_D1, SBF_D2", 5, 4)
                .WithFlag(9, name: "CSSF")
                .WithFlag(11, name: "RUN_D3");
            Registers.D3CR.Define(this, Scale3 << 14)
                .WithFlag(13, FieldMode.Read, valueProviderCallback: _ => IsSettled, name: "VOSRDY")
                .WithValueField(14, 2, out scale, writeCallback: (_, __) => Settle(), name: "VOS");
            Registers.WKUPCR.Define(this)
                .WithValueField(0, 6, FieldMode.Write, name: "WKUPC");
            Registers.WKUPFR.Define(this)
                .WithTag("WKUPF", 0, 6);
            Registers.WKUPEPR.Define(this)
                .WithValueField(0, 6, name: "WKUPEN")
                .WithValueField(8, 6, name: "WKUPP")
                .WithValueField(16, 12, name: "WKUPPUPD");
        }

        /// The supply part can be written once after power-on (RM0433 6.8.4).
        private void KeepOnceWritten(IFlagRegisterField field, bool before)
        {
            if(supplyWritten)
            {
                field.Value = before;
            }
        }

        private void Settle()
        {
            var started = ++change;
            time.At(time.Now + SettleNs, delegate
            {
                if(started == change)
                {
                    actualScale = (uint)scale.Value;
                }
            });
        }

        private uint actualScale;
        private bool supplyWritten;
        private uint change;
        private IFlagRegisterField bypass;
        private IFlagRegisterField ldo;
        private IFlagRegisterField supply;
        private IFlagRegisterField usbDetector;
        private IValueRegisterField scale;

        private readonly VirtualTime time;

        private const uint Scale3 = 1;
        // Regulator settling; the data sheet gives no figure for scaling alone, 20 us is of the usual size.
        private const ulong SettleNs = 20000;

        private enum Registers
        {
            CR1 = 0x00,
            CSR1 = 0x04,
            CR2 = 0x08,
            CR3 = 0x0C,
            CPUCR = 0x10,
            D3CR = 0x18,
            WKUPCR = 0x20,
            WKUPFR = 0x24,
            WKUPEPR = 0x28,
        }
    }
}
