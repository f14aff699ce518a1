// DMA request multiplexer 1 of the STM32H7 (RM0433 chapter 17): routes request lines to the streams.
//
// Renode's own looks at a channel's setting only when a request changes, so that a line that was high before the
// channel was set up is never served.

using System.Collections.Generic;
using System.Collections.ObjectModel;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: request lines by their numbers in RM0433, table 121. Outputs: channels 0 to 15.
    public class Dmamux : IDoubleWordPeripheral, IKnownSize, IGPIOReceiver, INumberedGPIOOutput
    {
        public Dmamux(IMachine machine)
        {
            var connections = new Dictionary<int, IGPIO>();
            for(var n = 0; n < Channels; n++)
            {
                connections[n] = new GPIO();
            }
            Connections = new ReadOnlyDictionary<int, IGPIO>(connections);
        }

        public void Reset()
        {
            for(var n = 0; n < Channels; n++)
            {
                configuration[n] = 0;
                Route(n);
            }
        }

        public void OnGPIO(int number, bool value)
        {
            lines[number] = value;
            for(var n = 0; n < Channels; n++)
            {
                if((configuration[n] & 127) == number)
                {
                    Route(n);
                }
            }
        }

        public uint ReadDoubleWord(long offset)
        {
            return offset < 4 * Channels ? configuration[offset / 4] : 0;
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            if(offset < 4 * Channels)
            {
                configuration[offset / 4] = value;
                if((value & 0x10300) != 0)
                {
                    this.Log(LogLevel.Warning, "synchronisation and events are not modelled");
                }
                Route((int)offset / 4);
            }
            else if(offset != 0x84 && offset != 0x144)
            {
                this.Log(LogLevel.Warning, "unhandled write at offset 0x{0:X}, value 0x{1:X}", offset, value);
            }
        }

        public long Size { get { return 0x400; } }

        public IReadOnlyDictionary<int, IGPIO> Connections { get; private set; }

        private void Route(int channel)
        {
            // Request 0 is "none".
            var line = configuration[channel] & 127;
            Connections[channel].Set(line != 0 && lines[line]);
        }

        private readonly uint[] configuration = new uint[Channels];
        private readonly bool[] lines = new bool[128];

        private const int Channels = 16;
    }
}
