// The bus between an I2C controller and its chips, byte by byte.
//
// Renode's II2CPeripheral takes and gives blocks of bytes. It cannot refuse an address or a byte, and does not learn when a byte is on
// the wire. Chips of this project say more: `II2cChip`. Renode's own chips are served in blocks: they acknowledge everything, what is
// written reaches them at the repeated START or the STOP, and what is read is fetched with the first byte.

using System.Collections.Generic;
using System.Linq;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.I2C;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// The part of a chip in a transaction: Start, bytes, then Start again or Stop.
    public interface II2cBytes
    {
        /// The chip's address was called; whether it acknowledges.
        bool Start(bool read);
        /// A byte was written; whether the chip acknowledges.
        bool WriteByte(byte value);
        byte ReadByte();
        void Stop();
    }

    /// A chip that knows the bytes on the wire. With a controller of Renode's it takes blocks (`I2cBlocks`).
    public interface II2cChip : II2CPeripheral, II2cBytes
    {
    }

    /// A chip that passes the bus on, and may hold SDA low.
    public interface II2cSwitch : II2CPeripheral
    {
        IEnumerable<I2cSegment> Connected { get; }
        /// SDA is held low, so that no transfer can begin.
        bool HoldsBus { get; }
    }

    /// A piece of bus behind a switch. Chips are attached by their addresses.
    public class I2cSegment : SimpleContainer<II2CPeripheral>
    {
        public I2cSegment(IMachine machine) : base(machine)
        {
        }

        public override void Reset()
        {
        }

        public IDictionary<int, II2CPeripheral> Chips { get { return ChildCollection; } }
    }

    /// Renode's interface of a chip in terms of ours.
    public static class I2cBlocks
    {
        public static void Write(II2cChip chip, byte[] data)
        {
            var taken = chip.Start(false);
            for(var i = 0; taken && i < data.Length; i++)
            {
                taken = chip.WriteByte(data[i]);
            }
        }

        public static byte[] Read(II2cChip chip, int count)
        {
            return chip.Start(true) ? Enumerable.Range(0, count).Select(_ => chip.ReadByte()).ToArray() : new byte[0];
        }
    }

    /// What a controller does on its bus.
    public sealed class I2cTransaction
    {
        /// `chips`: those that are attached to the controller.
        public I2cTransaction(IPeripheral controller, IDictionary<int, II2CPeripheral> chips)
        {
            this.controller = controller;
            this.chips = chips;
        }

        public bool IsHeld { get { return chips.Values.OfType<II2cSwitch>().Any(chip => chip.HoldsBus); } }

        /// START and the address; whether a chip acknowledges.
        public bool Start(int address, bool read)
        {
            foreach(var chip in addressed.OfType<BlockChip>())
            {
                chip.Deliver();
            }
            talking.Clear();
            Call(chips, address, read);
            if(talking.Count > 1)
            {
                controller.Log(LogLevel.Warning, "{0} chips answer at 0x{1:X2}", talking.Count, address);
            }
            return talking.Count > 0;
        }

        public bool Write(byte value)
        {
            var acknowledged = false;
            foreach(var chip in talking)
            {
                acknowledged |= chip.WriteByte(value);
            }
            return acknowledged;
        }

        /// `expected`: as many bytes are wanted, with this one.
        public byte Read(int expected)
        {
            byte wired = 0xFF;
            foreach(var chip in talking)
            {
                var block = chip as BlockChip;
                if(block != null)
                {
                    block.Fetch(expected);
                }
                wired &= chip.ReadByte();
            }
            return wired;
        }

        public void Stop()
        {
            foreach(var chip in addressed)
            {
                chip.Stop();
            }
            addressed.Clear();
            talking.Clear();
        }

        private void Call(IDictionary<int, II2CPeripheral> reached, int address, bool read)
        {
            II2CPeripheral called;
            if(reached.TryGetValue(address, out called))
            {
                var chip = Bytes(called);
                if(chip.Start(read))
                {
                    talking.Add(chip);
                    if(!addressed.Contains(chip))
                    {
                        addressed.Add(chip);
                    }
                }
            }
            foreach(var segment in reached.Values.OfType<II2cSwitch>().SelectMany(chip => chip.Connected))
            {
                Call(segment.Chips, address, read);
            }
        }

        private II2cBytes Bytes(II2CPeripheral chip)
        {
            var own = chip as II2cChip;
            if(own != null)
            {
                return own;
            }
            BlockChip block;
            if(!blocks.TryGetValue(chip, out block))
            {
                block = new BlockChip(chip);
                blocks.Add(chip, block);
            }
            return block;
        }

        private readonly IPeripheral controller;
        private readonly IDictionary<int, II2CPeripheral> chips;
        private readonly List<II2cBytes> talking = new List<II2cBytes>();
        private readonly List<II2cBytes> addressed = new List<II2cBytes>();
        private readonly Dictionary<II2CPeripheral, BlockChip> blocks = new Dictionary<II2CPeripheral, BlockChip>();

        /// A chip that takes and gives blocks.
        private sealed class BlockChip : II2cBytes
        {
            public BlockChip(II2CPeripheral chip)
            {
                this.chip = chip;
            }

            public bool Start(bool read)
            {
                toRead.Clear();
                return true;
            }

            public bool WriteByte(byte value)
            {
                written.Add(value);
                return true;
            }

            public void Fetch(int count)
            {
                if(toRead.Count == 0)
                {
                    foreach(var value in chip.Read(count))
                    {
                        toRead.Enqueue(value);
                    }
                }
            }

            /// SDA reads high where the chip has nothing to say.
            public byte ReadByte()
            {
                return toRead.Count > 0 ? toRead.Dequeue() : (byte)0xFF;
            }

            public void Deliver()
            {
                if(written.Count > 0)
                {
                    var block = written.ToArray();
                    written.Clear();
                    chip.Write(block);
                }
            }

            public void Stop()
            {
                Deliver();
                chip.FinishTransmission();
            }

            private readonly II2CPeripheral chip;
            private readonly List<byte> written = new List<byte>();
            private readonly Queue<byte> toRead = new Queue<byte>();
        }
    }
}
