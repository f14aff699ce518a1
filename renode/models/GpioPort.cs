// A GPIO port of the STM32H7 (RM0433 chapter 11) with pads that have an electrical level.
//
// Renode's own port keeps one bit for what the core writes and what the outside drives; mode, output
// type and pulls do not matter there. This board has a bus that changes direction (LS7266R1), open-drain
// lines whose level differs from what was written (I2C recovery) and inputs that read 0 while analog,
// so a pad here is: mode, latch, what the outside drives, pull; and the level follows.

using System.Collections.Generic;
using System.Collections.ObjectModel;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class GpioPort : RegisterBlock, INumberedGPIOOutput, IGPIOReceiver
    {
        /// `modeReset`, `pullReset`: MODER and PUPDR after reset; most ports start analog.
        /// `boardPull`: what the board's own resistors do with an undriven pad, bit n high, else low.
        public GpioPort(IMachine machine, uint modeReset = 0xFFFFFFFF, uint pullReset = 0, uint boardPull = 0)
        {
            this.modeReset = modeReset;
            this.pullReset = pullReset;
            this.boardPull = boardPull;
            var connections = new Dictionary<int, IGPIO>();
            for(var pin = 0; pin < Pins; pin++)
            {
                connections[pin] = new GPIO();
            }
            Connections = new ReadOnlyDictionary<int, IGPIO>(connections);
            // OSPEEDR, AFRL, AFRH.
            Keep(0x08);
            Keep(0x20);
            Keep(0x24);
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            mode = modeReset;
            pull = pullReset;
            outputType = 0;
            latch = 0;
            UpdatePads(0xFFFF);
        }

        /// The outside drives a pin: a device's output that is wired here in the platform description.
        public void OnGPIO(int number, bool value)
        {
            Drive(number, value);
        }

        public void Drive(int pin, bool level)
        {
            var bit = 1u << pin;
            driven |= bit;
            external = level ? external | bit : external & ~bit;
            UpdatePads(bit);
        }

        /// The outside lets go of a pin.
        public void Release(int pin)
        {
            driven &= ~(1u << pin);
            UpdatePads(1u << pin);
        }

        /// Whether the pin belongs to this alternate function.
        public bool Carries(int pin, int function)
        {
            var selected = ReadDoubleWord(pin < 8 ? 0x20 : 0x24) >> 4 * (pin % 8) & 15;
            return Mode(pin) == AlternateMode && selected == function;
        }

        /// Whether the core drives the pin.
        public bool IsOutput(int pin)
        {
            return Mode(pin) == OutputMode;
        }

        protected override uint? Read(long offset)
        {
            switch(offset)
            {
            case 0x00:
                return mode;
            case 0x04:
                return outputType;
            case 0x0C:
                return pull;
            case 0x10:
                return levels & ~analog;
            case 0x14:
                return latch;
            case 0x18:
                return 0;
            default:
                return null;
            }
        }

        protected override bool Write(long offset, uint value)
        {
            switch(offset)
            {
            case 0x00:
                mode = value;
                UpdatePads(0xFFFF);
                break;
            case 0x04:
                outputType = value;
                UpdatePads(0xFFFF);
                break;
            case 0x0C:
                pull = value;
                UpdatePads(0xFFFF);
                break;
            case 0x14:
                SetLatch(value & 0xFFFF);
                break;
            case 0x18:
                // BSRR: where both bits of a pin are written, set has priority (RM0433 11.4.7).
                SetLatch(latch & ~(value >> 16) | value & 0xFFFF);
                break;
            default:
                return false;
            }
            return true;
        }

        public IReadOnlyDictionary<int, IGPIO> Connections { get; private set; }

        private void SetLatch(uint value)
        {
            var changed = latch ^ value;
            latch = value;
            UpdatePads(changed);
        }

        private uint Mode(int pin)
        {
            return mode >> 2 * pin & 3;
        }

        private void UpdatePads(uint pins)
        {
            for(var pin = 0; pins != 0; pin++, pins >>= 1)
            {
                if((pins & 1) != 0)
                {
                    UpdatePad(pin);
                }
            }
        }

        private void UpdatePad(int pin)
        {
            var bit = 1u << pin;
            var isAnalog = Mode(pin) == AnalogMode;
            analog = isAnalog ? analog | bit : analog & ~bit;
            var written = (latch & bit) != 0;
            var openDrain = (outputType & bit) != 0;
            bool level;
            if(Mode(pin) == OutputMode && !(openDrain && written))
            {
                level = written;
            }
            else if((driven & bit) != 0)
            {
                level = (external & bit) != 0;
            }
            else
            {
                var internalPull = isAnalog ? 0 : pull >> 2 * pin & 3;
                level = internalPull == 1 || internalPull == 0 && (boardPull & bit) != 0;
            }
            if(level != ((levels & bit) != 0))
            {
                levels ^= bit;
            }
            Connections[pin].Set(level);
        }

        private uint mode;
        private uint outputType;
        private uint pull;
        private uint latch;
        private uint driven;
        private uint external;
        private uint levels;
        private uint analog;

        private readonly uint modeReset;
        private readonly uint pullReset;
        private readonly uint boardPull;

        private const int Pins = 16;
        private const uint OutputMode = 1;
        private const uint AlternateMode = 2;
        private const uint AnalogMode = 3;
    }
}
