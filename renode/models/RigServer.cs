// The far end of `renode-rig`: another program moves this emulation in lock-step, over TCP, a line of text for a
// line of text. Virtual time passes only inside of `advance`.
//
//   advance NS HEX     bytes to the board, then time; answer: advanced NOW RESETS HEX and the rows of truth
//   usb                the cable is plugged in, and bytes go by USB from here on; `unplugged` is the answer of an advance in
//                      which the host lost the device
//   robot 0|1          inject NAME ARGUMENTS...          report          quit
//
// Every answer is one line; what cannot be done is answered by `failed` and the reason.

using System;
using System.Globalization;
using System.IO;
using System.Net.Sockets;
using System.Text;
using System.Threading;
using Antmicro.Renode.Core;
using Antmicro.Renode.Exceptions;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Time;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public class RigServer : IPeripheral, IDisposable
    {
        public RigServer(IMachine machine, Rig rig, SerialLine serial, UsbHost usbHost, I2cController i2c, Tca9548a mux, Plc plc,
            Nau7802 cell1, Nau7802 cell2, Nau7802 cell3, Nau7802 cell4, Nau7802 cell5, Nau7802 cell6)
        {
            this.rig = rig;
            this.serial = serial;
            this.usbHost = usbHost;
            this.i2c = i2c;
            this.mux = mux;
            this.plc = plc;
            cells = new[] { cell1, cell2, cell3, cell4, cell5, cell6 };
        }

        public void Reset()
        {
        }

        /// Connects to a program on this machine that listens at `port`, and serves it until it quits.
        /// `thenExit`: Renode ends with it.
        public void Connect(int port, bool thenExit = false)
        {
            Disconnect();
            client = new TcpClient("127.0.0.1", port) { NoDelay = true };
            rig.KeepRows = true;
            closing = false;
            thread = new Thread(() => Serve(client, thenExit)) { IsBackground = true, Name = "rig server" };
            thread.Start();
        }

        /// Lets the other program go, and waits until the step that runs is over.
        public void Disconnect()
        {
            Close();
            Join();
            rig.KeepRows = false;
        }

        /// The emulation ends. A step that runs cannot be waited for: Renode has paused it, and ends it when all machines are gone. It
        /// finds a plant that stands still (`PlantLibrary`), and its thread touches nothing after it.
        public void Dispose()
        {
            Close();
            Thread.MemoryBarrier();
            if(!stepping)
            {
                Join();
            }
        }

        private void Close()
        {
            closing = true;
            if(client != null)
            {
                client.Close();
            }
        }

        private void Join()
        {
            if(thread != null && thread != Thread.CurrentThread)
            {
                thread.Join();
            }
        }

        private void Serve(TcpClient peer, bool thenExit)
        {
            try
            {
                using(peer)
                using(var stream = peer.GetStream())
                {
                    Converse(new StreamReader(stream, Encoding.ASCII), new StreamWriter(stream, Encoding.ASCII) { AutoFlush = true, NewLine = "\n" });
                }
            }
            catch(IOException)
            {
                // The other program is gone.
            }
            catch(ObjectDisposedException)
            {
                // Closed here.
            }
            if(closing)
            {
                return;
            }
            rig.KeepRows = false;
            this.Log(LogLevel.Info, "the other program has quit");
            if(thenExit)
            {
                Emulator.Exit();
            }
        }

        private void Converse(TextReader reader, TextWriter writer)
        {
            writer.WriteLine("ready " + rig.Seed);
            while(!closing)
            {
                var line = reader.ReadLine();
                if(line == null || line == "quit")
                {
                    break;
                }
                string answer;
                try
                {
                    answer = Answer(line.Split(' '));
                }
                catch(Exception e)
                {
                    if(closing)
                    {
                        break;
                    }
                    this.Log(LogLevel.Warning, "{0}: {1}", line, e);
                    answer = "failed " + e.Message.Replace('\n', ' ');
                }
                writer.WriteLine(answer);
            }
        }

        private string Answer(string[] words)
        {
            switch(words[0])
            {
            case "advance":
                return Advance(ulong.Parse(words[1]), words.Length > 2 ? words[2] : "");
            case "usb":
                byUsb = true;
                usbHost.Plug(true);
                return "done";
            case "robot":
                rig.MoveRobot(words[1] == "1");
                return "done";
            case "inject":
                Inject(words);
                return "done";
            case "report":
                return Report();
            default:
                throw new RecoverableException("no such request: " + words[0]);
            }
        }

        private string Advance(ulong nanoseconds, string digits)
        {
            if(digits.Length > 0)
            {
                if(byUsb)
                {
                    usbHost.Send(digits);
                }
                else
                {
                    serial.Send(digits);
                }
            }
            if(nanoseconds > 0)
            {
                Step(TimeInterval.FromTicks(nanoseconds * (TimeInterval.TicksPerSecond / 1000000000UL)));
            }
            var text = new StringBuilder();
            var rows = rig.TakeRows();
            var wasOpen = portOpen;
            portOpen = usbHost.State == "open" || usbHost.State == "suspended";
            if(byUsb && wasOpen && !portOpen)
            {
                return "unplugged";
            }
            text.Append("advanced ").Append(rig.Now).Append(' ').Append(rig.Resets).Append(' ');
            var bytes = byUsb ? usbHost.TakeBytes() : serial.TakeBytes();
            text.Append(bytes.Length == 0 ? "-" : SerialLine.ToHex(bytes));
            Append(text, rig.Truth());
            text.Append(' ').Append(rows.Length);
            foreach(var row in rows)
            {
                text.Append(' ').Append(row.TimeNs).Append(row.AmplifierOn ? " 1" : " 0");
                Append(text, row.Plant);
                Append(text, row.Volts);
            }
            return text.ToString();
        }

        private void Step(TimeInterval interval)
        {
            stepping = true;
            // Either this sees `closing`, or `Dispose` sees `stepping`.
            Thread.MemoryBarrier();
            try
            {
                if(!closing)
                {
                    EmulationManager.Instance.CurrentEmulation.RunFor(interval);
                }
            }
            finally
            {
                stepping = false;
            }
            if(closing)
            {
                throw new RecoverableException("the emulation has ended, or the other program was let go");
            }
        }

        private static void Append(StringBuilder text, double[] values)
        {
            foreach(var value in values)
            {
                text.Append(' ').Append(value.ToString("R", CultureInfo.InvariantCulture));
            }
        }

        private void Inject(string[] words)
        {
            int unit;
            if(words.Length < 3 || !int.TryParse(words[2], out unit))
            {
                unit = 0;
            }
            switch(words[1])
            {
            case "unplug":
                cells[Rig.Index(unit)].Unplugged = true;
                break;
            case "plug":
                cells[Rig.Index(unit)].Nacks = false;
                cells[Rig.Index(unit)].Unplugged = false;
                break;
            case "nack":
                cells[Rig.Index(unit)].Nacks = true;
                break;
            case "stuck":
                mux.HoldSda();
                break;
            case "estop":
                plc.Press(words[2] == "1");
                break;
            case "spike":
                cells[Rig.Index(unit)].Spike = int.Parse(words[3]);
                break;
            case "pull":
                rig.PullCable(unit, double.Parse(words[3], CultureInfo.InvariantCulture));
                break;
            case "freeze":
                rig.FreezeEncoder(unit, words[3] == "1");
                break;
            case "open-bridge":
                cells[Rig.Index(unit)].OpenBridge = words[3] == "1";
                break;
            case "frozen-code":
                cells[Rig.Index(unit)].FrozenCode = words[3] == "1";
                break;
            case "wrong-sign":
                cells[Rig.Index(unit)].WrongSign = words[3] == "1";
                break;
            case "free-run":
                foreach(var cell in cells)
                {
                    cell.FreeRuns = words[2] == "1";
                }
                break;
            case "report-unsettled":
                foreach(var cell in cells)
                {
                    cell.ReportsUnsettled = words[2] == "1";
                }
                break;
            case "start-slowly":
                foreach(var cell in cells)
                {
                    cell.StartsSlowly = words[2] == "1";
                }
                break;
            case "plug-usb":
                usbHost.Plug(words[2] == "1");
                break;
            case "suspend-usb":
                usbHost.SuspendBus(words[2] == "1");
                break;
            case "read-usb":
                usbHost.Reading = words[2] == "1";
                break;
            case "bus-error":
                i2c.RaiseBusError();
                break;
            case "hang":
                rig.HangLoop();
                break;
            case "flip":
                rig.FlipBit(ulong.Parse(words[2]), int.Parse(words[3]));
                break;
            default:
                throw new RecoverableException("no such injection: " + words[1]);
            }
        }

        /// Conversions, conversions read, frequency of the alive line; then each sample's trip since the last report.
        private string Report()
        {
            var text = new StringBuilder("report " + rig.Now);
            foreach(var count in rig.Conversions)
            {
                text.Append(' ').Append(count);
            }
            foreach(var count in rig.ConversionsRead)
            {
                text.Append(' ').Append(count);
            }
            text.Append(' ').Append(plc.AliveHz.ToString("R", CultureInfo.InvariantCulture));
            var trips = rig.TakeTrips();
            text.Append(' ').Append(trips.Length);
            foreach(var trip in trips)
            {
                text.Append(' ').Append(trip.Unit + 1).Append(' ').Append(trip.ReadyNs).Append(' ').Append(trip.UpdateNs);
            }
            return text.ToString();
        }

        private readonly Rig rig;
        private TcpClient client;
        private Thread thread;
        private volatile bool closing;
        private volatile bool stepping;
        private bool byUsb;
        private bool portOpen;

        private readonly SerialLine serial;
        private readonly UsbHost usbHost;
        private readonly I2cController i2c;
        private readonly Tca9548a mux;
        private readonly Plc plc;
        private readonly Nau7802[] cells;
    }
}
