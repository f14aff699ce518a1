// Virtual time in nanoseconds, and actions that happen at an exact instant of it.
//
// All models use these two, so that a chain of events (bit times on a bus, conversion periods) adds up
// without rounding to the instant at which Renode happened to look.

using System;
using Antmicro.Renode.Core;
using Antmicro.Renode.Peripherals.CPU;
using Antmicro.Renode.Time;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public sealed class VirtualTime
    {
        public VirtualTime(IMachine machine)
        {
            this.machine = machine;
        }

        /// Now, with the instructions of the running block counted in.
        public ulong Now
        {
            get
            {
                ICPU cpu;
                if(machine.SystemBus.TryGetCurrentCPU(out cpu))
                {
                    cpu.SyncTime();
                }
                return machine.ElapsedVirtualTime.TimeElapsed.Ticks / (TimeInterval.TicksPerSecond / 1000000000UL);
            }
        }

        /// Runs `action` when virtual time reaches `at`; what is past happens as soon as it can.
        /// The action receives its own instant.
        public void At(ulong at, Action<ulong> action)
        {
            var now = Now;
            var delay = at > now ? at - now : 1;
            machine.ScheduleAction(TimeInterval.FromTicks(delay * (TimeInterval.TicksPerSecond / 1000000000UL)), _ => action(at));
        }

        private readonly IMachine machine;
    }
}
