// TI TCA9548A, eight-channel I2C multiplexer: one control byte, channels that switch at the STOP, a reset pin.
//
// Renode's own PCA9548 stores the mask and routes nothing.

using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: 0 RESET (active low), 1 SCL as the core's pad shows it, for a core that clocks the bus by hand.
    public class Tca9548a : IPeripheral, II2cTarget, IGPIOReceiver
    {
        /// `port`, `sda`: the pad that a stuck line holds low.
        public Tca9548a(IMachine machine, GpioPort port, int sda, II2cTarget channel0, II2cTarget channel1, II2cTarget channel2,
            II2cTarget channel3, II2cTarget channel4, II2cTarget channel5, int address = 0x70)
        {
            this.port = port;
            this.sda = sda;
            this.address = address;
            channels = new[] { channel0, channel1, channel2, channel3, channel4, channel5 };
        }

        /// A reset of the board reaches this part through its pin only.
        public void Reset()
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

        public bool Start(int called, bool read)
        {
            if(inReset || Silent)
            {
                return false;
            }
            forMe = called == address;
            talking.Clear();
            var answered = forMe;
            for(var n = 0; n < channels.Length; n++)
            {
                if((mask >> n & 1) != 0 && channels[n].Start(called, read))
                {
                    talking.Add(channels[n]);
                    answered = true;
                }
            }
            if(talking.Count > 1)
            {
                this.Log(LogLevel.Warning, "{0} devices answer at 0x{1:X2}: mask 0x{2:X2}", talking.Count, called, mask);
            }
            return answered;
        }

        public bool Write(byte value)
        {
            if(forMe)
            {
                written = value;
                return true;
            }
            var acknowledged = false;
            foreach(var device in talking)
            {
                acknowledged |= device.Write(value);
            }
            return acknowledged;
        }

        public byte Read()
        {
            if(forMe)
            {
                return mask;
            }
            byte wired = 0xFF;
            foreach(var device in talking)
            {
                wired &= device.Read();
            }
            return wired;
        }

        public void Stop()
        {
            foreach(var device in talking)
            {
                device.Stop();
            }
            talking.Clear();
            if(written != null)
            {
                mask = written.Value;
                written = null;
            }
            forMe = false;
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
        private bool forMe;
        private bool inReset;
        private bool shorted;
        private int clocks;

        private readonly int address;
        private readonly int sda;
        private readonly GpioPort port;
        private readonly II2cTarget[] channels;
        private readonly List<II2cTarget> talking = new List<II2cTarget>();
    }
}
