// The robot's PLC as far as it affects the board: it gives the amplifiers their power while the board's alive line
// toggles and the E-stop loop is closed.

using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Input 0: the alive line. Output: the E-stop loop, high while closed.
    public class Plc : IPeripheral, IGPIOReceiver
    {
        public Plc(IMachine machine, Rig rig)
        {
            this.rig = rig;
            time = new VirtualTime(machine);
            EStop = new GPIO();
            rig.Opened += delegate { EStop.Set(closed); };
        }

        /// A reset of the board does not reach the PLC.
        public void Reset()
        {
        }

        public void OnGPIO(int number, bool value)
        {
            var now = time.Now;
            var gap = now - lastEdge;
            var fits = gap >= ShortestNs && gap <= LongestNs;
            if(!fits && edges > 0)
            {
                this.Log(LogLevel.Info, "alive line: {0} us between two edges", gap / 1000);
            }
            good = fits ? good + 1 : 0;
            lastEdge = now;
            edges++;
            if(firstEdge == 0)
            {
                firstEdge = now;
            }
            Judge(now);
            var mine = edges;
            time.At(now + DeadNs, at =>
            {
                if(mine == edges)
                {
                    good = 0;
                    Judge(at);
                }
            });
        }

        /// Opens the E-stop loop, or closes it.
        public void Press(bool pressed)
        {
            closed = !pressed;
            EStop.Set(closed);
            Judge(time.Now);
        }

        /// Mean frequency of the alive line in Hz.
        public double AliveHz { get { return edges < 2 || lastEdge == firstEdge ? 0.0 : (edges - 1) / 2.0 / ((lastEdge - firstEdge) * 1e-9); } }

        public GPIO EStop { get; private set; }

        private void Judge(ulong at)
        {
            rig.SetAmplifierPower(closed && good >= GoodEdges, at);
        }

        private bool closed = true;
        private int good;
        private ulong edges;
        private ulong firstEdge;
        private ulong lastEdge;

        private readonly Rig rig;
        private readonly VirtualTime time;

        private const int GoodEdges = 10;
        private const ulong ShortestNs = 200000;
        private const ulong LongestNs = 5000000;
        private const ulong DeadNs = 10000000;
    }
}
