// TI TCA9548A, eight-channel I2C multiplexer: one control byte, channels that switch at the STOP, a reset pin.
//
// Renode's own PCA9548 stores the mask and routes nothing.

using System.Collections.Generic;
using System.Linq;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Channels are attached by their numbers, 0 to 7, and chips to the channels.
    /// Inputs: 0 RESET (active low), 1 SCL as the core's pad shows it, for a core that clocks the bus by hand.
    public class Tca9548a : SimpleContainer<I2cSegment>, II2cChip, II2cSwitch, IGPIOReceiver
    {
        /// `port`, `sda`: the pad that a stuck line holds low.
        public Tca9548a(IMachine machine, GpioPort port, int sda) : base(machine)
        {
            this.port = port;
            this.sda = sda;
        }

        /// A reset of the board reaches this part through its pin only.
        public override void Reset()
        {
        }

        public void OnGPIO(int number, bool value)
        {
            if(number == 0)
            {
                if(!value)
                {
                    mask = 0;
                    written = null;
                    LetGo();
                }
                inReset = !value;
            }
            else if(number == 1 && !value && HoldsBus && !shorted && ++clocks >= 9)
            {
                LetGo();
            }
        }

        /// SDA is held low until SCL was clocked nine times, or RESET pulled; `forever`: as a short to ground would.
        public void HoldSda(bool forever = false)
        {
            HoldsBus = true;
            shorted = forever;
            clocks = 0;
            port.Drive(sda, false);
        }

        public bool HoldsBus { get; private set; }

        public IEnumerable<I2cSegment> Connected
        {
            get
            {
                return inReset || Silent ? Enumerable.Empty<I2cSegment>()
                    : ChildCollection.Where(channel => (mask >> channel.Key & 1) != 0).Select(channel => channel.Value);
            }
        }

        public bool Start(bool read)
        {
            return !inReset && !Silent;
        }

        public bool WriteByte(byte value)
        {
            written = value;
            return true;
        }

        /// The last byte written, which the STOP puts in force.
        public byte ReadByte()
        {
            return written ?? mask;
        }

        public void Stop()
        {
            if(written != null)
            {
                mask = written.Value;
                written = null;
            }
        }

        public void Write(byte[] data)
        {
            I2cBlocks.Write(this, data);
        }

        public byte[] Read(int count)
        {
            return I2cBlocks.Read(this, count);
        }

        public void FinishTransmission()
        {
            Stop();
        }

        /// Without supply: no acknowledge, here or behind.
        public bool Silent { get; set; }

        /// Channels in force, bit n for channel n.
        public byte Mask { get { return mask; } }

        private void LetGo()
        {
            if(HoldsBus && !shorted)
            {
                HoldsBus = false;
                port.Release(sda);
            }
        }

        private byte mask;
        private byte? written;
        private bool inReset;
        private bool shorted;
        private int clocks;

        private readonly int sda;
        private readonly GpioPort port;
    }
}
