// USART of the STM32H7 (RM0433 chapter 48), asynchronous 8N1: FIFOs, DMA requests, idle line, overrun, and bytes that
// take the time of their bits.
//
// Renode's own has no FIFO, no idle flag, no transmit DMA request, and sends in no time.

using System;
using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.UART;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class Usart : BasicDoubleWordPeripheral, IUART, IKnownSize
    {
        public Usart(IMachine machine, Rcc rcc) : base(machine)
        {
            this.rcc = rcc;
            time = new VirtualTime(machine);
            IRQ = new GPIO();
            ReceiveRequest = new GPIO();
            TransmitRequest = new GPIO();
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            Clear();
            Update();
        }

        public override void WriteDoubleWord(long offset, uint value)
        {
            base.WriteDoubleWord(offset, value);
            Update();
        }

        /// A byte arrives at the RX pin.
        public void WriteChar(byte value)
        {
            if(!IsReceiving)
            {
                return;
            }
            if(received.Count >= Depth)
            {
                overrun.Value |= !overrunOff.Value;
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
                    idle.Value = true;
                    Update();
                }
            });
            Update();
        }

        public long Size { get { return 0x400; } }

        public event Action<byte> CharReceived;

        public uint BaudRate
        {
            get
            {
                var value = (uint)divisor.Value;
                if(value == 0)
                {
                    return 0;
                }
                var hz = rcc.Usart234578Hz / Prescale[Math.Min(prescaler.Value, 11)];
                // OVER8: the low nibble holds three bits, shifted right by one (RM0433 51.5.7).
                return !oversample8.Value ? (uint)(hz / value) : (uint)(2 * hz / (value & 0xFFF0 | (value & 7) << 1));
            }
        }

        public Bits StopBits { get { return Bits.One; } }

        public Parity ParityBit { get { return Parity.None; } }

        public GPIO IRQ { get; private set; }

        public GPIO ReceiveRequest { get; private set; }

        public GPIO TransmitRequest { get; private set; }

        private bool IsReceiving { get { return enabled.Value && receiverOn.Value; } }

        private bool IsTransmitting { get { return enabled.Value && transmitterOn.Value; } }

        private int Depth { get { return fifo.Value ? 16 : 1; } }

        private ulong ByteNs { get { return BaudRate == 0 ? 1000000UL : 10000000000UL / BaudRate; } }

        private bool HasReceived { get { return received.Count > 0; } }

        private bool HasRoom { get { return toSend.Count < Depth; } }

        private bool IsTransmitFifoEmpty { get { return fifo.Value && toSend.Count == 0; } }

        private bool IsReceiveFifoFull { get { return fifo.Value && received.Count >= 16; } }

        private bool IsReceiveThreshold { get { return fifo.Value && received.Count >= Threshold(receiveThreshold.Value); } }

        private bool IsTransmitThreshold { get { return fifo.Value && 16 - toSend.Count >= Threshold(transmitThreshold.Value); } }

        private void DefineRegisters()
        {
            Registers.CR1.Define(this)
                .WithFlag(0, out enabled, writeCallback: (_, on) => { if(!on) { Clear(); } }, name: "UE")
                .WithFlag(1, name: "UESM")
                .WithFlag(2, out receiverOn, name: "RE")
                .WithFlag(3, out transmitterOn, name: "TE")
                .WithFlag(4, out idleEnable, name: "IDLEIE")
                .WithFlag(5, out receivedEnable, name: "RXFNEIE")
                .WithFlag(6, out completeEnable, name: "TCIE")
                .WithFlag(7, out roomEnable, name: "TXFNFIE")
                .WithFlag(8, name: "PEIE")
                .WithFlag(9, name: "PS")
                .WithTaggedFlag("PCE", 10)
                .WithFlag(11, name: "WAKE")
                .WithTaggedFlag("M0", 12)
                .WithTaggedFlag("MME", 13)
                .WithFlag(14, name: "CMIE")
                .WithFlag(15, out oversample8, name: "OVER8")
                .WithValueField(16, 5, name: "DEDT")
                .WithValueField(21, 5, name: "DEAT")
                .WithFlag(26, name: "RTOIE")
                .WithFlag(27, name: "EOBIE")
                .WithTaggedFlag("M1", 28)
                .WithFlag(29, out fifo, name: "FIFOEN")
                .WithFlag(30, out transmitEmptyEnable, name: "TXFEIE")
                .WithFlag(31, out receiveFullEnable, name: "RXFFIE");
            Registers.CR2.Define(this)
                .WithTag("SLVEN, DIS_NSS", 0, 4)
                .WithFlag(4, name: "ADDM7")
                .WithValueField(5, 2, name: "LBDL, LBDIE")
                .WithValueField(8, 3, name: "LBCL, CPHA, CPOL")
                .WithTaggedFlag("CLKEN", 11)
                .WithValueField(12, 2, name: "STOP")
                .WithTaggedFlag("LINEN", 14)
                .WithTag("SWAP, RXINV, TXINV, DATAINV, MSBFIRST", 15, 5)
                .WithTag("ABREN, ABRMOD", 20, 3)
                .WithTaggedFlag("RTOEN", 23)
                .WithValueField(24, 8, name: "ADD");
            Registers.CR3.Define(this)
                .WithFlag(0, out errorEnable, name: "EIE")
                .WithTag("IREN, IRLP, HDSEL, NACK, SCEN", 1, 5)
                .WithFlag(6, out receiveByDma, name: "DMAR")
                .WithFlag(7, out transmitByDma, name: "DMAT")
                .WithTag("RTSE, CTSE", 8, 2)
                .WithFlag(10, name: "CTSIE")
                .WithFlag(11, name: "ONEBIT")
                .WithFlag(12, out overrunOff, name: "OVRDIS")
                .WithFlag(13, name: "DDRE")
                .WithTag("DEM, DEP", 14, 2)
                .WithValueField(17, 3, name: "SCARCNT")
                .WithValueField(20, 3, name: "WUS, WUFIE")
                .WithFlag(23, out transmitThresholdEnable, name: "TXFTIE")
                .WithFlag(24, name: "TCBGTIE")
                .WithValueField(25, 3, out receiveThreshold, name: "RXFTCFG")
                .WithFlag(28, out receiveThresholdEnable, name: "RXFTIE")
                .WithValueField(29, 3, out transmitThreshold, name: "TXFTCFG");
            Registers.BRR.Define(this)
                .WithValueField(0, 16, out divisor, name: "BRR");
            Registers.GTPR.Define(this)
                .WithValueField(0, 16, name: "PSC, GT");
            Registers.RTOR.Define(this)
                .WithValueField(0, 32, name: "RTO, BLEN");
            Registers.RQR.Define(this)
                .WithTag("ABRRQ, SBKRQ, MMRQ", 0, 3)
                .WithFlag(3, FieldMode.Write, writeCallback: (_, flush) => { if(flush) { received.Clear(); } }, name: "RXFRQ")
                .WithFlag(4, FieldMode.Write, writeCallback: (_, flush) => { if(flush) { toSend.Clear(); } }, name: "TXFRQ");
            Registers.ISR.Define(this)
                .WithTag("PE, FE, NE", 0, 3)
                .WithFlag(3, out overrun, FieldMode.Read, name: "ORE")
                .WithFlag(4, out idle, FieldMode.Read, name: "IDLE")
                .WithFlag(5, FieldMode.Read, valueProviderCallback: _ => HasReceived, name: "RXFNE")
                .WithFlag(6, out complete, FieldMode.Read, name: "TC")
                .WithFlag(7, FieldMode.Read, valueProviderCallback: _ => HasRoom, name: "TXFNF")
                .WithFlag(21, FieldMode.Read, valueProviderCallback: _ => IsTransmitting, name: "TEACK")
                .WithFlag(22, FieldMode.Read, valueProviderCallback: _ => IsReceiving, name: "REACK")
                .WithFlag(23, FieldMode.Read, valueProviderCallback: _ => IsTransmitFifoEmpty, name: "TXFE")
                .WithFlag(24, FieldMode.Read, valueProviderCallback: _ => IsReceiveFifoFull, name: "RXFF")
                .WithFlag(26, FieldMode.Read, valueProviderCallback: _ => IsReceiveThreshold, name: "RXFT")
                .WithFlag(27, FieldMode.Read, valueProviderCallback: _ => IsTransmitThreshold, name: "TXFT");
            Registers.ICR.Define(this)
                .WithValueField(0, 3, FieldMode.Write, name: "PECF, FECF, NECF")
                .WithFlag(3, FieldMode.Write, writeCallback: (_, clear) => overrun.Value &= !clear, name: "ORECF")
                .WithFlag(4, FieldMode.Write, writeCallback: (_, clear) => idle.Value &= !clear, name: "IDLECF")
                .WithFlag(5, FieldMode.Write, name: "TXFECF")
                .WithFlag(6, FieldMode.Write, writeCallback: (_, clear) => complete.Value &= !clear, name: "TCCF")
                .WithValueField(7, 14, FieldMode.Write, name: "TCBGTCF to WUCF");
            Registers.RDR.Define(this)
                .WithValueField(0, 9, FieldMode.Read, valueProviderCallback: _ => Receive(), name: "RDR");
            Registers.TDR.Define(this)
                .WithValueField(0, 9, FieldMode.Write, writeCallback: (_, value) => Send((byte)value), name: "TDR");
            Registers.PRESC.Define(this)
                .WithValueField(0, 4, out prescaler, name: "PRESCALER");
        }

        private void Clear()
        {
            toSend.Clear();
            received.Clear();
            sending = false;
            overrun.Value = idle.Value = false;
            complete.Value = true;
            epoch++;
        }

        private static int Threshold(ulong code)
        {
            switch(code)
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
            if(!IsTransmitting)
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
            complete.Value = false;
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
                complete.Value = true;
                Update();
            }
        }

        private void Update()
        {
            ReceiveRequest.Set(enabled.Value && receiveByDma.Value && HasReceived);
            TransmitRequest.Set(IsTransmitting && transmitByDma.Value && HasRoom);
            IRQ.Set(idleEnable.Value && idle.Value
                || receivedEnable.Value && (HasReceived || overrun.Value)
                || completeEnable.Value && complete.Value
                || roomEnable.Value && HasRoom
                || transmitEmptyEnable.Value && IsTransmitFifoEmpty
                || receiveFullEnable.Value && IsReceiveFifoFull
                || receiveThresholdEnable.Value && IsReceiveThreshold
                || transmitThresholdEnable.Value && IsTransmitThreshold
                || errorEnable.Value && overrun.Value);
        }

        private bool sending;
        private ulong epoch;
        private ulong idleWatch;

        private IFlagRegisterField enabled;
        private IFlagRegisterField receiverOn;
        private IFlagRegisterField transmitterOn;
        private IFlagRegisterField idleEnable;
        private IFlagRegisterField receivedEnable;
        private IFlagRegisterField completeEnable;
        private IFlagRegisterField roomEnable;
        private IFlagRegisterField oversample8;
        private IFlagRegisterField fifo;
        private IFlagRegisterField transmitEmptyEnable;
        private IFlagRegisterField receiveFullEnable;
        private IFlagRegisterField errorEnable;
        private IFlagRegisterField receiveByDma;
        private IFlagRegisterField transmitByDma;
        private IFlagRegisterField overrunOff;
        private IFlagRegisterField transmitThresholdEnable;
        private IFlagRegisterField receiveThresholdEnable;
        private IValueRegisterField receiveThreshold;
        private IValueRegisterField transmitThreshold;
        private IValueRegisterField divisor;
        private IValueRegisterField prescaler;
        private IFlagRegisterField overrun;
        private IFlagRegisterField idle;
        private IFlagRegisterField complete;

        private readonly Queue<byte> toSend = new Queue<byte>();
        private readonly Queue<byte> received = new Queue<byte>();
        private readonly Rcc rcc;
        private readonly VirtualTime time;

        private static readonly int[] Prescale = { 1, 2, 4, 6, 8, 10, 12, 16, 32, 64, 128, 256 };

        private enum Registers
        {
            CR1 = 0x00,
            CR2 = 0x04,
            CR3 = 0x08,
            BRR = 0x0C,
            GTPR = 0x10,
            RTOR = 0x14,
            RQR = 0x18,
            ISR = 0x1C,
            ICR = 0x20,
            RDR = 0x24,
            TDR = 0x28,
            PRESC = 0x2C,
        }
    }
}
