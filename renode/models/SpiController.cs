// SPI controller of the STM32H7 (RM0433 chapter 50), master side, with frames that take their time.
//
// Renode declares only spi4, without its interrupt and without clock polarity and phase; the DAC of this
// board depends on both.

using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Devices at SCLK and MOSI; each has a select of its own.
    public interface ISpiTarget
    {
        /// A frame went over the line, `bits` long, in the order of its bits on the line, first bit on top.
        void Frame(uint word, int bits, bool idleHigh, bool secondEdge);
    }

    public class SpiController : RegisterBlock, IWordPeripheral, IBytePeripheral
    {
        /// `clockPort`, `clock`, `dataPort`, `data`, `function`: the pads of SCK and MOSI, and the alternate function that
        /// connects them.
        public SpiController(IMachine machine, Rcc rcc, ISpiTarget target, GpioPort clockPort, int clock, GpioPort dataPort, int data, int function)
        {
            this.rcc = rcc;
            this.clockPort = clockPort;
            this.clock = clock;
            this.dataPort = dataPort;
            this.data = data;
            this.function = function;
            this.target = target;
            time = new VirtualTime(machine);
            IRQ = new GPIO();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            control1 = 0;
            control2 = 0;
            configuration1 = 0x00070007;
            configuration2 = 0;
            interruptEnable = 0;
            flags = 0;
            toSend.Clear();
            received.Clear();
            left = 0;
            loaded = 0;
            shifting = false;
            step++;
            UpdateInterrupt();
        }

        protected override uint? Read(long offset)
        {
            switch(offset)
            {
            case 0x00:
                return control1;
            case 0x04:
                return control2;
            case 0x08:
                return configuration1;
            case 0x0C:
                return configuration2;
            case 0x10:
                return interruptEnable;
            case 0x14:
                return Status;
            case 0x18:
                return 0;
            case 0x30:
                return Receive();
            case 0x50:
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
                WriteControl1(value);
                break;
            case 0x04:
                if(Guard("CR2.TSIZE"))
                {
                    control2 = value;
                }
                break;
            case 0x08:
                if(Guard("CFG1"))
                {
                    configuration1 = value;
                }
                break;
            case 0x0C:
                if(Guard("CFG2"))
                {
                    configuration2 = value;
                    if((value & Master) != 0 && (value & SoftwareSelect) != 0 && (control1 & InternalSelect) == 0)
                    {
                        // A master whose select reads low has a rival (RM0433 50.4.16).
                        flags |= ModeFault;
                        configuration2 &= ~Master;
                        this.Log(LogLevel.Warning, "mode fault: MASTER set with SSM=1 while SSI=0");
                    }
                }
                break;
            case 0x10:
                interruptEnable = value;
                UpdateInterrupt();
                break;
            case 0x18:
                flags &= ~(value & Clearable);
                UpdateInterrupt();
                break;
            case 0x20:
                Send(value);
                break;
            case 0x50:
                if(value != 0)
                {
                    this.Log(LogLevel.Warning, "I2S mode is not modelled");
                }
                break;
            default:
                return false;
            }
            return true;
        }

        public ushort ReadWord(long offset)
        {
            return offset == 0x30 ? (ushort)Receive() : (ushort)(ReadDoubleWord(offset & ~3L) >> (int)(offset & 2) * 8);
        }

        public void WriteWord(long offset, ushort value)
        {
            WriteDoubleWord(offset, value);
        }

        public byte ReadByte(long offset)
        {
            return offset == 0x30 ? (byte)Receive() : (byte)(ReadDoubleWord(offset & ~3L) >> (int)(offset & 3) * 8);
        }

        public void WriteByte(long offset, byte value)
        {
            WriteDoubleWord(offset, value);
        }

        public GPIO IRQ { get; private set; }

        /// CSTART begins nothing: a defect of the controller that leaves its registers as they are.
        public bool Stopped { get; set; }

        private int FrameBits { get { return (int)(configuration1 & 31) + 1; } }

        private bool IsOn { get { return (control1 & 1) != 0; } }

        private bool IsTransmitOnly { get { return (configuration2 >> 17 & 3) == 1; } }

        private int FifoFrames { get { return FrameBits <= 8 ? 16 : FrameBits <= 16 ? 8 : 4; } }

        private uint Status
        {
            get
            {
                var status = flags;
                if(received.Count > 0)
                {
                    status |= 1;
                }
                if(IsOn && toSend.Count < FifoFrames && (Size16 == 0 || loaded < Size16))
                {
                    status |= 1u << 1;
                }
                if((status & 3) == 3)
                {
                    status |= 1u << 2;
                }
                if(!shifting && toSend.Count == 0)
                {
                    status |= 1u << 12;
                }
                return status | left << 16;
            }
        }

        private uint Size16 { get { return control2 & 0xFFFF; } }

        private ulong FrameNs
        {
            get
            {
                var hz = rcc.Spi123Hz;
                var divider = 2UL << (int)(configuration1 >> 28 & 7);
                return hz <= 0 ? 1000000000UL : (ulong)FrameBits * divider * 1000000000UL / (ulong)hz;
            }
        }

        private bool Guard(string what)
        {
            if(IsOn)
            {
                this.Log(LogLevel.Warning, "{0} written while SPE=1: ignored", what);
            }
            return !IsOn;
        }

        private void WriteControl1(uint value)
        {
            var before = control1;
            control1 = value & ~SuspendRequest;
            if((before & 1) != 0 && !IsOn)
            {
                toSend.Clear();
                received.Clear();
                shifting = false;
                left = 0;
                loaded = 0;
                step++;
                control1 &= ~StartTransfer;
                flags &= ~(EndOfTransfer | AllSent);
            }
            if((before & 1) == 0 && IsOn)
            {
                loaded = 0;
            }
            if((value & StartTransfer) != 0 && (before & StartTransfer) == 0 && !Stopped)
            {
                if(!IsOn || (configuration2 & Master) == 0)
                {
                    control1 &= ~StartTransfer;
                    this.Log(LogLevel.Warning, "CSTART without SPE and MASTER: ignored");
                }
                else
                {
                    left = Size16;
                    Shift();
                }
            }
            UpdateInterrupt();
        }

        private void Send(uint value)
        {
            if(!IsOn)
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
            if(Size16 != 0 && loaded == Size16)
            {
                flags |= AllSent;
            }
            Shift();
            UpdateInterrupt();
        }

        private void Shift()
        {
            if(shifting || toSend.Count == 0 || (control1 & StartTransfer) == 0)
            {
                return;
            }
            shifting = true;
            var bits = FrameBits;
            var word = toSend.Dequeue() & (bits == 32 ? uint.MaxValue : (1u << bits) - 1);
            var mine = ++step;
            time.At(time.Now + FrameNs, delegate
            {
                if(mine != step)
                {
                    return;
                }
                shifting = false;
                Put((configuration2 & LsbFirst) != 0 ? Reverse(word, bits) : word, bits);
                if(!IsTransmitOnly)
                {
                    if(received.Count < FifoFrames)
                    {
                        received.Enqueue(0);
                    }
                    else
                    {
                        flags |= Overrun;
                    }
                }
                if(Size16 != 0 && --left == 0)
                {
                    flags |= EndOfTransfer;
                    control1 &= ~StartTransfer;
                    loaded = 0;
                }
                Shift();
                UpdateInterrupt();
            });
        }

        /// A pad in another function leaves its wire alone: no clock, or no data.
        private void Put(uint word, int bits)
        {
            if(!clockPort.Carries(clock, function))
            {
                this.Log(LogLevel.Warning, "SCK is not connected: MODER and AFR of its pad");
                return;
            }
            if(!dataPort.Carries(data, function))
            {
                this.Log(LogLevel.Warning, "MOSI is not connected: MODER and AFR of its pad");
                word = 0;
            }
            target.Frame(word, bits, (configuration2 & 1u << 25) != 0, (configuration2 & 1u << 24) != 0);
        }

        private uint Receive()
        {
            var value = received.Count > 0 ? received.Dequeue() : 0;
            UpdateInterrupt();
            return value;
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
            // IER and SR have the same places but for SUSP and TXC, which share EOTIE.
            var status = Status;
            var enabled = interruptEnable & 0x7FF;
            var ends = (interruptEnable & EndOfTransfer) != 0 ? 1u << 11 | 1u << 12 : 0;
            // TXC is up while nothing was ever sent; it counts as an event only with TSIZE = 0.
            if(Size16 != 0)
            {
                ends &= ~(1u << 12);
            }
            IRQ.Set((status & (enabled | ends)) != 0);
        }

        private uint control1;
        private uint control2;
        private uint configuration1;
        private uint configuration2;
        private uint interruptEnable;
        private uint flags;
        private uint left;
        private uint loaded;
        private bool shifting;
        private ulong step;

        private readonly Queue<uint> toSend = new Queue<uint>();
        private readonly Queue<uint> received = new Queue<uint>();
        private readonly Rcc rcc;
        private readonly ISpiTarget target;
        private readonly GpioPort clockPort;
        private readonly int clock;
        private readonly GpioPort dataPort;
        private readonly int data;
        private readonly int function;
        private readonly VirtualTime time;

        private const uint StartTransfer = 1u << 9;
        private const uint SuspendRequest = 1u << 10;
        private const uint InternalSelect = 1u << 12;
        private const uint Master = 1u << 22;
        private const uint LsbFirst = 1u << 23;
        private const uint SoftwareSelect = 1u << 26;
        private const uint EndOfTransfer = 1u << 3;
        private const uint AllSent = 1u << 4;
        private const uint Overrun = 1u << 6;
        private const uint ModeFault = 1u << 9;
        private const uint Clearable = 0xFF8;
    }
}
