// TI DAC7731 on SPI, with a select of its own; LDAC and RST are common to six. Strapped to +-10 V and to mid-scale on RST.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: 0 CS (active low), 1 LDAC (update on the rising edge), 2 RST (active low).
    public class Dac7731 : ISpiChip, IGPIOReceiver
    {
        /// `unit` from 1.
        public Dac7731(IMachine machine, Rig rig, int unit)
        {
            this.rig = rig;
            this.unit = Rig.Index(unit);
            time = new VirtualTime(machine);
        }

        /// A reset of the board does not reach this part: it holds its output.
        public void Reset()
        {
        }

        public void Frame(uint word, int bits, bool idleHigh, bool secondEdge)
        {
            clockIdlesHigh = idleHigh;
            if(highSelect || inReset)
            {
                return;
            }
            var sent = word;
            if(idleHigh != secondEdge)
            {
                // Data changes on the rising edge, which is the one that this part samples: it sees the bit before, the first time
                // what the word before has left on the line.
                this.Log(LogLevel.Warning, "SPI mode {0}: the word is sampled on the wrong edge", (idleHigh ? 2 : 0) + (secondEdge ? 1 : 0));
                word = word >> 1 | lastBit << bits - 1;
            }
            lastBit = sent & 1;
            shift = (shift << bits | word) & 0xFFFF;
            shifted += bits;
            fresh = true;
        }

        /// Renode's interface: a byte in mode 3. SDO is not modelled.
        public byte Transmit(byte data)
        {
            Frame(data, 8, true, true);
            return 0;
        }

        public void FinishTransmission()
        {
        }

        public void OnGPIO(int number, bool value)
        {
            switch(number)
            {
            case 0:
                Select(value);
                break;
            case 1:
                if(value && !loadLevel && !inReset)
                {
                    Update();
                }
                loadLevel = value;
                break;
            case 2:
                inReset = !value;
                if(inReset)
                {
                    shift = MidScale;
                    Output(MidScale);
                }
                break;
            default:
                this.Log(LogLevel.Error, "input {0} is not there", number);
                break;
            }
        }

        /// Code at the output.
        public uint Code { get { return output; } }

        private void Select(bool high)
        {
            if(high && !highSelect)
            {
                if(!clockIdlesHigh && !inReset)
                {
                    // CS rises while SCLK is low: one more bit is shifted (data sheet, "Serial interface").
                    shift = (shift << 1 | lastBit) & 0xFFFF;
                    shifted++;
                    fresh = true;
                }
                if(shifted != 0 && shifted != 16)
                {
                    this.Log(LogLevel.Warning, "{0} bits between the edges of CS", shifted);
                }
            }
            else if(!high)
            {
                shifted = 0;
            }
            highSelect = high;
        }

        /// The output takes the shift register, also within a word.
        private void Update()
        {
            if(!highSelect && shifted % 16 != 0)
            {
                this.Log(LogLevel.Warning, "LDAC rose after {0} bits of a word", shifted % 16);
            }
            if(fresh)
            {
                fresh = false;
                Output(shift);
                rig.NoteUpdate(unit, shift, time.Now);
            }
        }

        private void Output(uint code)
        {
            if(output != code)
            {
                output = code;
                rig.SetVolts(unit, 10.0 * ((int)code - (int)MidScale) / 32768.0, time.Now);
            }
        }

        private bool clockIdlesHigh = true;
        private bool loadLevel = true;
        private bool inReset;
        private bool highSelect = true;
        private bool fresh;
        private uint shift = MidScale;
        private uint lastBit;
        private uint output = MidScale;
        private int shifted;

        private readonly int unit;
        private readonly Rig rig;
        private readonly VirtualTime time;

        private const uint MidScale = 0x8000;
    }
}
