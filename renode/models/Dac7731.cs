// Six TI DAC7731 on one SPI, each with its select; LDAC and RST are common. Strapped to +-10 V and to mid-scale on RST.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: 0 to 5 CS of units 1 to 6 (active low), 6 LDAC (update on the rising edge), 7 RST (active low).
    public class Dac7731 : IPeripheral, ISpiTarget, IGPIOReceiver
    {
        public Dac7731(IMachine machine, Rig rig)
        {
            this.rig = rig;
            time = new VirtualTime(machine);
            for(var unit = 0; unit < Rig.Units; unit++)
            {
                shift[unit] = input[unit] = output[unit] = MidScale;
                highSelect[unit] = true;
            }
        }

        /// A reset of the board does not reach these parts: they hold their outputs.
        public void Reset()
        {
        }

        public void Frame(uint word, int bits, bool idleHigh, bool secondEdge)
        {
            clockIdlesHigh = idleHigh;
            if(idleHigh != secondEdge)
            {
                // Data changes on the rising edge, which is the one that this part samples.
                this.Log(LogLevel.Warning, "SPI mode {0}: the word is sampled on the wrong edge", (idleHigh ? 2 : 0) + (secondEdge ? 1 : 0));
                word <<= 1;
            }
            for(var unit = 0; unit < Rig.Units; unit++)
            {
                if(!highSelect[unit])
                {
                    shift[unit] = shift[unit] << bits | word;
                    shifted[unit] += bits;
                }
            }
        }

        public void OnGPIO(int number, bool value)
        {
            if(number < Rig.Units)
            {
                Select(number, value);
            }
            else if(number == 6)
            {
                if(value && !loadLevel && !inReset)
                {
                    Update();
                }
                loadLevel = value;
            }
            else
            {
                inReset = !value;
                if(inReset)
                {
                    for(var unit = 0; unit < Rig.Units; unit++)
                    {
                        input[unit] = MidScale;
                        Output(unit, MidScale);
                    }
                }
            }
        }

        /// Code at the output of `unit`, from 1.
        public uint Code(int unit)
        {
            return output[Rig.Index(unit)];
        }

        private void Select(int unit, bool high)
        {
            if(high && !highSelect[unit])
            {
                if(!clockIdlesHigh)
                {
                    // CS rises while SCLK is low: one more bit is shifted (data sheet, "Serial interface").
                    shift[unit] <<= 1;
                    shifted[unit]++;
                }
                if(shifted[unit] != 0 && shifted[unit] != 16)
                {
                    this.Log(LogLevel.Warning, "unit {0}: {1} bits between the edges of CS", unit + 1, shifted[unit]);
                }
                if(shifted[unit] != 0)
                {
                    input[unit] = shift[unit] & 0xFFFF;
                    fresh[unit] = true;
                }
            }
            else if(!high)
            {
                shifted[unit] = 0;
            }
            highSelect[unit] = high;
        }

        private void Update()
        {
            for(var unit = 0; unit < Rig.Units; unit++)
            {
                if(fresh[unit])
                {
                    fresh[unit] = false;
                    Output(unit, input[unit]);
                    rig.NoteUpdate(unit, input[unit], time.Now);
                }
            }
        }

        private void Output(int unit, uint code)
        {
            if(output[unit] != code)
            {
                output[unit] = code;
                rig.SetVolts(unit, 10.0 * ((int)code - (int)MidScale) / 32768.0, time.Now);
            }
        }

        private bool clockIdlesHigh = true;
        private bool loadLevel = true;
        private bool inReset;

        private readonly Rig rig;
        private readonly VirtualTime time;
        private readonly uint[] shift = new uint[Rig.Units];
        private readonly uint[] input = new uint[Rig.Units];
        private readonly uint[] output = new uint[Rig.Units];
        private readonly int[] shifted = new int[Rig.Units];
        private readonly bool[] highSelect = new bool[Rig.Units];
        private readonly bool[] fresh = new bool[Rig.Units];

        private const uint MidScale = 0x8000;
    }
}
