// DMA1 of the STM32H7 (RM0433 chapter 15): peripheral requests, circular mode, half and full transfer flags.
//
// Renode's own moves a memory-to-peripheral transfer at once, however slow the peripheral, and knows no
// circular mode, which a receiver that never stops needs.

using System.Collections.Generic;
using System.Collections.ObjectModel;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: the request of each stream, from the multiplexer. Outputs: each stream's interrupt.
    public class Dma : BasicDoubleWordPeripheral, IKnownSize, IGPIOReceiver, INumberedGPIOOutput
    {
        public Dma(IMachine machine) : base(machine)
        {
            var connections = new Dictionary<int, IGPIO>();
            for(var n = 0; n < Streams; n++)
            {
                connections[n] = new GPIO();
                streams[n] = new Stream();
            }
            Connections = new ReadOnlyDictionary<int, IGPIO>(connections);
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            for(var n = 0; n < Streams; n++)
            {
                streams[n].Total = streams[n].Done = streams[n].Flags = 0;
                streams[n].Serving = false;
                Connections[n].Unset();
            }
        }

        public void OnGPIO(int number, bool value)
        {
            streams[number].Requested = value;
            if(value)
            {
                Serve(number);
            }
        }

        public override void WriteDoubleWord(long offset, uint value)
        {
            var at = offset - (long)Registers.S0CR;
            var stream = at >= 0 && at / StreamBytes < Streams ? streams[at / StreamBytes] : null;
            if(stream != null && at % StreamBytes != 0 && stream.Enabled.Value)
            {
                this.Log(LogLevel.Warning, "register at offset 0x{0:X} written while its stream is enabled: ignored", offset);
                return;
            }
            base.WriteDoubleWord(offset, value);
        }

        public long Size { get { return 0x400; } }

        public IReadOnlyDictionary<int, IGPIO> Connections { get; private set; }

        private void DefineRegisters()
        {
            Registers.LISR.DefineMany(this, 2, (register, half) => register
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => Flags(4 * half), name: "FEIF, DMEIF, TEIF, HTIF, TCIF"));
            Registers.LIFCR.DefineMany(this, 2, (register, half) => register
                .WithValueField(0, 32, FieldMode.Write, writeCallback: (_, value) => ClearFlags(4 * half, (uint)value), name: "CFEIF, CDMEIF, CTEIF, CHTIF, CTCIF"));
            Registers.S0CR.DefineMany(this, Streams, (register, n) => register
                .WithFlag(0, out streams[n].Enabled, name: "EN")
                .WithFlag(1, out streams[n].DirectModeErrorEnable, name: "DMEIE")
                .WithFlag(2, out streams[n].FailedEnable, name: "TEIE")
                .WithFlag(3, out streams[n].HalfEnable, name: "HTIE")
                .WithFlag(4, out streams[n].CompleteEnable, name: "TCIE")
                .WithFlag(5, name: "PFCTRL")
                .WithValueField(6, 2, out streams[n].Direction, name: "DIR")
                .WithFlag(8, out streams[n].Circular, name: "CIRC")
                .WithFlag(9, out streams[n].PeripheralGoesOn, name: "PINC")
                .WithFlag(10, out streams[n].MemoryGoesOn, name: "MINC")
                .WithValueField(11, 2, out streams[n].Width, name: "PSIZE")
                .WithValueField(13, 2, name: "MSIZE")
                .WithFlag(15, name: "PINCOS")
                .WithValueField(16, 2, name: "PL")
                .WithFlag(18, out streams[n].DoubleBuffer, name: "DBM")
                .WithFlag(19, name: "CT")
                .WithFlag(20, out streams[n].Bufferable, name: "TRBUFF")
                .WithValueField(21, 2, name: "PBURST")
                .WithValueField(23, 2, name: "MBURST")
                .WithWriteCallback((before, _) => ControlWritten(n, (before & 1) != 0)), StreamBytes);
            Registers.S0NDTR.DefineMany(this, Streams, (register, n) => register
                .WithValueField(0, 16, out streams[n].Left, name: "NDT"), StreamBytes);
            Registers.S0PAR.DefineMany(this, Streams, (register, n) => register
                .WithValueField(0, 32, out streams[n].Peripheral, name: "PAR"), StreamBytes);
            Registers.S0M0AR.DefineMany(this, Streams, (register, n) => register
                .WithValueField(0, 32, out streams[n].Memory, name: "M0A"), StreamBytes);
            Registers.S0M1AR.DefineMany(this, Streams, (register, n) => register
                .WithValueField(0, 32, name: "M1A"), StreamBytes);
            Registers.S0FCR.DefineMany(this, Streams, (register, n) => register
                .WithValueField(0, 2, name: "FTH")
                .WithFlag(2, name: "DMDIS")
                .WithValueField(3, 3, FieldMode.Read, name: "FS")
                .WithFlag(7, name: "FEIE"), StreamBytes, resetValue: 0x21);
        }

        private uint Flags(int first)
        {
            var value = 0u;
            for(var n = 0; n < 4; n++)
            {
                value |= streams[first + n].Flags << Shift[n];
            }
            return value;
        }

        private void ClearFlags(int first, uint value)
        {
            for(var n = 0; n < 4; n++)
            {
                streams[first + n].Flags &= ~(value >> Shift[n] & 0x3D);
                UpdateInterrupt(first + n);
            }
        }

        private void ControlWritten(int index, bool wasOn)
        {
            var stream = streams[index];
            if(!stream.Enabled.Value)
            {
                if(wasOn)
                {
                    // A stream that is switched off sets its transfer-complete flag (RM0433 15.3.15).
                    stream.Flags |= Complete;
                }
            }
            else if(!wasOn)
            {
                stream.Total = (uint)stream.Left.Value;
                stream.Done = 0;
                if(stream.Direction.Value > 1 || stream.DoubleBuffer.Value)
                {
                    this.Log(LogLevel.Warning, "stream {0}: memory to memory and double buffer are not modelled", index);
                    stream.Enabled.Value = false;
                }
                if(IsUsart((uint)stream.Peripheral.Value) && !stream.Bufferable.Value)
                {
                    // Without bufferable transfers a concurrent transfer can lock the stream (RM0433 15.5.5, ES0392 2.20.4).
                    this.Log(LogLevel.Warning, "stream {0}: a USART's request needs TRBUFF: not enabled", index);
                    stream.Enabled.Value = false;
                }
                Serve(index);
            }
            UpdateInterrupt(index);
        }

        private void Serve(int index)
        {
            var stream = streams[index];
            if(stream.Serving)
            {
                return;
            }
            stream.Serving = true;
            while(stream.Requested && stream.Enabled.Value && stream.Left.Value > 0)
            {
                Move(index, stream);
            }
            stream.Serving = false;
            UpdateInterrupt(index);
        }

        private void Move(int index, Stream stream)
        {
            var bytes = 1u << (int)stream.Width.Value;
            var peripheral = (uint)stream.Peripheral.Value + (stream.PeripheralGoesOn.Value ? stream.Done * bytes : 0);
            var memory = (uint)stream.Memory.Value + (stream.MemoryGoesOn.Value ? stream.Done * bytes : 0);
            if(IsTightlyCoupled(memory))
            {
                // DMA1 has no way to the tightly coupled memories (RM0433 2.1, bus matrix).
                this.Log(LogLevel.Warning, "stream {0}: address 0x{1:X8} is in tightly coupled memory", index, memory);
                stream.Flags |= Failed;
                stream.Enabled.Value = false;
                return;
            }
            if(stream.Direction.Value == 0)
            {
                Write(memory, Read(peripheral, bytes), bytes);
            }
            else
            {
                Write(peripheral, Read(memory, bytes), bytes);
            }
            stream.Done++;
            stream.Left.Value--;
            if(stream.Left.Value == stream.Total / 2)
            {
                stream.Flags |= Half;
            }
            if(stream.Left.Value == 0)
            {
                stream.Flags |= Complete;
                if(stream.Circular.Value)
                {
                    stream.Left.Value = stream.Total;
                    stream.Done = 0;
                }
                else
                {
                    stream.Enabled.Value = false;
                }
            }
        }

        /// USART1, 2, 3, 6, UART4, 5, 7, 8 (RM0433 2.3.2).
        private static bool IsUsart(uint address)
        {
            return address >= 0x40004400 && address < 0x40005400 || address >= 0x40007800 && address < 0x40008000
                || address >= 0x40011000 && address < 0x40011800;
        }

        private static bool IsTightlyCoupled(uint address)
        {
            return address < 0x10000 || address >= 0x20000000 && address < 0x20020000;
        }

        private uint Read(uint address, uint bytes)
        {
            return bytes == 1 ? sysbus.ReadByte(address) : bytes == 2 ? sysbus.ReadWord(address) : sysbus.ReadDoubleWord(address);
        }

        private void Write(uint address, uint value, uint bytes)
        {
            if(bytes == 1)
            {
                sysbus.WriteByte(address, (byte)value);
            }
            else if(bytes == 2)
            {
                sysbus.WriteWord(address, (ushort)value);
            }
            else
            {
                sysbus.WriteDoubleWord(address, value);
            }
        }

        private void UpdateInterrupt(int index)
        {
            var stream = streams[index];
            Connections[index].Set((stream.Flags & DirectModeError) != 0 && stream.DirectModeErrorEnable.Value
                || (stream.Flags & Failed) != 0 && stream.FailedEnable.Value
                || (stream.Flags & Half) != 0 && stream.HalfEnable.Value
                || (stream.Flags & Complete) != 0 && stream.CompleteEnable.Value);
        }

        private readonly Stream[] streams = new Stream[Streams];

        private static readonly int[] Shift = { 0, 6, 16, 22 };

        private const int Streams = 8;
        private const int StreamBytes = 0x18;
        private const uint DirectModeError = 1u << 2;
        private const uint Failed = 1u << 3;
        private const uint Half = 1u << 4;
        private const uint Complete = 1u << 5;

        private sealed class Stream
        {
            public IFlagRegisterField Enabled;
            public IFlagRegisterField DirectModeErrorEnable;
            public IFlagRegisterField FailedEnable;
            public IFlagRegisterField HalfEnable;
            public IFlagRegisterField CompleteEnable;
            public IFlagRegisterField Circular;
            public IFlagRegisterField PeripheralGoesOn;
            public IFlagRegisterField MemoryGoesOn;
            public IFlagRegisterField DoubleBuffer;
            public IFlagRegisterField Bufferable;
            public IValueRegisterField Direction;
            public IValueRegisterField Width;
            public IValueRegisterField Left;
            public IValueRegisterField Peripheral;
            public IValueRegisterField Memory;
            public uint Total;
            public uint Done;
            public uint Flags;
            public bool Requested;
            public bool Serving;
        }

        private enum Registers
        {
            LISR = 0x00,
            HISR = 0x04,
            LIFCR = 0x08,
            HIFCR = 0x0C,
            S0CR = 0x10,
            S0NDTR = 0x14,
            S0PAR = 0x18,
            S0M0AR = 0x1C,
            S0M1AR = 0x20,
            S0FCR = 0x24,
        }
    }
}
