// SPI controller of the STM32H7 (RM0433 chapter 50), master side, with frames that take their time.
//
// Renode declares only spi4, without its interrupt and without clock polarity and phase; the DAC of this
// board depends on both.
//
// Chips are attached by numbers that mean nothing: each has a select of its own, a GPIO. For chips of Renode's that have none there
// is Renode's SPIMultiplexer.

using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.SPI;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// A chip that sees whole frames and the clock's polarity and phase, which Renode's interface leaves out.
    public interface ISpiChip : ISPIPeripheral
    {
        /// A frame went over the line, `bits` long, in the order of its bits on the line, first bit on top.
        void Frame(uint word, int bits, bool idleHigh, bool secondEdge);
    }

    public class SpiController : SimpleContainer<ISPIPeripheral>, IDoubleWordPeripheral, IWordPeripheral, IBytePeripheral,
        IProvidesRegisterCollection<DoubleWordRegisterCollection>, IKnownSize
    {
        /// `clockPort`, `clock`, `dataPort`, `data`, `function`: the pads of SCK and MOSI, and the alternate function that
        /// connects them.
        public SpiController(IMachine machine, Rcc rcc, GpioPort clockPort, int clock, GpioPort dataPort, int data, int function) : base(machine)
        {
            this.rcc = rcc;
            this.clockPort = clockPort;
            this.clock = clock;
            this.dataPort = dataPort;
            this.data = data;
            this.function = function;
            time = new VirtualTime(machine);
            IRQ = new GPIO();
            RegistersCollection = new DoubleWordRegisterCollection(this);
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            RegistersCollection.Reset();
            toSend.Clear();
            received.Clear();
            left = 0;
            loaded = 0;
            shifting = false;
            step++;
            UpdateInterrupt();
        }

        public uint ReadDoubleWord(long offset)
        {
            return RegistersCollection.Read(offset);
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            var isGuarded = offset == (long)Registers.CR2 || offset == (long)Registers.CFG1 || offset == (long)Registers.CFG2;
            if(isGuarded && enabled.Value)
            {
                this.Log(LogLevel.Warning, "{0} written while SPE=1: ignored", (Registers)offset);
                return;
            }
            RegistersCollection.Write(offset, value);
        }

        public ushort ReadWord(long offset)
        {
            return offset == (long)Registers.RXDR ? (ushort)Receive() : (ushort)(ReadDoubleWord(offset & ~3L) >> (int)(offset & 2) * 8);
        }

        public void WriteWord(long offset, ushort value)
        {
            WriteDoubleWord(offset, value);
        }

        public byte ReadByte(long offset)
        {
            return offset == (long)Registers.RXDR ? (byte)Receive() : (byte)(ReadDoubleWord(offset & ~3L) >> (int)(offset & 3) * 8);
        }

        public void WriteByte(long offset, byte value)
        {
            WriteDoubleWord(offset, value);
        }

        public DoubleWordRegisterCollection RegistersCollection { get; private set; }

        public long Size { get { return 0x400; } }

        public GPIO IRQ { get; private set; }

        /// CSTART begins nothing: a defect of the controller that leaves its registers as they are.
        public bool Stopped { get; set; }

        private int FrameBits { get { return (int)frameSize.Value + 1; } }

        private bool IsTransmitOnly { get { return communication.Value == 1; } }

        private int FifoFrames { get { return FrameBits <= 8 ? 16 : FrameBits <= 16 ? 8 : 4; } }

        private bool HasRoom { get { return enabled.Value && toSend.Count < FifoFrames && (transferSize.Value == 0 || loaded < transferSize.Value); } }

        private bool HasReceived { get { return received.Count > 0; } }

        private bool IsComplete { get { return !shifting && toSend.Count == 0; } }

        private ulong FrameNs
        {
            get
            {
                var hz = rcc.Spi123Hz;
                var divider = 2UL << (int)baudRate.Value;
                return hz <= 0 ? 1000000000UL : (ulong)FrameBits * divider * 1000000000UL / (ulong)hz;
            }
        }

        private void DefineRegisters()
        {
            Registers.CR1.Define(this)
                .WithFlag(0, out enabled, changeCallback: (_, on) => EnableChanged(on), name: "SPE")
                .WithFlag(8, name: "MASRX")
                .WithFlag(9, out start, changeCallback: (_, begins) => { if(begins) { Begin(); } }, name: "CSTART")
                .WithFlag(10, FieldMode.Write, name: "CSUSP")
                .WithFlag(11, name: "HDDIR")
                .WithFlag(12, out internalSelect, name: "SSI")
                .WithFlag(13, name: "CRC33_17")
                .WithFlag(14, name: "RCRCINI")
                .WithFlag(15, name: "TCRCINI")
                .WithTaggedFlag("IOLOCK", 16)
                .WithWriteCallback((_, __) => UpdateInterrupt());
            Registers.CR2.Define(this)
                .WithValueField(0, 16, out transferSize, name: "TSIZE")
                .WithTag("TSER", 16, 16);
            Registers.CFG1.Define(this, 0x00070007)
                .WithValueField(0, 5, out frameSize, name: "DSIZE")
                .WithValueField(5, 4, name: "FTHLV")
                .WithValueField(9, 2, name: "UDRCFG")
                .WithValueField(11, 2, name: "UDRDET")
                .WithTaggedFlag("RXDMAEN", 14)
                .WithTaggedFlag("TXDMAEN", 15)
                .WithValueField(16, 5, name: "CRCSIZE")
                .WithTaggedFlag("CRCEN", 22)
                .WithValueField(28, 3, out baudRate, name: "MBR");
            Registers.CFG2.Define(this)
                .WithValueField(0, 4, name: "MSSI")
                .WithValueField(4, 4, name: "MIDI")
                .WithFlag(15, name: "IOSWP")
                .WithValueField(17, 2, out communication, name: "COMM")
                .WithValueField(19, 3, name: "SP")
                .WithFlag(22, out master, name: "MASTER")
                .WithFlag(23, out leastFirst, name: "LSBFRST")
                .WithFlag(24, out secondEdge, name: "CPHA")
                .WithFlag(25, out idleHigh, name: "CPOL")
                .WithFlag(26, out softwareSelect, name: "SSM")
                .WithFlag(28, name: "SSIOP")
                .WithFlag(29, name: "SSOE")
                .WithFlag(30, name: "SSOM")
                .WithFlag(31, name: "AFCNTR")
                .WithWriteCallback((_, __) => FindRival());
            Registers.IER.Define(this)
                .WithFlag(0, out receivedEnable, name: "RXPIE")
                .WithFlag(1, out roomEnable, name: "TXPIE")
                .WithFlag(2, out bothEnable, name: "DXPIE")
                .WithFlag(3, out endEnable, name: "EOTIE")
                .WithFlag(4, out allSentEnable, name: "TXTFIE")
                .WithFlag(5, name: "UDRIE")
                .WithFlag(6, out overrunEnable, name: "OVRIE")
                .WithFlag(7, name: "CRCEIE")
                .WithFlag(8, name: "TIFREIE")
                .WithFlag(9, out modeFaultEnable, name: "MODFIE")
                .WithTaggedFlag("TSERFIE", 10)
                .WithWriteCallback((_, __) => UpdateInterrupt());
            Registers.SR.Define(this)
                .WithFlag(0, FieldMode.Read, valueProviderCallback: _ => HasReceived, name: "RXP")
                .WithFlag(1, FieldMode.Read, valueProviderCallback: _ => HasRoom, name: "TXP")
                .WithFlag(2, FieldMode.Read, valueProviderCallback: _ => HasReceived && HasRoom, name: "DXP")
                .WithFlag(3, out endOfTransfer, FieldMode.Read, name: "EOT")
                .WithFlag(4, out allSent, FieldMode.Read, name: "TXTF")
                .WithTaggedFlag("UDR", 5)
                .WithFlag(6, out overrun, FieldMode.Read, name: "OVR")
                .WithTag("CRCE, TIFRE", 7, 2)
                .WithFlag(9, out modeFault, FieldMode.Read, name: "MODF")
                .WithTag("TSERF, SUSP", 10, 2)
                .WithFlag(12, FieldMode.Read, valueProviderCallback: _ => IsComplete, name: "TXC")
                .WithTag("RXPLVL, RXWNE", 13, 3)
                .WithValueField(16, 16, FieldMode.Read, valueProviderCallback: _ => left, name: "CTSIZE");
            Registers.IFCR.Define(this)
                .WithFlag(3, FieldMode.Write, writeCallback: (_, clear) => endOfTransfer.Value &= !clear, name: "EOTC")
                .WithFlag(4, FieldMode.Write, writeCallback: (_, clear) => allSent.Value &= !clear, name: "TXTFC")
                .WithFlag(5, FieldMode.Write, name: "UDRC")
                .WithFlag(6, FieldMode.Write, writeCallback: (_, clear) => overrun.Value &= !clear, name: "OVRC")
                .WithFlag(7, FieldMode.Write, name: "CRCEC")
                .WithFlag(8, FieldMode.Write, name: "TIFREC")
                .WithFlag(9, FieldMode.Write, writeCallback: (_, clear) => modeFault.Value &= !clear, name: "MODFC")
                .WithFlag(10, FieldMode.Write, name: "TSERFC")
                .WithFlag(11, FieldMode.Write, name: "SUSPC")
                .WithWriteCallback((_, __) => UpdateInterrupt());
            Registers.TXDR.Define(this)
                .WithValueField(0, 32, FieldMode.Write, writeCallback: (_, value) => Send((uint)value), name: "TXDR");
            Registers.RXDR.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => Receive(), name: "RXDR");
            Registers.I2SCFGR.Define(this)
                .WithTag("I2SMOD to MCKOE", 0, 26);
        }

        private void EnableChanged(bool on)
        {
            loaded = 0;
            if(!on)
            {
                toSend.Clear();
                received.Clear();
                shifting = false;
                left = 0;
                step++;
                start.Value = endOfTransfer.Value = allSent.Value = false;
                FinishTransmission();
            }
        }

        private void Begin()
        {
            if(Stopped)
            {
                return;
            }
            if(!enabled.Value || !master.Value)
            {
                start.Value = false;
                this.Log(LogLevel.Warning, "CSTART without SPE and MASTER: ignored");
                return;
            }
            left = (uint)transferSize.Value;
            Shift();
        }

        /// A master whose select reads low has a rival (RM0433 50.4.16).
        private void FindRival()
        {
            if(master.Value && softwareSelect.Value && !internalSelect.Value)
            {
                modeFault.Value = true;
                master.Value = false;
                this.Log(LogLevel.Warning, "mode fault: MASTER set with SSM=1 while SSI=0");
            }
        }

        private void Send(uint value)
        {
            if(!enabled.Value)
            {
                this.Log(LogLevel.Warning, "TXDR written while SPE=0: lost");
                return;
            }
            if(toSend.Count >= FifoFrames)
            {
                this.Log(LogLevel.Warning, "TXDR written while the FIFO is full: lost");
                return;
            }
            toSend.Enqueue(value);
            loaded++;
            if(transferSize.Value != 0 && loaded == transferSize.Value)
            {
                allSent.Value = true;
            }
            Shift();
            UpdateInterrupt();
        }

        private void Shift()
        {
            if(shifting || toSend.Count == 0 || !start.Value)
            {
                return;
            }
            shifting = true;
            var bits = FrameBits;
            var word = toSend.Dequeue() & Mask(bits);
            var mine = ++step;
            time.At(time.Now + FrameNs, delegate
            {
                if(mine != step)
                {
                    return;
                }
                shifting = false;
                var answer = Exchange(leastFirst.Value ? Reverse(word, bits) : word, bits);
                if(!IsTransmitOnly)
                {
                    if(received.Count < FifoFrames)
                    {
                        received.Enqueue(leastFirst.Value ? Reverse(answer, bits) : answer);
                    }
                    else
                    {
                        overrun.Value = true;
                    }
                }
                if(transferSize.Value != 0 && --left == 0)
                {
                    endOfTransfer.Value = true;
                    start.Value = false;
                    loaded = 0;
                    FinishTransmission();
                }
                Shift();
                UpdateInterrupt();
            });
        }

        /// A frame to the chips, and what they answer; 0 where none drives MISO. A pad in another function leaves its wire alone:
        /// no clock, or no data.
        private uint Exchange(uint word, int bits)
        {
            if(!clockPort.Carries(clock, function))
            {
                this.Log(LogLevel.Warning, "SCK is not connected: MODER and AFR of its pad");
                return 0;
            }
            if(!dataPort.Carries(data, function))
            {
                this.Log(LogLevel.Warning, "MOSI is not connected: MODER and AFR of its pad");
                word = 0;
            }
            var answer = 0u;
            foreach(var chip in ChildCollection.Values)
            {
                var own = chip as ISpiChip;
                if(own != null)
                {
                    own.Frame(word, bits, idleHigh.Value, secondEdge.Value);
                }
                else
                {
                    answer |= Transmit(chip, word, bits);
                }
            }
            return answer;
        }

        /// Renode's chips take bytes.
        private uint Transmit(ISPIPeripheral chip, uint word, int bits)
        {
            if(bits % 8 != 0)
            {
                this.Log(LogLevel.Warning, "a frame of {0} bits has no whole bytes: {1} does not get it", bits, chip.GetType().Name);
                return 0;
            }
            var answer = 0u;
            for(var at = bits - 8; at >= 0; at -= 8)
            {
                answer = answer << 8 | chip.Transmit((byte)(word >> at));
            }
            return answer;
        }

        private void FinishTransmission()
        {
            foreach(var chip in ChildCollection.Values)
            {
                chip.FinishTransmission();
            }
        }

        private uint Receive()
        {
            var value = received.Count > 0 ? received.Dequeue() : 0;
            UpdateInterrupt();
            return value;
        }

        private static uint Mask(int bits)
        {
            return bits == 32 ? uint.MaxValue : (1u << bits) - 1;
        }

        private static uint Reverse(uint word, int bits)
        {
            var result = 0u;
            for(var i = 0; i < bits; i++)
            {
                result = result << 1 | word >> i & 1;
            }
            return result;
        }

        private void UpdateInterrupt()
        {
            // EOTIE is for EOT, TXC and SUSP. TXC is up while nothing was ever sent; it counts as an event only with TSIZE = 0.
            var ends = endOfTransfer.Value || transferSize.Value == 0 && IsComplete;
            IRQ.Set(receivedEnable.Value && HasReceived || roomEnable.Value && HasRoom || bothEnable.Value && HasReceived && HasRoom
                || endEnable.Value && ends || allSentEnable.Value && allSent.Value || overrunEnable.Value && overrun.Value
                || modeFaultEnable.Value && modeFault.Value);
        }

        private uint left;
        private uint loaded;
        private bool shifting;
        private ulong step;

        private IFlagRegisterField enabled;
        private IFlagRegisterField start;
        private IFlagRegisterField internalSelect;
        private IValueRegisterField transferSize;
        private IValueRegisterField frameSize;
        private IValueRegisterField baudRate;
        private IValueRegisterField communication;
        private IFlagRegisterField master;
        private IFlagRegisterField leastFirst;
        private IFlagRegisterField secondEdge;
        private IFlagRegisterField idleHigh;
        private IFlagRegisterField softwareSelect;
        private IFlagRegisterField receivedEnable;
        private IFlagRegisterField roomEnable;
        private IFlagRegisterField bothEnable;
        private IFlagRegisterField endEnable;
        private IFlagRegisterField allSentEnable;
        private IFlagRegisterField overrunEnable;
        private IFlagRegisterField modeFaultEnable;
        private IFlagRegisterField endOfTransfer;
        private IFlagRegisterField allSent;
        private IFlagRegisterField overrun;
        private IFlagRegisterField modeFault;

        private readonly Queue<uint> toSend = new Queue<uint>();
        private readonly Queue<uint> received = new Queue<uint>();
        private readonly Rcc rcc;
        private readonly GpioPort clockPort;
        private readonly int clock;
        private readonly GpioPort dataPort;
        private readonly int data;
        private readonly int function;
        private readonly VirtualTime time;

        private enum Registers : long
        {
            CR1 = 0x00,
            CR2 = 0x04,
            CFG1 = 0x08,
            CFG2 = 0x0C,
            IER = 0x10,
            SR = 0x14,
            IFCR = 0x18,
            TXDR = 0x20,
            RXDR = 0x30,
            I2SCFGR = 0x50,
        }
    }
}
