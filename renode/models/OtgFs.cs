// USB OTG core without a cable (RM0433 chapter 57): resets, reports its version, detects no session.
//
// Renode has a tag here. No host ever enumerates the board in this emulation; the registers answer so that the
// firmware's USB stack comes up and waits.

using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class OtgFs : IDoubleWordPeripheral, IKnownSize
    {
        public OtgFs(IMachine machine)
        {
            Reset();
        }

        public void Reset()
        {
            registers.Clear();
        }

        public uint ReadDoubleWord(long offset)
        {
            uint value;
            registers.TryGetValue(offset, out value);
            switch(offset)
            {
            case 0x010:
                // GRSTCTL: the AHB master is idle, resets and flushes are over at once.
                return value & ~0x3Fu | 1u << 31;
            case 0x014:
                // GINTSTS: device mode, nothing pending.
                return 0x04000020;
            case 0x03C:
                // CID: the core's version.
                return 0x00002300;
            case 0x808:
                // DSTS: full speed by the internal PHY.
                return 3u << 1;
            default:
                return value;
            }
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            registers[offset] = value;
        }

        public long Size { get { return 0x40000; } }

        private readonly Dictionary<long, uint> registers = new Dictionary<long, uint>();
    }
}
