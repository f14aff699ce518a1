// Three LSI/CSI LS7266R1, dual 24-bit quadrature counters, on one 8-bit bus. Encoders come from the plant.
//
// Widths of RD# and WR# are not checked: at the end of a time quantum Renode's clock stands still for the
// instructions that are left of a block, so that a good strobe can look 0 ns wide. The embedded rig checks them.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: 0 to 7 data, 8 C/D#, 9 X/Y# (low: X), 10 RD#, 11 WR#, 12 to 14 CS# of the three chips.
    public class Ls7266r1 : IPeripheral, IGPIOReceiver
    {
        /// `port`, `firstPin`: where the data bus meets the core.
        public Ls7266r1(IMachine machine, Rig rig, GpioPort port, int firstPin)
        {
            this.rig = rig;
            this.port = port;
            this.firstPin = firstPin;
            time = new VirtualTime(machine);
            for(var unit = 0; unit < Rig.Units; unit++)
            {
                axes[unit] = new Axis();
            }
        }

        /// A reset of the board does not reach these parts.
        public void Reset()
        {
        }

        public void OnGPIO(int number, bool value)
        {
            var before = lines;
            lines = value ? lines | 1u << number : lines & ~(1u << number);
            if(lines == before)
            {
                return;
            }
            if(number == ReadLine)
            {
                if(value)
                {
                    EndRead();
                }
                else
                {
                    BeginRead();
                }
            }
            else if(number == WriteLine)
            {
                if(value)
                {
                    FinishWrite();
                }
            }
        }

        /// Counter of `unit`, from 1, as the chip holds it.
        public uint Counter(int unit)
        {
            Count(Rig.Index(unit));
            return axes[Rig.Index(unit)].Counter;
        }

        private bool Line(int number)
        {
            return (lines >> number & 1) != 0;
        }

        private int Chip()
        {
            var chip = -1;
            for(var n = 0; n < 3; n++)
            {
                if(!Line(FirstSelect + n))
                {
                    if(chip >= 0)
                    {
                        this.Log(LogLevel.Warning, "chips {0} and {1} selected at once", chip + 1, n + 1);
                    }
                    chip = n;
                }
            }
            return chip;
        }

        private void BeginRead()
        {
            var chip = Chip();
            if(chip < 0)
            {
                return;
            }
            var axis = axes[2 * chip + (Line(AxisLine) ? 1 : 0)];
            reading = axis;
            var value = Line(ControlLine) ? axis.Flags : axis.Output >> 8 * axis.Pointer & 255;
            for(var bit = 0; bit < 8; bit++)
            {
                if(port.IsOutput(firstPin + bit))
                {
                    this.Log(LogLevel.Warning, "core and counter drive D{0} at once", bit);
                }
                port.Drive(firstPin + bit, (value >> bit & 1) != 0);
            }
        }

        private void EndRead()
        {
            if(reading == null)
            {
                return;
            }
            if(!Line(ControlLine))
            {
                reading.Pointer = (reading.Pointer + 1) % 3;
            }
            reading = null;
            for(var bit = 0; bit < 8; bit++)
            {
                port.Release(firstPin + bit);
            }
        }

        private void FinishWrite()
        {
            var chip = Chip();
            if(chip < 0)
            {
                return;
            }
            var value = lines & 255;
            var axis = Line(AxisLine) ? 1 : 0;
            if(!Line(ControlLine))
            {
                var target = axes[2 * chip + axis];
                target.Preset = target.Preset & ~(255u << 8 * target.Pointer) | value << 8 * target.Pointer;
                target.Pointer = (target.Pointer + 1) % 3;
                return;
            }
            for(var n = 0; n < 2; n++)
            {
                if(n == axis || (value & 0x80) != 0)
                {
                    Control(2 * chip + n, value);
                }
            }
        }

        private void Control(int unit, uint value)
        {
            Count(unit);
            var axis = axes[unit];
            switch(value >> 5 & 3)
            {
            case 0:
                axis.Load(value);
                break;
            case 1:
                axis.Mode = value & 31;
                if((value & 0x18) != 0x18)
                {
                    this.Log(LogLevel.Warning, "unit {0}: CMR 0x{1:X2}, only quadrature x4 is modelled", unit + 1, value);
                }
                break;
            case 2:
                axis.InputOutput = value & 31;
                break;
            case 3:
                axis.Index = value & 31;
                break;
            }
        }

        /// Lets a counter see the edges since it was last looked at.
        private void Count(int unit)
        {
            var axis = axes[unit];
            var position = rig.Counts(unit, time.Now);
            var moved = position - axis.Seen;
            axis.Seen = position;
            if((axis.InputOutput & 1) != 0 && (axis.Mode & 0x18) == 0x18)
            {
                axis.Move(moved);
            }
        }

        private uint lines = 0x7C00;
        private Axis reading;

        private readonly int firstPin;
        private readonly Rig rig;
        private readonly GpioPort port;
        private readonly VirtualTime time;
        private readonly Axis[] axes = new Axis[Rig.Units];

        private const int ControlLine = 8;
        private const int AxisLine = 9;
        private const int ReadLine = 10;
        private const int WriteLine = 11;
        private const int FirstSelect = 12;

        private sealed class Axis
        {
            public void Load(uint value)
            {
                if((value & 1) != 0)
                {
                    Pointer = 0;
                }
                switch(value >> 1 & 3)
                {
                case 1:
                    Counter = 0;
                    break;
                case 2:
                    Flags &= ~0xFu;
                    break;
                case 3:
                    Flags &= ~0x10u;
                    break;
                }
                switch(value >> 3 & 3)
                {
                case 1:
                    Counter = Preset;
                    break;
                case 2:
                    Output = Counter;
                    break;
                }
            }

            public void Move(long counts)
            {
                if(counts == 0)
                {
                    return;
                }
                var sum = (long)Counter + counts;
                // A borrow sets the sign flag, a carry clears it.
                if(sum < 0)
                {
                    Flags = (Flags ^ 1) | 8;
                }
                if(sum > 0xFFFFFF)
                {
                    Flags = (Flags ^ 2) & ~8u;
                }
                // CPT toggles each time that the counter comes to PR, also on its way from one look to the next.
                if((Passes(Counter, sum) & 1) != 0)
                {
                    Flags ^= 4;
                }
                Flags = counts > 0 ? Flags | 0x20 : Flags & ~0x20u;
                Counter = (uint)(sum & 0xFFFFFF);
            }

            private long Passes(long from, long to)
            {
                return to >= from ? Turns(to) - Turns(from) : Turns(from - 1) - Turns(to - 1);
            }

            /// Whole turns of 24 bits from PR to a number, rounded down.
            private long Turns(long number)
            {
                return number - Preset >> 24;
            }

            public uint Counter;
            public uint Output;
            public uint Preset;
            public uint Flags;
            public uint Mode;
            public uint InputOutput;
            public uint Index;
            public int Pointer;
            public long Seen;
        }
    }
}
