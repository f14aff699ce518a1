// DMA1 of the STM32H7 (RM0433 chapter 15): peripheral requests, circular mode, half and full transfer flags.
//
// Renode's own moves a memory-to-peripheral transfer at once, however slow the peripheral, and knows no
// circular mode, which a receiver that never stops needs.

using System.Collections.Generic;
using System.Collections.ObjectModel;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Inputs: the request of each stream, from the multiplexer. Outputs: each stream's interrupt.
    public class Dma : IDoubleWordPeripheral, IKnownSize, IGPIOReceiver, INumberedGPIOOutput
    {
        public Dma(IMachine machine)
        {
            this.machine = machine;
            var connections = new Dictionary<int, IGPIO>();
            for(var n = 0; n < Streams; n++)
            {
                connections[n] = new GPIO();
                streams[n] = new Stream();
            }
            Connections = new ReadOnlyDictionary<int, IGPIO>(connections);
            Reset();
        }

        public void Reset()
        {
            for(var n = 0; n < Streams; n++)
            {
                var requested = streams[n].Requested;
                streams[n] = new Stream { Requested = requested, Fifo = 0x21 };
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

        public uint ReadDoubleWord(long offset)
        {
            if(offset < 8)
            {
                var value = 0u;
                for(var n = 0; n < 4; n++)
                {
                    value |= streams[(int)offset + n].Flags << Shift[n];
                }
                return value;
            }
            var stream = At(offset);
            if(stream == null)
            {
                return 0;
            }
            switch((offset - 0x10) % 0x18)
            {
            case 0x00:
                return stream.Control;
            case 0x04:
                return stream.Left;
            case 0x08:
                return stream.Peripheral;
            case 0x0C:
                return stream.Memory;
            case 0x10:
                return stream.Memory1;
            default:
                return stream.Fifo;
            }
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            if(offset == 8 || offset == 12)
            {
                for(var n = 0; n < 4; n++)
                {
                    var index = (int)(offset - 8) + n;
                    streams[index].Flags &= ~(value >> Shift[n] & 0x3D);
                    UpdateInterrupt(index);
                }
                return;
            }
            var stream = At(offset);
            if(stream == null)
            {
                this.Log(LogLevel.Warning, "unhandled write at offset 0x{0:X}, value 0x{1:X}", offset, value);
                return;
            }
            var register = (offset - 0x10) % 0x18;
            if(register != 0 && (stream.Control & 1) != 0)
            {
                this.Log(LogLevel.Warning, "register at offset 0x{0:X} written while its stream is enabled: ignored", offset);
                return;
            }
            switch(register)
            {
            case 0x00:
                WriteControl((int)(offset - 0x10) / 0x18, value);
                break;
            case 0x04:
                stream.Left = value & 0xFFFF;
                break;
            case 0x08:
                stream.Peripheral = value;
                break;
            case 0x0C:
                stream.Memory = value;
                break;
            case 0x10:
                stream.Memory1 = value;
                break;
            default:
                stream.Fifo = value;
                break;
            }
        }

        public long Size { get { return 0x400; } }

        public IReadOnlyDictionary<int, IGPIO> Connections { get; private set; }

        private Stream At(long offset)
        {
            var index = (offset - 0x10) / 0x18;
            return offset >= 0x10 && index < Streams ? streams[index] : null;
        }

        private void WriteControl(int index, uint value)
        {
            var stream = streams[index];
            var wasOn = (stream.Control & 1) != 0;
            stream.Control = value;
            if((value & 1) == 0)
            {
                if(wasOn)
                {
                    // A stream that is switched off sets its transfer-complete flag (RM0433 15.3.15).
                    stream.Flags |= Complete;
                }
            }
            else if(!wasOn)
            {
                stream.Total = stream.Left;
                stream.Done = 0;
                if((value >> 6 & 3) > 1 || (value & 1u << 18) != 0)
                {
                    this.Log(LogLevel.Warning, "stream {0}: memory to memory and double buffer are not modelled", index);
                    stream.Control &= ~1u;
                }
                if(IsUsart(stream.Peripheral) && (value & 1u << 20) == 0)
                {
                    // Without bufferable transfers a concurrent transfer can lock the stream (RM0433 15.5.5, ES0392 2.20.4).
                    this.Log(LogLevel.Warning, "stream {0}: a USART's request needs TRBUFF: not enabled", index);
                    stream.Control &= ~1u;
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
            while(stream.Requested && (stream.Control & 1) != 0 && stream.Left > 0)
            {
                Move(index, stream);
            }
            stream.Serving = false;
            UpdateInterrupt(index);
        }

        private void Move(int index, Stream stream)
        {
            var bytes = 1u << (int)(stream.Control >> 11 & 3);
            var peripheral = stream.Peripheral + ((stream.Control & 1u << 9) != 0 ? stream.Done * bytes : 0);
            var memory = stream.Memory + ((stream.Control & 1u << 10) != 0 ? stream.Done * bytes : 0);
            if(IsTightlyCoupled(memory))
            {
                // DMA1 has no way to the tightly coupled memories (RM0433 2.1, bus matrix).
                this.Log(LogLevel.Warning, "stream {0}: address 0x{1:X8} is in tightly coupled memory", index, memory);
                stream.Flags |= Failed;
                stream.Control &= ~1u;
                return;
            }
            if((stream.Control >> 6 & 3) == 0)
            {
                Write(memory, Read(peripheral, bytes), bytes);
            }
            else
            {
                Write(peripheral, Read(memory, bytes), bytes);
            }
            stream.Done++;
            stream.Left--;
            if(stream.Left == stream.Total / 2)
            {
                stream.Flags |= Half;
            }
            if(stream.Left == 0)
            {
                stream.Flags |= Complete;
                if((stream.Control & 1u << 8) != 0)
                {
                    stream.Left = stream.Total;
                    stream.Done = 0;
                }
                else
                {
                    stream.Control &= ~1u;
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
            var bus = machine.SystemBus;
            return bytes == 1 ? bus.ReadByte(address) : bytes == 2 ? bus.ReadWord(address) : bus.ReadDoubleWord(address);
        }

        private void Write(uint address, uint value, uint bytes)
        {
            var bus = machine.SystemBus;
            if(bytes == 1)
            {
                bus.WriteByte(address, (byte)value);
            }
            else if(bytes == 2)
            {
                bus.WriteWord(address, (ushort)value);
            }
            else
            {
                bus.WriteDoubleWord(address, value);
            }
        }

        private void UpdateInterrupt(int index)
        {
            var stream = streams[index];
            // DMEIE, TEIE, HTIE, TCIE sit one place below their flags.
            Connections[index].Set((stream.Flags & stream.Control << 1 & 0x3C) != 0);
        }

        private readonly IMachine machine;
        private readonly Stream[] streams = new Stream[Streams];

        private static readonly int[] Shift = { 0, 6, 16, 22 };

        private const int Streams = 8;
        private const uint Failed = 1u << 3;
        private const uint Half = 1u << 4;
        private const uint Complete = 1u << 5;

        private sealed class Stream
        {
            public uint Control;
            public uint Left;
            public uint Total;
            public uint Done;
            public uint Peripheral;
            public uint Memory;
            public uint Memory1;
            public uint Fifo;
            public uint Flags;
            public bool Requested;
            public bool Serving;
        }
    }
}
