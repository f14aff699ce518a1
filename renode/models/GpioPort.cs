// A GPIO port of the STM32H7 (RM0433 chapter 11) with pads that have an electrical level.
//
// Renode's own port keeps one bit for what the core writes and what the outside drives; mode, output
// type and pulls do not matter there. This board has a bus that changes direction (LS7266R1), open-drain
// lines whose level differs from what was written (I2C recovery) and inputs that read 0 while analog,
// so a pad here is: mode, latch, what the outside drives, pulls; and the level follows.

using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.GPIOPort;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Renode's base class of ports lets LEDs and buttons be attached by their pin.
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class GpioPort : BaseGPIOPort, IDoubleWordPeripheral, IProvidesRegisterCollection<DoubleWordRegisterCollection>, IKnownSize
    {
        /// `modeReset`, `pullReset`: MODER and PUPDR after reset; most ports start analog.
        /// `boardUp`, `boardDown`: see the properties.
        public GpioPort(IMachine machine, uint modeReset = 0xFFFFFFFF, uint pullReset = 0, uint boardUp = 0, uint boardDown = 0) : base(machine, Pins)
        {
            this.boardUp = boardUp;
            this.boardDown = boardDown;
            RegistersCollection = new DoubleWordRegisterCollection(this);
            DefineRegisters(modeReset, pullReset);
            Reset();
        }

        /// What the outside drives stays as it is.
        public override void Reset()
        {
            RegistersCollection.Reset();
            latch = 0;
            UpdatePads(0xFFFF);
        }

        public uint ReadDoubleWord(long offset)
        {
            return RegistersCollection.Read(offset);
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            RegistersCollection.Write(offset, value);
        }

        /// The outside drives a pin: a device's output that is wired here in the platform description.
        public override void OnGPIO(int number, bool value)
        {
            if(CheckPinNumber(number))
            {
                Drive(number, value);
            }
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
            var selected = pin < 8 ? functionsLow[pin].Value : functionsHigh[pin - 8].Value;
            return modes[pin].Value == Mode.Alternate && (int)selected == function;
        }

        /// Whether the core drives the pin.
        public bool IsOutput(int pin)
        {
            return modes[pin].Value == Mode.Output;
        }

        /// Pins with a resistor of the board to its supply. It has 10 kOhm or less, so it wins over the controller's own 30 to 50 kOhm.
        public uint BoardUp
        {
            get { return boardUp; }
            set
            {
                boardUp = value;
                UpdatePads(0xFFFF);
            }
        }

        /// As BoardUp, to ground.
        public uint BoardDown
        {
            get { return boardDown; }
            set
            {
                boardDown = value;
                UpdatePads(0xFFFF);
            }
        }

        public DoubleWordRegisterCollection RegistersCollection { get; private set; }

        public long Size { get { return 0x400; } }

        private void DefineRegisters(uint modeReset, uint pullReset)
        {
            Registers.MODER.Define(this, modeReset)
                .WithEnumFields<DoubleWordRegister, Mode>(0, 2, Pins, out modes, name: "MODE")
                .WithWriteCallback((_, __) => UpdatePads(0xFFFF));
            Registers.OTYPER.Define(this)
                .WithFlags(0, Pins, out openDrains, name: "OT")
                .WithReservedBits(16, 16)
                .WithWriteCallback((_, __) => UpdatePads(0xFFFF));
            Registers.OSPEEDR.Define(this)
                .WithValueFields(0, 2, Pins, name: "OSPEED");
            Registers.PUPDR.Define(this, pullReset)
                .WithEnumFields<DoubleWordRegister, Pull>(0, 2, Pins, out pulls, name: "PUPD")
                .WithWriteCallback((_, __) => UpdatePads(0xFFFF));
            Registers.IDR.Define(this)
                .WithValueField(0, Pins, FieldMode.Read, valueProviderCallback: _ => levels & ~analog, name: "ID")
                .WithReservedBits(16, 16);
            Registers.ODR.Define(this)
                .WithValueField(0, Pins, valueProviderCallback: _ => latch, writeCallback: (_, value) => SetLatch((uint)value), name: "OD")
                .WithReservedBits(16, 16);
            // Where both bits of a pin are written, set has priority (RM0433 11.4.7).
            Registers.BSRR.Define(this)
                .WithValueField(0, Pins, FieldMode.Write, name: "BS")
                .WithValueField(16, Pins, FieldMode.Write, name: "BR")
                .WithWriteCallback((_, value) => SetLatch(latch & ~(value >> 16) | value & 0xFFFF));
            Registers.LCKR.Define(this)
                .WithTag("LCK", 0, 17);
            Registers.AFRL.Define(this)
                .WithValueFields(0, 4, 8, out functionsLow, name: "AFR");
            Registers.AFRH.Define(this)
                .WithValueFields(0, 4, 8, out functionsHigh, name: "AFR");
        }

        private void SetLatch(uint value)
        {
            var changed = latch ^ value;
            latch = value;
            UpdatePads(changed);
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
            var mode = modes[pin].Value;
            analog = mode == Mode.Analog ? analog | bit : analog & ~bit;
            var written = (latch & bit) != 0;
            bool level;
            if(mode == Mode.Output && !(openDrains[pin].Value && written))
            {
                level = written;
            }
            else if((driven & bit) != 0)
            {
                level = (external & bit) != 0;
            }
            else
            {
                var pulledUp = mode != Mode.Analog && pulls[pin].Value == Pull.Up;
                level = (boardUp & bit) != 0 || pulledUp && (boardDown & bit) == 0;
            }
            levels = level ? levels | bit : levels & ~bit;
            Connections[pin].Set(level);
        }

        private uint latch;
        private uint driven;
        private uint external;
        private uint levels;
        private uint analog;
        private IEnumRegisterField<Mode>[] modes;
        private IEnumRegisterField<Pull>[] pulls;
        private IFlagRegisterField[] openDrains;
        private IValueRegisterField[] functionsLow;
        private IValueRegisterField[] functionsHigh;

        private uint boardUp;
        private uint boardDown;

        private const int Pins = 16;

        private enum Mode
        {
            Input = 0,
            Output = 1,
            Alternate = 2,
            Analog = 3,
        }

        private enum Pull
        {
            None = 0,
            Up = 1,
            Down = 2,
            Reserved = 3,
        }

        private enum Registers
        {
            MODER = 0x00,
            OTYPER = 0x04,
            OSPEEDR = 0x08,
            PUPDR = 0x0C,
            IDR = 0x10,
            ODR = 0x14,
            BSRR = 0x18,
            LCKR = 0x1C,
            AFRL = 0x20,
            AFRH = 0x24,
        }
    }
}
