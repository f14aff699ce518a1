// What the peripherals' register blocks have in common: registers that only keep what was written, and a line in the
// log for an offset that the model does not know.

using System.Collections.Generic;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// A model names the registers that only keep their value in its constructor, and takes all others itself.
    public abstract class RegisterBlock : IDoubleWordPeripheral, IKnownSize
    {
        public virtual void Reset()
        {
            foreach(var register in resetValues)
            {
                kept[register.Key] = register.Value;
            }
        }

        public uint ReadDoubleWord(long offset)
        {
            uint value;
            if(kept.TryGetValue(offset, out value))
            {
                return value;
            }
            var read = Read(offset);
            if(read == null)
            {
                this.Log(LogLevel.Warning, "unhandled read at offset 0x{0:X}", offset);
            }
            return read ?? 0;
        }

        public void WriteDoubleWord(long offset, uint value)
        {
            if(kept.ContainsKey(offset))
            {
                kept[offset] = value;
            }
            else if(!Write(offset, value))
            {
                this.Log(LogLevel.Warning, "unhandled write at offset 0x{0:X}, value 0x{1:X}", offset, value);
            }
        }

        public long Size { get { return 0x400; } }

        /// Names a register that does nothing but keep what is written.
        protected void Keep(long offset, uint afterReset = 0)
        {
            resetValues[offset] = afterReset;
        }

        /// What a register reads as; null where the model has none.
        protected abstract uint? Read(long offset);

        /// Accepts what is written; false where the model does not have the register.
        protected abstract bool Write(long offset, uint value);

        private readonly Dictionary<long, uint> resetValues = new Dictionary<long, uint>();
        private readonly Dictionary<long, uint> kept = new Dictionary<long, uint>();
    }
}
