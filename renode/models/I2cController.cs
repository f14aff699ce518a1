// I2C controller of the STM32H7 (RM0433 chapter 47), master side, with the time that bits take.
//
// Renode's own model takes no time, never sees a NACK, never reports BUSY and keeps its interrupt up after
// STOPF was cleared through ICR. The bus scheduler of this firmware depends on all of these.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// A device on the bus. A transaction is: Start, bytes, then Start again or Stop.
    public interface II2cTarget
    {
        /// The address is for this device, and it acknowledges.
        bool Start(int address, bool read);
        /// A byte was written; whether the device acknowledges.
        bool Write(byte value);
        byte Read();
        void Stop();
        /// SDA is held low by a device, so that no transfer can begin.
        bool HoldsBus { get; }
    }

    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class I2cController : RegisterBlock
    {
        /// `port`, `scl`, `sda`, `function`: the pads, and the alternate function that connects them.
        public I2cController(IMachine machine, Rcc rcc, II2cTarget bus, GpioPort port, int scl, int sda, int function)
        {
            this.rcc = rcc;
            this.bus = bus;
            this.port = port;
            this.scl = scl;
            this.sda = sda;
            this.function = function;
            time = new VirtualTime(machine);
            EventInterrupt = new GPIO();
            ErrorInterrupt = new GPIO();
            // OAR1, OAR2, TIMEOUTR.
            Keep(0x08);
            Keep(0x0C);
            Keep(0x14);
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            control1 = 0;
            control2 = 0;
            timing = 0;
            Disable();
        }

        protected override uint? Read(long offset)
        {
            switch(offset)
            {
            case 0x00:
                return control1;
            case 0x04:
                return control2;
            case 0x10:
                return timing;
            case 0x18:
                return status;
            case 0x1C:
            case 0x20:
                return 0;
            case 0x24:
                return ReadData();
            case 0x28:
                return transmit;
            default:
                return null;
            }
        }

        protected override bool Write(long offset, uint value)
        {
            switch(offset)
            {
            case 0x00:
                var wasEnabled = Enabled;
                control1 = value;
                if(wasEnabled && !Enabled)
                {
                    Disable();
                }
                UpdateInterrupts();
                break;
            case 0x04:
                WriteControl2(value);
                break;
            case 0x10:
                if(Enabled)
                {
                    this.Log(LogLevel.Warning, "TIMINGR written while PE=1: ignored (RM0433 47.7.5)");
                    return true;
                }
                timing = value;
                break;
            case 0x18:
                // Only TXE can be written: it flushes the transmit register.
                if((value & TransmitEmpty) != 0)
                {
                    status |= TransmitEmpty;
                    UpdateInterrupts();
                }
                break;
            case 0x1C:
                status &= ~(value & Clearable);
                UpdateInterrupts();
                break;
            case 0x28:
                WriteData((byte)value);
                break;
            default:
                return false;
            }
            return true;
        }

        public GPIO EventInterrupt { get; private set; }

        public GPIO ErrorInterrupt { get; private set; }

        /// The bus-error flag rises; the transfer goes on, as on the part (ES0392 2.19.4).
        public void RaiseBusError()
        {
            status |= BusError;
            UpdateInterrupts();
        }

        /// Another controller wins the bus in the next address phase.
        public bool LoseArbitration { get; set; }

        /// TXIS rises as soon as TXDR is empty, while the byte before is on the wire. The manual's figure 544 shows it after the
        /// acknowledge; drivers of the manufacturer expect both (they flush TXDR after a NACK).
        public bool EarlyTransmitRequest { get; set; }

        private bool Enabled { get { return (control1 & 1) != 0; } }

        /// One SCL period (RM0433 47.4.9, I2C master initialisation): both counted phases, and for each
        /// the synchronisation, which is an edge (190 ns rising, 20 ns falling), two and a half kernel clocks, the analog
        /// filter's 100 ns (data sheet: 50 to 260) and the digital filter's.
        private ulong BitNs
        {
            get
            {
                var hz = rcc.I2c123Hz;
                if(hz <= 0)
                {
                    return 1000000;
                }
                var prescaler = (timing >> 28) + 1;
                var counts = ((timing >> 8 & 255) + 1 + (timing & 255) + 1) * prescaler;
                var digital = control1 >> 8 & 15;
                var analogNs = (control1 & 1u << 12) == 0 ? 2 * 100UL : 0UL;
                return (2 * counts + 5 + 4 * digital) * 500000000UL / (ulong)hz + analogNs + 190UL + 20UL;
            }
        }

        private void Disable()
        {
            if(onBus)
            {
                bus.Stop();
            }
            onBus = false;
            sending = false;
            stretching = false;
            status = TransmitEmpty;
            control2 &= ~(StartBit | StopBit | NackBit);
            remaining = 0;
            step++;
            UpdateInterrupts();
        }

        private void WriteControl2(uint value)
        {
            // START and STOP can only be set by software (RM0433 47.7.2).
            var pending = control2 & (StartBit | StopBit);
            control2 = value | pending;
            if(!Enabled)
            {
                control2 &= ~(StartBit | StopBit);
                return;
            }
            if((value & StartBit) != 0 && (pending & StartBit) == 0)
            {
                Begin();
            }
            else if((value & StopBit) != 0 && (pending & StopBit) == 0)
            {
                status &= ~TransferComplete;
                EndWithStop();
            }
            else if((status & ReloadComplete) != 0)
            {
                status &= ~ReloadComplete;
                remaining = control2 >> 16 & 255;
                Continue();
            }
            UpdateInterrupts();
        }

        private void Begin()
        {
            status |= Busy;
            status &= ~(TransferComplete | ReloadComplete);
            if(bus.HoldsBus)
            {
                // SDA low: the controller waits for a free bus, and no flag is set.
                this.Log(LogLevel.Info, "START waits: SDA is held low");
                return;
            }
            if((status & TransmitEmpty) == 0)
            {
                this.Log(LogLevel.Warning, "TXDR holds a byte of the transaction before: it goes out in this one");
            }
            remaining = control2 >> 16 & 255;
            var reading = (control2 & ReadBit) != 0;
            var address = (int)(control2 >> 1 & 127);
            // START, eight bits and the acknowledge.
            After(10, delegate
            {
                control2 &= ~StartBit;
                if(LoseArbitration)
                {
                    LoseBus();
                    return;
                }
                onBus = true;
                if(!port.Carries(scl, function) || !port.Carries(sda, function))
                {
                    // Nobody hears the address, and SDA reads high.
                    this.Log(LogLevel.Warning, "SCL or SDA is not connected: MODER and AFR of its pad");
                    Refused();
                    return;
                }
                if(!bus.Start(address, reading))
                {
                    Refused();
                    return;
                }
                Continue();
            });
        }

        /// The controller leaves the bus to the other one, whose transfer takes 20 bits more (RM0433 47.4.17).
        private void LoseBus()
        {
            LoseArbitration = false;
            status |= ArbitrationLost;
            status &= ~(TransmitInterrupt | TransferComplete | ReloadComplete);
            After(20, delegate
            {
                status &= ~Busy;
            });
            UpdateInterrupts();
        }

        private void Refused()
        {
            status |= NotAcknowledged;
            status &= ~TransmitInterrupt;
            UpdateInterrupts();
            // A STOP follows on its own after a NACK (RM0433 47.4.9).
            EndWithStop();
        }

        private void Continue()
        {
            if(remaining == 0)
            {
                if((control2 & ReloadBit) != 0)
                {
                    status |= ReloadComplete;
                }
                else if((control2 & AutoEndBit) != 0)
                {
                    EndWithStop();
                }
                else
                {
                    status |= TransferComplete;
                }
            }
            else if((control2 & ReadBit) != 0)
            {
                ReceiveNext();
            }
            else if((status & TransmitEmpty) == 0)
            {
                Shift();
            }
            else
            {
                status |= TransmitInterrupt;
            }
            UpdateInterrupts();
        }

        /// A byte arrives in the shift register. Where RXDR is still full SCL is stretched until it was read.
        private void ReceiveNext()
        {
            After(9, delegate
            {
                arrived = bus.Read();
                if((status & ReceiveFull) != 0)
                {
                    stretching = true;
                    return;
                }
                Arrive();
            });
        }

        private void Arrive()
        {
            received = arrived;
            remaining--;
            status |= ReceiveFull;
            if(remaining == 0)
            {
                Continue();
            }
            else
            {
                ReceiveNext();
            }
            UpdateInterrupts();
        }

        private uint ReadData()
        {
            var value = received;
            if((status & ReceiveFull) != 0)
            {
                status &= ~ReceiveFull;
                if(stretching)
                {
                    stretching = false;
                    Arrive();
                }
                UpdateInterrupts();
            }
            return value;
        }

        private void WriteData(byte value)
        {
            if((status & TransmitEmpty) == 0)
            {
                this.Log(LogLevel.Warning, "TXDR written while TXE=0: lost (RM0433 47.7.11)");
                return;
            }
            transmit = value;
            status &= ~(TransmitInterrupt | TransmitEmpty);
            if(onBus && !sending && (control2 & ReadBit) == 0 && remaining > 0)
            {
                Shift();
            }
            UpdateInterrupts();
        }

        /// The byte in TXDR moves into the shift register and out.
        private void Shift()
        {
            var value = (byte)transmit;
            sending = true;
            status |= TransmitEmpty;
            status &= ~TransmitInterrupt;
            if(EarlyTransmitRequest && remaining > 1)
            {
                status |= TransmitInterrupt;
            }
            After(9, delegate
            {
                sending = false;
                remaining--;
                if(!bus.Write(value))
                {
                    Refused();
                    return;
                }
                Continue();
            });
        }

        private void EndWithStop()
        {
            After(1, delegate
            {
                control2 &= ~(StopBit | StartBit);
                status |= StopDetected;
                status &= ~(Busy | TransferComplete | ReloadComplete | TransmitInterrupt);
                if(onBus)
                {
                    onBus = false;
                    bus.Stop();
                }
                UpdateInterrupts();
            });
        }

        private void After(ulong bits, System.Action action)
        {
            var mine = ++step;
            time.At(time.Now + bits * BitNs, delegate
            {
                if(mine == step)
                {
                    action();
                }
            });
        }

        private void UpdateInterrupts()
        {
            var enabled = 0u;
            enabled |= (control1 & 1u << 1) != 0 ? TransmitInterrupt : 0;
            enabled |= (control1 & 1u << 2) != 0 ? ReceiveFull : 0;
            enabled |= (control1 & 1u << 4) != 0 ? NotAcknowledged : 0;
            enabled |= (control1 & 1u << 5) != 0 ? StopDetected : 0;
            enabled |= (control1 & 1u << 6) != 0 ? TransferComplete | ReloadComplete : 0;
            EventInterrupt.Set((status & enabled) != 0);
            ErrorInterrupt.Set((control1 & 1u << 7) != 0 && (status & Errors) != 0);
        }

        private uint control1;
        private uint control2;
        private uint timing;
        private uint status;
        private uint remaining;
        private uint transmit;
        private byte received;
        private byte arrived;
        private bool onBus;
        private bool sending;
        private bool stretching;
        private ulong step;

        private readonly Rcc rcc;
        private readonly II2cTarget bus;
        private readonly GpioPort port;
        private readonly int scl;
        private readonly int sda;
        private readonly int function;
        private readonly VirtualTime time;

        private const uint ReadBit = 1u << 10;
        private const uint StartBit = 1u << 13;
        private const uint StopBit = 1u << 14;
        private const uint NackBit = 1u << 15;
        private const uint ReloadBit = 1u << 24;
        private const uint AutoEndBit = 1u << 25;

        private const uint TransmitEmpty = 1u << 0;
        private const uint TransmitInterrupt = 1u << 1;
        private const uint ReceiveFull = 1u << 2;
        private const uint NotAcknowledged = 1u << 4;
        private const uint StopDetected = 1u << 5;
        private const uint TransferComplete = 1u << 6;
        private const uint ReloadComplete = 1u << 7;
        private const uint BusError = 1u << 8;
        private const uint ArbitrationLost = 1u << 9;
        private const uint Errors = 0x3F00;
        private const uint Busy = 1u << 15;
        private const uint Clearable = 0x3F38;
    }
}
