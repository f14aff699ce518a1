// I2C controller of the STM32H7 (RM0433 chapter 47), master side, with the time that bits take.
//
// Renode's own model takes no time, never sees a NACK, never reports BUSY and keeps its interrupt up after
// STOPF was cleared through ICR. The bus scheduler of this firmware depends on all of these.
//
// Chips are attached by their addresses: Renode's own, and those of this project, see `I2cBus.cs`.

using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.I2C;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class I2cController : SimpleContainer<II2CPeripheral>, IDoubleWordPeripheral, IProvidesRegisterCollection<DoubleWordRegisterCollection>, IKnownSize
    {
        /// `port`, `scl`, `sda`, `function`: the pads, and the alternate function that connects them.
        public I2cController(IMachine machine, Rcc rcc, GpioPort port, int scl, int sda, int function) : base(machine)
        {
            this.rcc = rcc;
            this.port = port;
            this.scl = scl;
            this.sda = sda;
            this.function = function;
            time = new VirtualTime(machine);
            bus = new I2cTransaction(this, ChildCollection);
            EventInterrupt = new GPIO();
            ErrorInterrupt = new GPIO();
            RegistersCollection = new DoubleWordRegisterCollection(this);
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            RegistersCollection.Reset();
            transmit = 0;
            Disable();
        }

        public uint ReadDoubleWord(long offset)
        {
            return RegistersCollection.Read(offset);
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            if(offset == (long)Registers.TIMINGR && enabled.Value)
            {
                this.Log(LogLevel.Warning, "TIMINGR written while PE=1: ignored (RM0433 47.7.5)");
                return;
            }
            RegistersCollection.Write(offset, value);
        }

        public DoubleWordRegisterCollection RegistersCollection { get; private set; }

        public long Size { get { return 0x400; } }

        public GPIO EventInterrupt { get; private set; }

        public GPIO ErrorInterrupt { get; private set; }

        /// The bus-error flag rises; the transfer goes on, as on the part (ES0392 2.19.4).
        public void RaiseBusError()
        {
            busError.Value = true;
            UpdateInterrupts();
        }

        /// Another controller wins the bus in the next address phase.
        public bool LoseArbitration { get; set; }

        /// Microseconds from the last lost arbitration to PE=0, with which the firmware begins its recovery.
        public ulong ReleasedAfterUs { get; private set; }

        /// TXIS rises as soon as TXDR is empty, while the byte before is on the wire. The manual's figure 544 shows it after the
        /// acknowledge; drivers of the manufacturer expect both (they flush TXDR after a NACK).
        public bool EarlyTransmitRequest { get; set; }

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
                var counts = (sclHigh.Value + 1 + sclLow.Value + 1) * (prescaler.Value + 1);
                var analogNs = analogFilterOff.Value ? 0UL : 2 * 100UL;
                return (2 * counts + 5 + 4 * digitalFilter.Value) * 500000000UL / (ulong)hz + analogNs + 190UL + 20UL;
            }
        }

        private void DefineRegisters()
        {
            Registers.CR1.Define(this)
                .WithFlag(0, out enabled, changeCallback: (_, on) => { if(!on) { Disable(); } }, name: "PE")
                .WithFlag(1, out transmitInterruptEnable, name: "TXIE")
                .WithFlag(2, out receiveInterruptEnable, name: "RXIE")
                .WithTaggedFlag("ADDRIE", 3)
                .WithFlag(4, out notAcknowledgedInterruptEnable, name: "NACKIE")
                .WithFlag(5, out stopInterruptEnable, name: "STOPIE")
                .WithFlag(6, out transferCompleteInterruptEnable, name: "TCIE")
                .WithFlag(7, out errorInterruptEnable, name: "ERRIE")
                .WithValueField(8, 4, out digitalFilter, name: "DNF")
                .WithFlag(12, out analogFilterOff, name: "ANFOFF")
                .WithReservedBits(13, 1)
                .WithTaggedFlag("TXDMAEN", 14)
                .WithTaggedFlag("RXDMAEN", 15)
                .WithTaggedFlag("SBC", 16)
                .WithTaggedFlag("NOSTRETCH", 17)
                .WithTaggedFlag("WUPEN", 18)
                .WithTaggedFlag("GCEN", 19)
                .WithTaggedFlag("SMBHEN", 20)
                .WithTaggedFlag("SMBDEN", 21)
                .WithTaggedFlag("ALERTEN", 22)
                .WithTaggedFlag("PECEN", 23)
                .WithReservedBits(24, 8)
                .WithWriteCallback((_, __) => UpdateInterrupts());
            Registers.CR2.Define(this)
                .WithValueField(0, 10, out address, name: "SADD")
                .WithFlag(10, out reading, name: "RD_WRN")
                .WithTaggedFlag("ADD10", 11)
                .WithTaggedFlag("HEAD10R", 12)
                // START and STOP can only be set by software (RM0433 47.7.2).
                .WithFlag(13, out start, FieldMode.Read | FieldMode.Set, name: "START")
                .WithFlag(14, out stop, FieldMode.Read | FieldMode.Set, name: "STOP")
                .WithFlag(15, out notAcknowledge, name: "NACK")
                .WithValueField(16, 8, out bytes, name: "NBYTES")
                .WithFlag(24, out reload, name: "RELOAD")
                .WithFlag(25, out autoEnd, name: "AUTOEND")
                .WithTaggedFlag("PECBYTE", 26)
                .WithReservedBits(27, 5)
                .WithWriteCallback((before, _) => ControlWritten((before & 1u << 13) != 0, (before & 1u << 14) != 0));
            Registers.OAR1.Define(this)
                .WithValueField(0, 10, name: "OA1")
                .WithFlag(10, name: "OA1MODE")
                .WithTaggedFlag("OA1EN", 15);
            Registers.OAR2.Define(this)
                .WithValueField(1, 7, name: "OA2")
                .WithValueField(8, 3, name: "OA2MSK")
                .WithTaggedFlag("OA2EN", 15);
            Registers.TIMINGR.Define(this)
                .WithValueField(0, 8, out sclLow, name: "SCLL")
                .WithValueField(8, 8, out sclHigh, name: "SCLH")
                .WithValueField(16, 4, name: "SDADEL")
                .WithValueField(20, 4, name: "SCLDEL")
                .WithReservedBits(24, 4)
                .WithValueField(28, 4, out prescaler, name: "PRESC");
            Registers.TIMEOUTR.Define(this)
                .WithValueField(0, 12, name: "TIMEOUTA")
                .WithFlag(12, name: "TIDLE")
                .WithTaggedFlag("TIMOUTEN", 15)
                .WithValueField(16, 12, name: "TIMEOUTB")
                .WithTaggedFlag("TEXTEN", 31);
            Registers.ISR.Define(this, 0x1)
                // Only TXE can be written: it flushes the transmit register.
                .WithFlag(0, out transmitEmpty, FieldMode.Read | FieldMode.Set, name: "TXE")
                .WithFlag(1, out transmitRequest, FieldMode.Read, name: "TXIS")
                .WithFlag(2, out receiveFull, FieldMode.Read, name: "RXNE")
                .WithTaggedFlag("ADDR", 3)
                .WithFlag(4, out notAcknowledged, FieldMode.Read, name: "NACKF")
                .WithFlag(5, out stopDetected, FieldMode.Read, name: "STOPF")
                .WithFlag(6, out transferComplete, FieldMode.Read, name: "TC")
                .WithFlag(7, out reloadComplete, FieldMode.Read, name: "TCR")
                .WithFlag(8, out busError, FieldMode.Read, name: "BERR")
                .WithFlag(9, out arbitrationLost, FieldMode.Read, name: "ARLO")
                .WithTag("OVR, PECERR, TIMEOUT, ALERT", 10, 4)
                .WithFlag(15, out busy, FieldMode.Read, name: "BUSY")
                .WithTag("DIR, ADDCODE", 16, 8)
                .WithWriteCallback((_, __) => UpdateInterrupts());
            Registers.ICR.Define(this)
                .WithFlag(3, FieldMode.Write, name: "ADDRCF")
                .WithFlag(4, FieldMode.Write, writeCallback: (_, clear) => notAcknowledged.Value &= !clear, name: "NACKCF")
                .WithFlag(5, FieldMode.Write, writeCallback: (_, clear) => stopDetected.Value &= !clear, name: "STOPCF")
                .WithFlag(8, FieldMode.Write, writeCallback: (_, clear) => busError.Value &= !clear, name: "BERRCF")
                .WithFlag(9, FieldMode.Write, writeCallback: (_, clear) => arbitrationLost.Value &= !clear, name: "ARLOCF")
                .WithValueField(10, 4, FieldMode.Write, name: "OVRCF, PECCF, TIMOUTCF, ALERTCF")
                .WithWriteCallback((_, __) => UpdateInterrupts());
            Registers.PECR.Define(this)
                .WithValueField(0, 8, FieldMode.Read, name: "PEC");
            Registers.RXDR.Define(this)
                .WithValueField(0, 8, FieldMode.Read, valueProviderCallback: _ => ReadData(), name: "RXDATA");
            Registers.TXDR.Define(this)
                .WithValueField(0, 8, writeCallback: (_, value) => WriteData((byte)value), valueProviderCallback: _ => transmit, name: "TXDATA");
        }

        private void Disable()
        {
            if(lostAt != 0)
            {
                ReleasedAfterUs = (time.Now - lostAt) / 1000;
                lostAt = 0;
            }
            if(onBus)
            {
                bus.Stop();
            }
            onBus = false;
            sending = false;
            stretching = false;
            foreach(var flag in new[] { transmitRequest, receiveFull, notAcknowledged, stopDetected, transferComplete, reloadComplete,
                busError, arbitrationLost, busy, start, stop, notAcknowledge })
            {
                flag.Value = false;
            }
            transmitEmpty.Value = true;
            remaining = 0;
            step++;
            UpdateInterrupts();
        }

        private void ControlWritten(bool startWasPending, bool stopWasPending)
        {
            if(!enabled.Value)
            {
                start.Value = stop.Value = false;
                return;
            }
            if(start.Value && !startWasPending)
            {
                Begin();
            }
            else if(stop.Value && !stopWasPending)
            {
                transferComplete.Value = false;
                EndWithStop();
            }
            else if(reloadComplete.Value)
            {
                reloadComplete.Value = false;
                remaining = (uint)bytes.Value;
                Continue();
            }
            UpdateInterrupts();
        }

        private void Begin()
        {
            busy.Value = true;
            transferComplete.Value = reloadComplete.Value = false;
            if(bus.IsHeld)
            {
                // SDA low: the controller waits for a free bus, and no flag is set.
                this.Log(LogLevel.Info, "START waits: SDA is held low");
                return;
            }
            if(!transmitEmpty.Value)
            {
                this.Log(LogLevel.Warning, "TXDR holds a byte of the transaction before: it goes out in this one");
            }
            remaining = (uint)bytes.Value;
            var isRead = reading.Value;
            var called = (int)(address.Value >> 1 & 127);
            // START, eight bits and the acknowledge.
            After(10, delegate
            {
                start.Value = false;
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
                if(!bus.Start(called, isRead))
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
            lostAt = time.Now;
            arbitrationLost.Value = true;
            transmitRequest.Value = transferComplete.Value = reloadComplete.Value = false;
            After(20, delegate
            {
                busy.Value = false;
            });
            UpdateInterrupts();
        }

        private void Refused()
        {
            notAcknowledged.Value = true;
            transmitRequest.Value = false;
            UpdateInterrupts();
            // A STOP follows on its own after a NACK (RM0433 47.4.9).
            EndWithStop();
        }

        private void Continue()
        {
            if(remaining == 0)
            {
                if(reload.Value)
                {
                    reloadComplete.Value = true;
                }
                else if(autoEnd.Value)
                {
                    EndWithStop();
                }
                else
                {
                    transferComplete.Value = true;
                }
            }
            else if(reading.Value)
            {
                ReceiveNext();
            }
            else if(!transmitEmpty.Value)
            {
                Shift();
            }
            else
            {
                transmitRequest.Value = true;
            }
            UpdateInterrupts();
        }

        /// A byte arrives in the shift register. Where RXDR is still full SCL is stretched until it was read.
        private void ReceiveNext()
        {
            After(9, delegate
            {
                arrived = bus.Read((int)remaining);
                if(receiveFull.Value)
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
            receiveFull.Value = true;
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
            if(receiveFull.Value)
            {
                receiveFull.Value = false;
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
            if(!transmitEmpty.Value)
            {
                this.Log(LogLevel.Warning, "TXDR written while TXE=0: lost (RM0433 47.7.11)");
                return;
            }
            transmit = value;
            transmitRequest.Value = transmitEmpty.Value = false;
            if(onBus && !sending && !reading.Value && remaining > 0)
            {
                Shift();
            }
            UpdateInterrupts();
        }

        /// The byte in TXDR moves into the shift register and out.
        private void Shift()
        {
            var value = transmit;
            sending = true;
            transmitEmpty.Value = true;
            transmitRequest.Value = EarlyTransmitRequest && remaining > 1;
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
                start.Value = stop.Value = false;
                stopDetected.Value = true;
                busy.Value = transferComplete.Value = reloadComplete.Value = transmitRequest.Value = false;
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
            EventInterrupt.Set(transmitInterruptEnable.Value && transmitRequest.Value
                || receiveInterruptEnable.Value && receiveFull.Value
                || notAcknowledgedInterruptEnable.Value && notAcknowledged.Value
                || stopInterruptEnable.Value && stopDetected.Value
                || transferCompleteInterruptEnable.Value && (transferComplete.Value || reloadComplete.Value));
            ErrorInterrupt.Set(errorInterruptEnable.Value && (busError.Value || arbitrationLost.Value));
        }

        private uint remaining;
        private ulong lostAt;
        private byte transmit;
        private byte received;
        private byte arrived;
        private bool onBus;
        private bool sending;
        private bool stretching;
        private ulong step;

        private IFlagRegisterField enabled;
        private IFlagRegisterField transmitInterruptEnable;
        private IFlagRegisterField receiveInterruptEnable;
        private IFlagRegisterField notAcknowledgedInterruptEnable;
        private IFlagRegisterField stopInterruptEnable;
        private IFlagRegisterField transferCompleteInterruptEnable;
        private IFlagRegisterField errorInterruptEnable;
        private IFlagRegisterField analogFilterOff;
        private IValueRegisterField digitalFilter;
        private IValueRegisterField address;
        private IValueRegisterField bytes;
        private IFlagRegisterField reading;
        private IFlagRegisterField start;
        private IFlagRegisterField stop;
        private IFlagRegisterField notAcknowledge;
        private IFlagRegisterField reload;
        private IFlagRegisterField autoEnd;
        private IValueRegisterField sclLow;
        private IValueRegisterField sclHigh;
        private IValueRegisterField prescaler;
        private IFlagRegisterField transmitEmpty;
        private IFlagRegisterField transmitRequest;
        private IFlagRegisterField receiveFull;
        private IFlagRegisterField notAcknowledged;
        private IFlagRegisterField stopDetected;
        private IFlagRegisterField transferComplete;
        private IFlagRegisterField reloadComplete;
        private IFlagRegisterField busError;
        private IFlagRegisterField arbitrationLost;
        private IFlagRegisterField busy;

        private readonly Rcc rcc;
        private readonly GpioPort port;
        private readonly int scl;
        private readonly int sda;
        private readonly int function;
        private readonly I2cTransaction bus;
        private readonly VirtualTime time;

        private enum Registers
        {
            CR1 = 0x00,
            CR2 = 0x04,
            OAR1 = 0x08,
            OAR2 = 0x0C,
            TIMINGR = 0x10,
            TIMEOUTR = 0x14,
            ISR = 0x18,
            ICR = 0x1C,
            PECR = 0x20,
            RXDR = 0x24,
            TXDR = 0x28,
        }
    }
}
