// The host at the other end of the USB cable: a root port, a USB stack and the class driver of a serial port (USB 2.0 chapters 7 to
// 9, CDC PSTN 1.2). It debounces, resets, reads descriptors, addresses, configures and opens the port; then bytes go by the
// bulk pipes.
//
// One transaction at a time is on the bus, as long as its bytes and the overhead of USB 2.0 table 5-9 take at 12 Mbit/s. What
// the device answers with NAK is tried again when something in the device has changed.

using System;
using System.Collections.Generic;
using System.Linq;
using Antmicro.Renode.Core;
using Antmicro.Renode.Exceptions;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public class UsbHost : IPeripheral
    {
        public UsbHost(IMachine machine, OtgFs device)
        {
            this.device = device;
            time = new VirtualTime(machine);
            State = "detached";
            Reading = true;
            device.Changed += Wake;
        }

        /// A reset of the board: the host sees the pull-up go.
        public void Reset()
        {
            Wake();
        }

        /// Plugs the cable in, or pulls it.
        public void Plug(bool plugged)
        {
            cable = plugged;
            device.Vbus = plugged;
            if(!plugged)
            {
                Detach();
            }
            Wake();
        }

        /// Suspends the bus, or resumes it.
        public void SuspendBus(bool suspend)
        {
            if(suspend && running)
            {
                running = false;
                epoch++;
                busy = false;
                resumesTo = State;
                State = "suspended";
                After(IdleNs, device.Idle);
            }
            else if(!suspend && State == "suspended")
            {
                device.Resume();
                After(ResumeNs + RecoveryNs, delegate
                {
                    State = resumesTo;
                    Run();
                });
            }
        }

        /// Resets the bus and enumerates the device again.
        public void ResetBus()
        {
            if(attached)
            {
                Begin();
            }
        }

        /// Opens the serial port, or closes it.
        public void OpenPort(bool open)
        {
            Add(Write(0x21, 0x22, open ? 3 : 0, 0, new byte[0]), transfer => State = open ? "open" : "configured");
        }

        /// Whether the host asks for data while the port is open.
        public bool Reading { get; set; }

        /// "detached", "enumerating", "configured", "open", "suspended" or "failed".
        public string State { get; private set; }

        /// Bytes to the board, as hexadecimal digits, in packets of the pipe's size.
        public void Send(string digits)
        {
            var bytes = SerialLine.FromHex(digits);
            for(var at = 0; at < bytes.Length; at += 64)
            {
                toDevice.Enqueue(bytes.Skip(at).Take(64).ToArray());
            }
            Wake();
        }

        /// One packet as it is.
        public void SendPacket(string digits)
        {
            toDevice.Enqueue(SerialLine.FromHex(digits));
            Wake();
        }

        /// Takes what the board has sent since the last call, as hexadecimal digits.
        public string Take()
        {
            return SerialLine.ToHex(TakeBytes());
        }

        public byte[] TakeBytes()
        {
            var bytes = fromDevice.ToArray();
            fromDevice.Clear();
            return bytes;
        }

        /// Queues a control transfer; `Answer` has its outcome when time has passed. `data` as hexadecimal digits; its length need not be
        /// the `length` of the request. `abandonAfter`: the host stops after so many bytes of the data stage, -1 for never.
        public void Request(int kind, int request, int value, int index, int length, string data = "", int abandonAfter = -1)
        {
            Answer = "";
            var bytes = SerialLine.FromHex(data);
            var transfer = new UsbTransfer(kind, request, value, index, length, bytes) { AbandonAfter = abandonAfter };
            Add(transfer, done => Answer = done.Outcome + (done.Received.Count > 0 ? " " + SerialLine.ToHex(done.Received.ToArray()) : ""));
        }

        /// Outcome of the last `Request`: "done" with the bytes read, "stalled", "abandoned", "given up" after 100 ms, or "broken"; empty
        /// while it is under way.
        public string Answer { get; private set; }

        /// A descriptor of the enumeration: "device", "configuration", or "string" with its number. Hexadecimal digits.
        public string Descriptor(string name)
        {
            byte[] bytes;
            return descriptors.TryGetValue(name, out bytes) ? SerialLine.ToHex(bytes) : "";
        }

        /// Packets from the device whose data PID was that of the packet before: dropped.
        public int Repeated { get; private set; }

        /// Pipes that answered STALL. They rest until CLEAR_FEATURE or SET_CONFIGURATION.
        public int Stalls { get; private set; }

        private void Wake()
        {
            if(!scheduled)
            {
                scheduled = true;
                time.At(time.Now + 1000, delegate
                {
                    scheduled = false;
                    waitsControl = waitsIn = waitsOut = false;
                    Look();
                });
            }
        }

        /// Attachment first, then the bus.
        private void Look()
        {
            var sees = cable && device.PullUp;
            if(sees && !attached)
            {
                attached = true;
                State = "enumerating";
                After(DebounceNs, Begin);
            }
            else if(!sees && attached)
            {
                Detach();
            }
            else if(running)
            {
                Transact();
            }
        }

        private void Detach()
        {
            if(attached)
            {
                this.Log(LogLevel.Info, "detached");
                epoch++;
                After(IdleNs, device.Idle);
            }
            attached = running = busy = false;
            State = "detached";
            toDevice.Clear();
            Forget();
        }

        private void Forget()
        {
            address = 0;
            current = null;
            script = null;
            waiting.Clear();
            bulkIn = bulkOut = null;
        }

        private void Begin()
        {
            epoch++;
            busy = false;
            Forget();
            State = "enumerating";
            script = Enumerate().GetEnumerator();
            DriveReset();
        }

        private void DriveReset()
        {
            running = false;
            address = 0;
            device.BeginBusReset();
            After(ResetNs, delegate
            {
                device.EndBusReset();
                After(RecoveryNs, Run);
            });
        }

        private void Run()
        {
            running = true;
            busy = false;
            Advance();
        }

        /// The next transfer: the enumeration's, then those that were asked for.
        private void Advance()
        {
            if(current == null && script != null)
            {
                if(script.MoveNext())
                {
                    var step = script.Current;
                    if(step == null)
                    {
                        DriveReset();
                        return;
                    }
                    current = step;
                }
                else
                {
                    script = null;
                }
            }
            if(current == null && script == null && waiting.Count > 0 && bulkIn != null)
            {
                var next = waiting.Dequeue();
                current = next;
                After(ControlLimitNs, delegate
                {
                    if(current == next)
                    {
                        next.GiveUp();
                        Finish();
                    }
                });
            }
            waitsControl = false;
            Transact();
        }

        /// The requests of an enumeration in their order; null is a second reset of the bus.
        private IEnumerable<UsbTransfer> Enumerate()
        {
            maxPacket0 = 8;
            var first = Read(0x80, 6, 0x0100, 0, 8);
            yield return first;
            if(!IsDone(first) || first.Received.Count != 8)
            {
                yield break;
            }
            maxPacket0 = first.Received[7];
            yield return null;
            var set = Write(0x00, 5, Address, 0, new byte[0]);
            yield return set;
            if(!IsDone(set))
            {
                yield break;
            }
            address = Address;
            var whole = Read(0x80, 6, 0x0100, 0, 18);
            yield return whole;
            var header = Read(0x80, 6, 0x0200, 0, 9);
            yield return header;
            if(!IsDone(whole) || !IsDone(header) || header.Received.Count != 9)
            {
                yield break;
            }
            var configuration = Read(0x80, 6, 0x0200, 0, header.Received[2] | header.Received[3] << 8);
            yield return configuration;
            if(!IsDone(configuration))
            {
                yield break;
            }
            descriptors["device"] = whole.Received.ToArray();
            descriptors["configuration"] = configuration.Received.ToArray();
            for(var index = 0; index <= 3; index++)
            {
                var text = Read(0x80, 6, 0x0300 | index, index == 0 ? 0 : 0x0409, 255);
                yield return text;
                descriptors["string" + index] = text.Received.ToArray();
            }
            var configure = Write(0x00, 9, configuration.Received[5], 0, new byte[0]);
            yield return configure;
            if(!IsDone(configure) || !FindPipes(configuration.Received))
            {
                yield break;
            }
            State = "configured";
            // 2,000,000 baud, 8N1; then DTR and RTS.
            var coding = Write(0x21, 0x20, 0, 0, new byte[] { 0x80, 0x84, 0x1E, 0x00, 0, 0, 8 });
            yield return coding;
            var lines = Write(0x21, 0x22, 3, 0, new byte[0]);
            yield return lines;
            if(IsDone(coding) && IsDone(lines))
            {
                State = "open";
                this.Log(LogLevel.Info, "the port is open");
            }
        }

        private bool IsDone(UsbTransfer transfer)
        {
            if(transfer.Outcome == "done")
            {
                return true;
            }
            this.Log(LogLevel.Warning, "enumeration: request 0x{0:X2}, value 0x{1:X4}: {2}", transfer.Setup[1],
                transfer.Setup[2] | transfer.Setup[3] << 8, transfer.Outcome);
            State = "failed";
            return false;
        }

        private bool FindPipes(List<byte> all)
        {
            for(var at = 0; at + 1 < all.Count && all[at] >= 2; at += all[at])
            {
                // Endpoint descriptor, bulk.
                if(all[at + 1] == 5 && at + 6 < all.Count && (all[at + 3] & 3) == 2)
                {
                    var pipe = new Pipe { Number = all[at + 2] & 15, Size = all[at + 4] | all[at + 5] << 8 };
                    if((all[at + 2] & 0x80) != 0)
                    {
                        bulkIn = pipe;
                    }
                    else
                    {
                        bulkOut = pipe;
                    }
                }
            }
            return bulkIn != null && bulkOut != null;
        }

        /// Puts one transaction on the bus: control first, the two bulk pipes in turn.
        private void Transact()
        {
            if(busy || !running)
            {
                return;
            }
            if(current != null && !waitsControl)
            {
                Occupy(current.NextLength(maxPacket0), TransactControl);
                return;
            }
            if(State != "open")
            {
                return;
            }
            var into = Reading && !waitsIn && !bulkIn.Halted;
            var outOf = toDevice.Count > 0 && !waitsOut && !bulkOut.Halted;
            if(into && (!outOf || !lastIn))
            {
                Occupy(64, TransactIn);
            }
            else if(outOf)
            {
                Occupy(toDevice.Peek().Length, TransactOut);
            }
        }

        private void Occupy(int bytes, Action action)
        {
            busy = true;
            After((13UL + (ulong)bytes) * 8000UL / 12UL, delegate
            {
                busy = false;
                action();
                Transact();
            });
        }

        private void TransactControl()
        {
            if(current == null)
            {
                return;
            }
            if(!current.Transact(device, address, maxPacket0))
            {
                waitsControl = true;
                return;
            }
            if(current.Outcome != null)
            {
                Finish();
            }
        }

        private void Finish()
        {
            var done = current;
            current = null;
            if(done.Outcome == "done")
            {
                Follow(done);
            }
            if(done.Then != null)
            {
                done.Then(done);
            }
            if(done.Setup[0] == 0 && done.Setup[1] == 5)
            {
                // The device has 2 ms until it must answer at its address (USB 2.0 section 9.2.6.3).
                running = false;
                After(2000000, Run);
                return;
            }
            Advance();
        }

        /// The host's data PIDs follow SET_CONFIGURATION and CLEAR_FEATURE(ENDPOINT_HALT).
        private void Follow(UsbTransfer done)
        {
            if(bulkIn == null)
            {
                return;
            }
            if(done.Setup[0] == 0 && done.Setup[1] == 9)
            {
                bulkIn.Begin();
                bulkOut.Begin();
            }
            if(done.Setup[0] == 2 && done.Setup[1] == 1)
            {
                var pipe = (done.Setup[4] & 0x80) != 0 ? bulkIn : bulkOut;
                if(pipe.Number == (done.Setup[4] & 15))
                {
                    pipe.Begin();
                }
            }
        }

        private void TransactIn()
        {
            lastIn = true;
            byte[] data;
            bool data1;
            switch(device.In(address, bulkIn.Number, out data, out data1))
            {
            case UsbHandshake.Ack:
                device.Acknowledged(bulkIn.Number, data.Length);
                if(data1 != bulkIn.Data1)
                {
                    Repeated++;
                    break;
                }
                bulkIn.Data1 = !bulkIn.Data1;
                fromDevice.AddRange(data);
                break;
            case UsbHandshake.Nak:
                waitsIn = true;
                break;
            case UsbHandshake.Stall:
                bulkIn.Halted = true;
                Stalls++;
                break;
            default:
                this.Log(LogLevel.Warning, "the IN pipe does not work");
                State = "failed";
                break;
            }
        }

        private void TransactOut()
        {
            lastIn = false;
            switch(device.Out(address, bulkOut.Number, bulkOut.Data1, toDevice.Peek()))
            {
            case UsbHandshake.Ack:
                bulkOut.Data1 = !bulkOut.Data1;
                toDevice.Dequeue();
                break;
            case UsbHandshake.Nak:
                waitsOut = true;
                break;
            case UsbHandshake.Stall:
                bulkOut.Halted = true;
                Stalls++;
                break;
            default:
                this.Log(LogLevel.Warning, "the OUT pipe does not work");
                State = "failed";
                break;
            }
        }

        private void Add(UsbTransfer transfer, Action<UsbTransfer> then)
        {
            if(bulkIn == null)
            {
                throw new RecoverableException("no device is configured");
            }
            transfer.Then = then;
            waiting.Enqueue(transfer);
            if(running && current == null && script == null)
            {
                time.At(time.Now + 1000, delegate
                {
                    if(running && current == null && script == null)
                    {
                        Advance();
                    }
                });
            }
        }

        private void After(ulong nanoseconds, Action action)
        {
            var mine = epoch;
            time.At(time.Now + nanoseconds, delegate
            {
                if(mine == epoch)
                {
                    action();
                }
            });
        }

        private static UsbTransfer Read(int kind, int request, int value, int index, int length)
        {
            return new UsbTransfer(kind, request, value, index, length, new byte[0]);
        }

        private static UsbTransfer Write(int kind, int request, int value, int index, byte[] data)
        {
            return new UsbTransfer(kind, request, value, index, data.Length, data);
        }

        private class Pipe
        {
            public int Number;
            public int Size;
            public bool Data1;
            public bool Halted;

            public void Begin()
            {
                Data1 = Halted = false;
            }
        }

        private bool cable;
        private bool attached;
        private bool running;
        private bool busy;
        private bool scheduled;
        private bool waitsControl;
        private bool waitsIn;
        private bool waitsOut;
        private bool lastIn;
        private int address;
        private int maxPacket0;
        private ulong epoch;
        private string resumesTo;
        private UsbTransfer current;
        private IEnumerator<UsbTransfer> script;
        private Pipe bulkIn;
        private Pipe bulkOut;

        private readonly OtgFs device;
        private readonly VirtualTime time;
        private readonly Queue<UsbTransfer> waiting = new Queue<UsbTransfer>();
        private readonly Queue<byte[]> toDevice = new Queue<byte[]>();
        private readonly List<byte> fromDevice = new List<byte>();
        private readonly Dictionary<string, byte[]> descriptors = new Dictionary<string, byte[]>();

        private const int Address = 9;
        // USB 2.0 sections 7.1.7.3, 7.1.7.5, 7.1.7.6 and 7.1.7.7.
        private const ulong DebounceNs = 100000000;
        private const ulong ResetNs = 15000000;
        private const ulong RecoveryNs = 10000000;
        private const ulong ResumeNs = 20000000;
        private const ulong IdleNs = 3000000;
        // Shorter than the 500 ms that a device may take for a data packet (section 9.2.6.4): this one has nothing to wait for.
        private const ulong ControlLimitNs = 100000000;
    }

    /// A control transfer: SETUP, data and status stage (USB 2.0 section 8.5.3).
    public class UsbTransfer
    {
        public UsbTransfer(int kind, int request, int value, int index, int length, byte[] data)
        {
            Setup = new[] { (byte)kind, (byte)request, (byte)value, (byte)(value >> 8), (byte)index, (byte)(index >> 8), (byte)length, (byte)(length >> 8) };
            this.length = length;
            this.data = data;
            AbandonAfter = -1;
        }

        /// Payload of the next transaction in bytes.
        public int NextLength(int maxPacket)
        {
            switch(stage)
            {
            case Stage.Setup:
                return 8;
            case Stage.DataIn:
                return maxPacket;
            case Stage.DataOut:
                return Math.Min(maxPacket, data.Length - sent);
            default:
                return 0;
            }
        }

        /// Executes one transaction; false where the device answered NAK. `Outcome` is set when it was the last.
        public bool Transact(OtgFs device, int address, int maxPacket)
        {
            byte[] bytes;
            bool pid;
            UsbHandshake answer;
            if(AbandonAfter >= 0 && stage != Stage.Setup && Math.Max(sent, Received.Count) >= AbandonAfter)
            {
                Outcome = "abandoned";
                return true;
            }
            switch(stage)
            {
            case Stage.Setup:
                answer = device.Setup(address, Setup);
                if(answer == UsbHandshake.Ack)
                {
                    stage = IsRead && length > 0 ? Stage.DataIn : data.Length > 0 ? Stage.DataOut : Stage.StatusIn;
                    return true;
                }
                break;
            case Stage.DataIn:
                answer = device.In(address, 0, out bytes, out pid);
                if(answer == UsbHandshake.Ack)
                {
                    device.Acknowledged(0, bytes.Length);
                    if(pid != data1)
                    {
                        Outcome = "broken: data PID";
                        return true;
                    }
                    data1 = !data1;
                    Received.AddRange(bytes);
                    if(Received.Count > length)
                    {
                        Outcome = "broken: too many bytes";
                    }
                    else if(bytes.Length < maxPacket || Received.Count == length)
                    {
                        stage = Stage.StatusOut;
                    }
                    return true;
                }
                break;
            case Stage.DataOut:
                bytes = data.Skip(sent).Take(maxPacket).ToArray();
                answer = device.Out(address, 0, data1, bytes);
                if(answer == UsbHandshake.Ack)
                {
                    data1 = !data1;
                    sent += bytes.Length;
                    stage = sent >= data.Length ? Stage.StatusIn : Stage.DataOut;
                    return true;
                }
                break;
            case Stage.StatusIn:
                answer = device.In(address, 0, out bytes, out pid);
                if(answer == UsbHandshake.Ack)
                {
                    device.Acknowledged(0, bytes.Length);
                    Outcome = bytes.Length == 0 && pid ? "done" : "broken: status stage";
                    return true;
                }
                break;
            default:
                answer = device.Out(address, 0, true, new byte[0]);
                if(answer == UsbHandshake.Ack)
                {
                    Outcome = "done";
                    return true;
                }
                break;
            }
            if(answer == UsbHandshake.Nak)
            {
                return false;
            }
            Outcome = answer == UsbHandshake.Stall ? "stalled" : "broken: no answer";
            return true;
        }

        public readonly byte[] Setup;

        public readonly List<byte> Received = new List<byte>();

        /// "done", "stalled", "abandoned", "given up", or "broken" and why; null while it is under way.
        public string Outcome { get; private set; }

        /// Bytes of the data stage after which the host begins something else; -1 for never.
        public int AbandonAfter { get; set; }

        /// The device answers NAK for too long.
        public void GiveUp()
        {
            Outcome = "given up";
        }

        public Action<UsbTransfer> Then { get; set; }

        private bool IsRead { get { return (Setup[0] & 0x80) != 0; } }

        private enum Stage
        {
            Setup,
            DataIn,
            DataOut,
            StatusIn,
            StatusOut,
        }

        private Stage stage;
        private int sent;
        private bool data1 = true;

        private readonly int length;
        private readonly byte[] data;
    }
}
