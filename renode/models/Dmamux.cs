// DMA request multiplexer 1 of the STM32H7 (RM0433 chapter 17): routes request lines to the streams.
//
// Renode's own looks at a channel's setting only when a request changes, so that a line that was high before the
// channel was set up is never served.

using System.Collections.Generic;
using System.Collections.ObjectModel;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: request lines by their numbers in RM0433, table 121. Outputs: channels 0 to 15.
    public class Dmamux : BasicDoubleWordPeripheral, IKnownSize, IGPIOReceiver, INumberedGPIOOutput
    {
        public Dmamux(IMachine machine) : base(machine)
        {
            var connections = new Dictionary<int, IGPIO>();
            for(var n = 0; n < Channels; n++)
            {
                connections[n] = new GPIO();
            }
            Connections = new ReadOnlyDictionary<int, IGPIO>(connections);
            DefineRegisters();
        }

        public override void Reset()
        {
            base.Reset();
            for(var n = 0; n < Channels; n++)
            {
                Route(n);
            }
        }

        public void OnGPIO(int number, bool value)
        {
            lines[number] = value;
            for(var n = 0; n < Channels; n++)
            {
                if((int)requests[n].Value == number)
                {
                    Route(n);
                }
            }
        }

        public long Size { get { return 0x400; } }

        public IReadOnlyDictionary<int, IGPIO> Connections { get; private set; }

        private void DefineRegisters()
        {
            Registers.C0CR.DefineMany(this, Channels, (register, n) => register
                .WithValueField(0, 7, out requests[n], name: "DMAREQ_ID")
                .WithTaggedFlag("SOIE", 8)
                .WithTaggedFlag("EGE", 9)
                .WithTaggedFlag("SE", 16)
                .WithValueField(17, 2, name: "SPOL")
                .WithValueField(19, 5, name: "NBREQ")
                .WithValueField(24, 3, name: "SYNC_ID")
                .WithWriteCallback((_, __) => Route(n)));
            Registers.CSR.Define(this)
                .WithTag("SOF", 0, 16);
            Registers.CFR.Define(this)
                .WithValueField(0, 16, FieldMode.Write, name: "CSOF");
            Registers.RG0CR.DefineMany(this, 8, (register, n) => register
                .WithTag("SIG_ID, OIE, GE, GPOL, GNBREQ", 0, 24));
            Registers.RGSR.Define(this)
                .WithTag("OF", 0, 8);
            Registers.RGCFR.Define(this)
                .WithValueField(0, 8, FieldMode.Write, name: "COF");
        }

        private void Route(int channel)
        {
            // Request 0 is "none".
            var line = requests[channel].Value;
            Connections[channel].Set(line != 0 && lines[line]);
        }

        private readonly IValueRegisterField[] requests = new IValueRegisterField[Channels];
        private readonly bool[] lines = new bool[128];

        private const int Channels = 16;

        private enum Registers
        {
            C0CR = 0x00,
            CSR = 0x80,
            CFR = 0x84,
            RG0CR = 0x100,
            RGSR = 0x140,
            RGCFR = 0x144,
        }
    }
}
