// USART of the STM32H7 (RM0433 chapter 48), asynchronous 8N1: FIFOs, DMA requests, idle line, overrun, and bytes that
// take the time of their bits.
//
// Renode's own has no FIFO, no idle flag, no transmit DMA request, and sends in no time.

using System;
using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.UART;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Usart : RegisterBlock, IUART
    {
        public Usart(IMachine machine, Rcc rcc)
        {
            this.rcc = rcc;
            time = new VirtualTime(machine);
            IRQ = new GPIO();
            ReceiveRequest = new GPIO();
            TransmitRequest = new GPIO();
            // GTPR, RTOR.
            Keep(0x10);
            Keep(0x14);
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            control1 = 0;
            control2 = 0;
            control3 = 0;
            divisor = 0;
            prescaler = 0;
            flags = TransmitComplete;
            toSend.Clear();
            received.Clear();
            sending = false;
            epoch++;
            Update();
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
                return control3;
            case 0x0C:
                return divisor;
            case 0x18:
            case 0x20:
                return 0;
            case 0x1C:
                return Status;
            case 0x24:
                return Receive();
            case 0x28:
                return 0;
            case 0x2C:
                return prescaler;
            default:
                return null;
            }
        }

        protected override bool Write(long offset, uint value)
        {
            switch(offset)
            {
            case 0x00:
                control1 = value;
                if((value & 0x10001000) != 0 || (value & 1u << 10) != 0)
                {
                    this.Log(LogLevel.Warning, "only 8 data bits without parity are modelled");
                }
                if(!IsOn)
                {
                    toSend.Clear();
                    received.Clear();
                    sending = false;
                    flags = TransmitComplete;
                    epoch++;
                }
                break;
            case 0x04:
                control2 = value;
                break;
            case 0x08:
                control3 = value;
                break;
            case 0x0C:
                divisor = value & 0xFFFF;
                break;
            case 0x18:
                if((value & 1u << 3) != 0)
                {
                    received.Clear();
                }
                if((value & 1u << 4) != 0)
                {
                    toSend.Clear();
                }
                break;
            case 0x20:
                flags &= ~(value & Clearable);
                break;
            case 0x28:
                Send((byte)value);
                break;
            case 0x2C:
                prescaler = value & 15;
                break;
            default:
                return false;
            }
            Update();
            return true;
        }

        /// A byte arrives at the RX pin.
        public void WriteChar(byte value)
        {
            if(!IsOn || (control1 & ReceiverOn) == 0)
            {
                return;
            }
            if(received.Count >= Depth)
            {
                if((control3 & 1u << 12) == 0)
                {
                    flags |= Overrun;
                }
                this.Log(LogLevel.Warning, "receiver overrun: a byte is lost");
            }
            else
            {
                received.Enqueue(value);
            }
            var mine = ++idleWatch;
            time.At(time.Now + 2 * ByteNs, delegate
            {
                if(mine == idleWatch)
                {
                    flags |= Idle;
                    Update();
                }
            });
            Update();
        }

        public event Action<byte> CharReceived;

        public uint BaudRate
        {
            get
            {
                if(divisor == 0)
                {
                    return 0;
                }
                var hz = rcc.Usart234578Hz / Prescale[Math.Min(prescaler, 11)];
                // OVER8: the low nibble holds three bits, shifted right by one (RM0433 51.5.7).
                return (control1 & 1u << 15) == 0 ? (uint)(hz / divisor)
                    : (uint)(2 * hz / (divisor & 0xFFF0 | (divisor & 7) << 1));
            }
        }

        public Bits StopBits { get { return Bits.One; } }

        public Parity ParityBit { get { return Parity.None; } }

        public GPIO IRQ { get; private set; }

        public GPIO ReceiveRequest { get; private set; }

        public GPIO TransmitRequest { get; private set; }

        private bool IsOn { get { return (control1 & 1) != 0; } }

        private bool HasFifo { get { return (control1 & 1u << 29) != 0; } }

        private int Depth { get { return HasFifo ? 16 : 1; } }

        private ulong ByteNs { get { return BaudRate == 0 ? 1000000UL : 10000000000UL / BaudRate; } }

        private uint Status
        {
            get
            {
                var status = flags;
                status |= received.Count > 0 ? ReceiveNotEmpty : 0;
                status |= toSend.Count < Depth ? TransmitNotFull : 0;
                status |= IsOn && (control1 & TransmitterOn) != 0 ? 1u << 21 : 0;
                status |= IsOn && (control1 & ReceiverOn) != 0 ? 1u << 22 : 0;
                if(HasFifo)
                {
                    status |= toSend.Count == 0 ? 1u << 23 : 0;
                    status |= received.Count >= 16 ? 1u << 24 : 0;
                    status |= received.Count >= Threshold(control3 >> 25) ? 1u << 26 : 0;
                    status |= 16 - toSend.Count >= Threshold(control3 >> 29) ? 1u << 27 : 0;
                }
                return status;
            }
        }

        private static int Threshold(uint code)
        {
            switch(code & 7)
            {
            case 0:
                return 2;
            case 1:
                return 4;
            case 2:
                return 8;
            case 3:
                return 12;
            case 4:
                return 14;
            default:
                return 16;
            }
        }

        private uint Receive()
        {
            var value = received.Count > 0 ? received.Dequeue() : (byte)0;
            Update();
            return value;
        }

        private void Send(byte value)
        {
            if(!IsOn || (control1 & TransmitterOn) == 0)
            {
                this.Log(LogLevel.Warning, "TDR written while the transmitter is off: lost");
                return;
            }
            if(toSend.Count >= Depth)
            {
                this.Log(LogLevel.Warning, "TDR written while full: lost");
                return;
            }
            toSend.Enqueue(value);
            flags &= ~TransmitComplete;
            Shift();
        }

        /// Sends up to half a FIFO at a time, in the time that it takes: one event for eight bytes keeps the
        /// emulation fast, and the receiver sees no difference.
        private void Shift()
        {
            if(sending)
            {
                return;
            }
            sending = true;
            var mine = epoch;
            var now = time.Now;
            time.At(now + ByteNs, at => ShiftOut(mine, at));
        }

        private void ShiftOut(ulong mine, ulong at)
        {
            if(mine != epoch)
            {
                return;
            }
            var count = Math.Min(toSend.Count, 8);
            for(var n = 0; n < count; n++)
            {
                var value = toSend.Dequeue();
                var listeners = CharReceived;
                if(listeners != null)
                {
                    listeners(value);
                }
            }
            // Room for the DMA first: what it adds belongs to the same stream of bits.
            Update();
            if(toSend.Count > 0)
            {
                time.At(at + (ulong)count * ByteNs, next => ShiftOut(mine, next));
            }
            else
            {
                sending = false;
                flags |= TransmitComplete;
                Update();
            }
        }

        private void Update()
        {
            ReceiveRequest.Set(IsOn && (control3 & 1u << 6) != 0 && received.Count > 0);
            TransmitRequest.Set(IsOn && (control3 & 1u << 7) != 0 && (control1 & TransmitterOn) != 0 && toSend.Count < Depth);
            var status = Status;
            var pending = false;
            pending |= (control1 & 1u << 4) != 0 && (status & Idle) != 0;
            pending |= (control1 & 1u << 5) != 0 && (status & (ReceiveNotEmpty | Overrun)) != 0;
            pending |= (control1 & 1u << 6) != 0 && (status & TransmitComplete) != 0;
            pending |= (control1 & 1u << 7) != 0 && (status & TransmitNotFull) != 0;
            pending |= (control1 & 1u << 30) != 0 && (status & 1u << 23) != 0;
            pending |= (control1 & 1u << 31) != 0 && (status & 1u << 24) != 0;
            pending |= (control3 & 1u << 28) != 0 && (status & 1u << 26) != 0;
            pending |= (control3 & 1u << 23) != 0 && (status & 1u << 27) != 0;
            pending |= (control3 & 1) != 0 && (status & (Overrun | 7)) != 0;
            IRQ.Set(pending);
        }

        private uint control1;
        private uint control2;
        private uint control3;
        private uint divisor;
        private uint prescaler;
        private uint flags;
        private bool sending;
        private ulong epoch;
        private ulong idleWatch;

        private readonly Queue<byte> toSend = new Queue<byte>();
        private readonly Queue<byte> received = new Queue<byte>();
        private readonly Rcc rcc;
        private readonly VirtualTime time;

        private static readonly int[] Prescale = { 1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256 };

        private const uint ReceiverOn = 1u << 2;
        private const uint TransmitterOn = 1u << 3;
        private const uint Overrun = 1u << 3;
        private const uint Idle = 1u << 4;
        private const uint ReceiveNotEmpty = 1u << 5;
        private const uint TransmitComplete = 1u << 6;
        private const uint TransmitNotFull = 1u << 7;
        private const uint Clearable = 0x123B5F;
    }
}
