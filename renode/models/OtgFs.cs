// USB OTG core of the STM32H7 as a full-speed device (RM0433 chapter 57): registers, FIFOs, endpoints and what they answer to a
// host. `UsbHost` is the other end of the cable.
//
// Written from the manual. Not modelled: host mode, DMA, high speed, isochronous endpoints, LPM, remote wake-up, the
// interrupt of SOF. Where the manual is silent: OUT endpoint 0 stays enabled over SETUP, and a packet count that was never written
// ends no transfer but by a short packet, as drivers for this release of the core (3.30a) expect.

using System;
using System.Collections.Generic;
using Antmicro.Renode.Core;
using Antmicro.Renode.Core.Structure.Registers;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// What the device answers to a token.
    public enum UsbHandshake
    {
        Ack,
        Nak,
        Stall,
        /// Address or endpoint is not there.
        Silence,
    }

    [AllowedTranslations(AllowedTranslation.ByteToDoubleWord | AllowedTranslation.WordToDoubleWord)]
    public class OtgFs : BasicDoubleWordPeripheral, IKnownSize
    {
        public OtgFs(IMachine machine) : base(machine)
        {
            time = new VirtualTime(machine);
            IRQ = new GPIO();
            for(var n = 0; n < Endpoints; n++)
            {
                ins[n] = new UsbEndpoint(n, true);
                outs[n] = new UsbEndpoint(n, false);
                transmit[n] = new Queue<uint>();
            }
            DefineRegisters();
            Reset();
        }

        public override void Reset()
        {
            base.Reset();
            latched = 0;
            suspended = false;
            address = 0;
            addressWaits = false;
            setupOpen = false;
            received.Clear();
            open.Clear();
            for(var n = 0; n < Endpoints; n++)
            {
                ins[n].Reset();
                outs[n].Reset();
                transmit[n].Clear();
            }
            Update();
        }

        public override uint ReadDoubleWord(long offset)
        {
            if(offset < Fifo)
            {
                var value = base.ReadDoubleWord(offset);
                Update();
                return value;
            }
            if(open.Count == 0)
            {
                this.Log(LogLevel.Warning, "FIFO read beyond the packet");
                return 0;
            }
            return open.Dequeue();
        }

        public override void WriteDoubleWord(long offset, uint value)
        {
            if(offset < Fifo)
            {
                base.WriteDoubleWord(offset, value);
            }
            else
            {
                Push((int)((offset - Fifo) / Fifo), value);
            }
            Update();
        }

        public long Size { get { return 0x40000; } }

        public GPIO IRQ { get; private set; }

        /// An endpoint or the pull-up may answer otherwise than before.
        public event Action Changed;

        // The bus.

        /// VBUS at the socket.
        public bool Vbus { get; set; }

        /// The pull-up shows a full-speed device: transceiver on, session valid, no soft disconnect (57.14.11, 57.14.36).
        public bool PullUp
        {
            get { return transceiverOn.Value && !softDisconnect.Value && SessionValid; }
        }

        public bool IsSuspended { get { return suspended; } }

        /// The host drives a reset: endpoints other than 0 leave the configuration (57.14.53, USBAEP).
        public void BeginBusReset()
        {
            latched |= UsbReset;
            suspended = false;
            setupOpen = false;
            addressWaits = false;
            for(var n = 0; n < Endpoints; n++)
            {
                ins[n].BusReset();
                outs[n].BusReset();
            }
            Update();
        }

        /// The reset is over and the speed is known.
        public void EndBusReset()
        {
            latched |= EnumerationDone;
            framesFrom = time.Now;
            Update();
        }

        /// No activity for 3 ms.
        public void Idle()
        {
            if(!suspended)
            {
                suspended = true;
                latched |= EarlySuspend | Suspend;
                Update();
            }
        }

        public void Resume()
        {
            if(suspended)
            {
                suspended = false;
                latched |= WakeUp;
                Update();
            }
        }

        /// A SETUP packet: taken whatever NAK and STALL say; NAK is set in both directions (57.15.6).
        public UsbHandshake Setup(int to, byte[] data)
        {
            if(to != address)
            {
                return UsbHandshake.Silence;
            }
            ins[0].Nak = outs[0].Nak = true;
            ins[0].Stall = outs[0].Stall = false;
            // Data and status stage begin with DATA1 (USB 2.0 section 8.5.3).
            ins[0].Data1 = outs[0].Data1 = true;
            setupOpen = true;
            addressWaits = true;
            Receive(SetupPacket, 0, false, data);
            return UsbHandshake.Ack;
        }

        public UsbHandshake Out(int to, int number, bool data1, byte[] data)
        {
            if(to != address || !outs[number].Active)
            {
                return UsbHandshake.Silence;
            }
            EndSetupStage(number);
            var endpoint = outs[number];
            if(endpoint.Stall)
            {
                return UsbHandshake.Stall;
            }
            var words = (data.Length + 3) / 4;
            // Room for SETUP packets and status entries is kept free (57.11.3).
            var room = ReceivedWords + words + 1 + 13 <= (int)receiveDepth.Value;
            if(!endpoint.Enabled || endpoint.Nak || !room)
            {
                return UsbHandshake.Nak;
            }
            if(data1 != endpoint.Data1)
            {
                // Sent again: acknowledged and dropped.
                return UsbHandshake.Ack;
            }
            endpoint.Data1 = !data1;
            var over = endpoint.Transferred(data.Length) || data.Length < endpoint.MaxPacket;
            if(over)
            {
                endpoint.Nak = true;
                endpoint.Enabled = false;
            }
            Receive(OutPacket, number, data1, data);
            if(over)
            {
                Receive(OutDone, number, data1, new byte[0]);
            }
            return UsbHandshake.Ack;
        }

        /// `data` and `data1` are what goes out with `Ack`; it stays in the FIFO until `Acknowledged`.
        public UsbHandshake In(int to, int number, out byte[] data, out bool data1)
        {
            data = new byte[0];
            data1 = false;
            if(to != address || !ins[number].Active)
            {
                return UsbHandshake.Silence;
            }
            EndSetupStage(number);
            var endpoint = ins[number];
            if(endpoint.Stall)
            {
                return UsbHandshake.Stall;
            }
            if(!endpoint.Enabled || endpoint.Nak || endpoint.Packets == 0)
            {
                return UsbHandshake.Nak;
            }
            var length = Math.Min(endpoint.Bytes, endpoint.MaxPacket);
            var words = transmit[endpoint.FifoNumber].ToArray();
            if(words.Length * 4 < length)
            {
                endpoint.Interrupt |= TokenWhileEmpty;
                Update();
                return UsbHandshake.Nak;
            }
            data = new byte[length];
            for(var i = 0; i < length; i++)
            {
                data[i] = (byte)(words[i / 4] >> 8 * (i % 4));
            }
            data1 = endpoint.Data1;
            return UsbHandshake.Ack;
        }

        /// The host acknowledged the packet that an IN token brought.
        public void Acknowledged(int number, int length)
        {
            var endpoint = ins[number];
            endpoint.Data1 = !endpoint.Data1;
            for(var i = 0; i < (length + 3) / 4; i++)
            {
                transmit[endpoint.FifoNumber].Dequeue();
            }
            if(endpoint.Transferred(length))
            {
                endpoint.Enabled = false;
                endpoint.Interrupt |= TransferComplete;
            }
            if(number == 0 && length == 0 && addressWaits)
            {
                // The new address holds from the status stage on (57.15.6, SetAddress).
                addressWaits = false;
                address = WantedAddress;
            }
            Update();
        }

        private bool SessionValid
        {
            get
            {
                return sessionOverride.Value ? sessionOverrideValue.Value : Vbus && supplyDetection.Value;
            }
        }

        private int WantedAddress { get { return (int)wantedAddress.Value; } }

        private int ReceivedWords
        {
            get
            {
                var words = open.Count;
                foreach(var entry in received)
                {
                    words += 1 + entry.Words.Length;
                }
                return words;
            }
        }

        private uint Status
        {
            get
            {
                var status = latched | 1u << 5;
                if(received.Count > 0)
                {
                    status |= 1u << 4;
                }
                var endpoints = EndpointInterrupts & endpointMask.Value;
                if((endpoints & 0xFFFF) != 0)
                {
                    status |= 1u << 18;
                }
                if(endpoints >> 16 != 0)
                {
                    status |= 1u << 19;
                }
                return status;
            }
        }

        private uint EndpointInterrupts
        {
            get
            {
                var bits = 0u;
                for(var n = 0; n < Endpoints; n++)
                {
                    var inMask = (uint)inMaskAll.Value & ~FifoEmpty | ((emptyMask.Value >> n & 1) != 0 ? FifoEmpty : 0);
                    bits |= (InInterrupt(n) & inMask) != 0 ? 1u << n : 0;
                    bits |= (outs[n].Interrupt & outMaskAll.Value) != 0 ? 1u << 16 + n : 0;
                }
                return bits;
            }
        }

        private uint InInterrupt(int n)
        {
            return ins[n].Interrupt | (transmit[ins[n].FifoNumber].Count == 0 ? FifoEmpty : 0);
        }

        private void EndSetupStage(int number)
        {
            if(number == 0 && setupOpen)
            {
                setupOpen = false;
                Receive(SetupDone, 0, false, new byte[0]);
            }
        }

        private void Receive(uint kind, int number, bool data1, byte[] data)
        {
            var entry = new Entry { Kind = kind, Endpoint = number, Words = new uint[(data.Length + 3) / 4] };
            entry.Status = kind << 17 | (data1 ? 2u << 15 : 0) | (uint)data.Length << 4 | (uint)number;
            for(var i = 0; i < data.Length; i++)
            {
                entry.Words[i / 4] |= (uint)data[i] << 8 * (i % 4);
            }
            received.Enqueue(entry);
            Update();
        }

        private uint Pop()
        {
            if(received.Count == 0)
            {
                return 0;
            }
            if(open.Count > 0)
            {
                this.Log(LogLevel.Warning, "GRXSTSP read while {0} words of the packet before are unread", open.Count);
            }
            var entry = received.Dequeue();
            open.Clear();
            foreach(var word in entry.Words)
            {
                open.Enqueue(word);
            }
            if(entry.Kind == SetupDone)
            {
                outs[0].Interrupt |= SetupPhaseDone;
            }
            else if(entry.Kind == OutDone)
            {
                outs[entry.Endpoint].Interrupt |= TransferComplete;
            }
            RaiseChanged();
            return entry.Status;
        }

        private void Push(int number, uint word)
        {
            if(number >= Endpoints)
            {
                this.Log(LogLevel.Warning, "write to the FIFO of endpoint {0}, which is not there", number);
                return;
            }
            var fifo = transmit[ins[number].FifoNumber];
            if(fifo.Count >= Depth(ins[number].FifoNumber))
            {
                this.Log(LogLevel.Warning, "transmit FIFO {0} overflows", ins[number].FifoNumber);
                return;
            }
            fifo.Enqueue(word);
            RaiseChanged();
        }

        private int Depth(int fifo)
        {
            return (int)transmitDepth[fifo].Value;
        }

        /// The core's state; PHY selection, device speed and power control stay (57.14.5).
        private void SoftReset()
        {
            latched = 0;
            FlushReceived();
            for(var n = 0; n < Endpoints; n++)
            {
                ins[n].Reset();
                outs[n].Reset();
                transmit[n].Clear();
            }
        }

        private void FlushReceived()
        {
            received.Clear();
            open.Clear();
        }

        private void ResetWritten(uint value)
        {
            if((value & 1u << 5) != 0)
            {
                var which = (int)(value >> 6 & 0x1F);
                for(var n = 0; n < Endpoints; n++)
                {
                    if(which == 0x10 || which == n)
                    {
                        transmit[n].Clear();
                    }
                }
            }
            RaiseChanged();
        }

        private uint FreeWords(int fifo)
        {
            return (uint)Math.Max(0, Depth(fifo) - transmit[fifo].Count);
        }

        private void WriteControl(UsbEndpoint endpoint, uint value)
        {
            if((value & 1u << 26) != 0 && (value & 1u << 27) != 0)
            {
                this.Log(LogLevel.Warning, "CNAK and SNAK of endpoint {0} in one write", endpoint.Number);
            }
            endpoint.Control = value;
            if(value >> 31 != 0 && endpoint.IsIn)
            {
                var start = transmitStart[endpoint.FifoNumber].Value;
                if(start < receiveDepth.Value || start + transmitDepth[endpoint.FifoNumber].Value > FifoWords)
                {
                    this.Log(LogLevel.Warning, "transmit FIFO {0} overlaps the receive FIFO or the end of the memory", endpoint.FifoNumber);
                }
            }
            RaiseChanged();
        }

        private void RaiseChanged()
        {
            if(Changed != null)
            {
                Changed();
            }
        }

        private void Update()
        {
            IRQ.Set(interruptEnable.Value && (Status & mask.Value) != 0);
        }

        private void DefineRegisters()
        {
            Registers.GOTGCTL.Define(this)
                .WithFlag(2, name: "VBVALOEN")
                .WithFlag(3, name: "VBVALOVAL")
                .WithFlag(4, name: "AVALOEN")
                .WithFlag(5, name: "AVALOVAL")
                .WithFlag(6, out sessionOverride, name: "BVALOEN")
                .WithFlag(7, out sessionOverrideValue, name: "BVALOVAL")
                .WithTag("HNPRQ, HSHNPEN, DHNPEN, EHEN", 9, 4)
                .WithFlag(16, FieldMode.Read, valueProviderCallback: _ => true, name: "CIDSTS")
                .WithFlag(19, FieldMode.Read, valueProviderCallback: _ => SessionValid, name: "BSVLD")
                .WithFlag(20, name: "OTGVER")
                .WithWriteCallback((_, __) => RaiseChanged());
            Registers.GOTGINT.Define(this)
                .WithValueField(0, 32, name: "SEDET to IDCHNG");
            Registers.GAHBCFG.Define(this)
                .WithFlag(0, out interruptEnable, name: "GINTMSK")
                .WithTag("HBSTLEN, DMAEN", 1, 5)
                .WithFlag(7, name: "TXFELVL")
                .WithFlag(8, name: "PTXFELVL");
            Registers.GUSBCFG.Define(this, 0x1440)
                .WithValueField(0, 32, name: "TOCAL to FDMOD");
            Registers.GRSTCTL.Define(this)
                .WithFlag(0, FieldMode.Write, writeCallback: (_, reset) => { if(reset) { SoftReset(); } }, name: "CSRST")
                .WithTaggedFlag("PSRST", 1)
                .WithFlag(4, FieldMode.Write, writeCallback: (_, flush) => { if(flush) { FlushReceived(); } }, name: "RXFFLSH")
                .WithFlag(5, FieldMode.Write, name: "TXFFLSH")
                .WithValueField(6, 5, FieldMode.Write, name: "TXFNUM")
                .WithFlag(31, FieldMode.Read, valueProviderCallback: _ => true, name: "AHBIDL")
                .WithWriteCallback((_, value) => ResetWritten(value));
            Registers.GINTSTS.Define(this)
                .WithValueField(0, 32, writeCallback: (_, value) => latched &= ~((uint)value & 0xF870FC0A), valueProviderCallback: _ => Status,
                    name: "CMOD to WKUPINT");
            Registers.GINTMSK.Define(this)
                .WithValueField(0, 32, out mask, name: "MMISM to WUIM");
            Registers.GRXSTSR.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => received.Count > 0 ? received.Peek().Status : 0,
                    name: "EPNUM, BCNT, DPID, PKTSTS");
            Registers.GRXSTSP.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => Pop(), name: "EPNUM, BCNT, DPID, PKTSTS");
            Registers.GRXFSIZ.Define(this, 0x200)
                .WithValueField(0, 16, out receiveDepth, name: "RXFD");
            Registers.DIEPTXF0.Define(this, 0x02000200)
                .WithValueField(0, 16, out transmitStart[0], name: "TX0FSA")
                .WithValueField(16, 16, out transmitDepth[0], name: "TX0FD");
            Registers.HNPTXSTS.Define(this, 0x00080200)
                .WithTag("NPTXFSAV, NPTQXSAV, NPTXQTOP", 0, 31);
            Registers.GCCFG.Define(this)
                .WithTag("DCDET, PDET, SDET, PS2DET", 0, 4)
                .WithFlag(16, out transceiverOn, name: "PWRDWN")
                .WithTag("BCDEN, DCDEN, PDEN, SDEN", 17, 4)
                .WithFlag(21, out supplyDetection, name: "VBDEN")
                .WithWriteCallback((_, __) => RaiseChanged());
            Registers.CID.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => 0x00002300, name: "PRODUCT_ID");
            Registers.GSNPSID.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => 0x4F54330A, name: "GSNPSID");
            Registers.GLPMCFG.Define(this)
                .WithValueField(0, 32, name: "LPMEN to ENBESL");
            Registers.DIEPTXF1.DefineMany(this, Endpoints - 1, (register, n) => register
                .WithValueField(0, 16, out transmitStart[n + 1], name: "INEPTXSA")
                .WithValueField(16, 16, out transmitDepth[n + 1], name: "INEPTXFD"));
            Registers.DCFG.Define(this, 0x02200000)
                .WithValueField(0, 2, name: "DSPD")
                .WithFlag(2, name: "NZLSOHSK")
                .WithValueField(4, 7, out wantedAddress, writeCallback: (_, __) => AddressWritten(), name: "DAD")
                .WithValueField(11, 2, name: "PFIVL")
                .WithFlag(15, name: "ERRATIM")
                .WithValueField(16, 16, name: "PERSCHIVL");
            Registers.DCTL.Define(this, 0x2)
                .WithTaggedFlag("RWUSIG", 0)
                .WithFlag(1, out softDisconnect, name: "SDIS")
                .WithTag("GINSTS, GONSTS, TCTL", 2, 5)
                .WithFlag(7, FieldMode.Write, name: "SGINAK")
                .WithFlag(8, FieldMode.Write, name: "CGINAK")
                .WithFlag(9, FieldMode.Write, name: "SGONAK")
                .WithFlag(10, FieldMode.Write, name: "CGONAK")
                .WithFlag(11, name: "POPRGDNE")
                .WithWriteCallback((_, __) => RaiseChanged());
            Registers.DSTS.Define(this)
                .WithFlag(0, FieldMode.Read, valueProviderCallback: _ => suspended, name: "SUSPSTS")
                .WithValueField(1, 2, FieldMode.Read, valueProviderCallback: _ => 3, name: "ENUMSPD")
                .WithTaggedFlag("EERR", 3)
                .WithValueField(8, 14, FieldMode.Read, valueProviderCallback: _ => FrameNumber, name: "FNSOF");
            Registers.DIEPMSK.Define(this)
                .WithValueField(0, 32, out inMaskAll, name: "XFRCM to NAKM");
            Registers.DOEPMSK.Define(this)
                .WithValueField(0, 32, out outMaskAll, name: "XFRCM to NYETMSK");
            Registers.DAINT.Define(this)
                .WithValueField(0, 32, FieldMode.Read, valueProviderCallback: _ => EndpointInterrupts, name: "IEPINT, OEPINT");
            Registers.DAINTMSK.Define(this)
                .WithValueField(0, 32, out endpointMask, name: "IEPM, OEPM");
            Registers.DIEPEMPMSK.Define(this)
                .WithValueField(0, 16, out emptyMask, name: "INEPTXFEM");
            Registers.PCGCCTL.Define(this, 0x200B8000)
                .WithValueField(0, 32, name: "STPPCLK to SUSP");
            DefineEndpoints(ins, Registers.DIEPCTL0, Registers.DIEPINT0, Registers.DIEPTSIZ0, Registers.DIEPDMA0);
            DefineEndpoints(outs, Registers.DOEPCTL0, Registers.DOEPINT0, Registers.DOEPTSIZ0, Registers.DOEPDMA0);
            Registers.DTXFSTS0.DefineMany(this, Endpoints, (register, n) => register
                .WithValueField(0, 16, FieldMode.Read, valueProviderCallback: _ => FreeWords(ins[n].FifoNumber), name: "INEPTFSAV"), EndpointBytes);
        }

        /// The fields of an endpoint depend on each other: `UsbEndpoint` has them.
        private void DefineEndpoints(UsbEndpoint[] endpoints, Registers control, Registers interrupt, Registers size, Registers memory)
        {
            control.DefineMany(this, Endpoints, (register, n) => register
                .WithValueField(0, 32, writeCallback: (_, value) => WriteControl(endpoints[n], (uint)value),
                    valueProviderCallback: _ => endpoints[n].Control, name: "MPSIZ to EPENA"), EndpointBytes);
            interrupt.DefineMany(this, Endpoints, (register, n) => register
                .WithValueField(0, 32, writeCallback: (_, value) => endpoints[n].Interrupt &= ~(uint)value,
                    valueProviderCallback: _ => endpoints[n].IsIn ? InInterrupt(n) : endpoints[n].Interrupt, name: "XFRC to NYET"), EndpointBytes);
            size.DefineMany(this, Endpoints, (register, n) => register
                .WithValueField(0, 32, writeCallback: (_, value) => endpoints[n].Size = (uint)value,
                    valueProviderCallback: _ => endpoints[n].Size, name: "XFRSIZ, PKTCNT"), EndpointBytes);
            memory.DefineMany(this, Endpoints, (register, n) => register
                .WithValueField(0, 32, name: "DMAADDR"), EndpointBytes);
        }

        private void AddressWritten()
        {
            // DAD 0 holds at once; another address waits for the status stage of SET_ADDRESS.
            if(WantedAddress == 0 || !addressWaits)
            {
                address = WantedAddress;
            }
        }

        private uint FrameNumber { get { return (uint)((time.Now - framesFrom) / 1000000UL) & 0x3FFF; } }

        private class Entry
        {
            public uint Kind;
            public int Endpoint;
            public uint Status;
            public uint[] Words;
        }

        private uint latched;
        private bool suspended;
        private int address;
        private bool addressWaits;
        private bool setupOpen;
        private ulong framesFrom;

        private IFlagRegisterField sessionOverride;
        private IFlagRegisterField sessionOverrideValue;
        private IFlagRegisterField interruptEnable;
        private IFlagRegisterField transceiverOn;
        private IFlagRegisterField supplyDetection;
        private IFlagRegisterField softDisconnect;
        private IValueRegisterField mask;
        private IValueRegisterField receiveDepth;
        private IValueRegisterField wantedAddress;
        private IValueRegisterField inMaskAll;
        private IValueRegisterField outMaskAll;
        private IValueRegisterField endpointMask;
        private IValueRegisterField emptyMask;

        private readonly VirtualTime time;
        private readonly UsbEndpoint[] ins = new UsbEndpoint[Endpoints];
        private readonly UsbEndpoint[] outs = new UsbEndpoint[Endpoints];
        private readonly IValueRegisterField[] transmitStart = new IValueRegisterField[Endpoints];
        private readonly IValueRegisterField[] transmitDepth = new IValueRegisterField[Endpoints];
        private readonly Queue<uint>[] transmit = new Queue<uint>[Endpoints];
        private readonly Queue<Entry> received = new Queue<Entry>();
        private readonly Queue<uint> open = new Queue<uint>();

        private const int Endpoints = 9;
        private const int EndpointBytes = 0x20;
        private const int Fifo = 0x1000;
        private const int FifoWords = 1024;

        // GINTSTS.
        private const uint EarlySuspend = 1u << 10;
        private const uint Suspend = 1u << 11;
        private const uint UsbReset = 1u << 12;
        private const uint EnumerationDone = 1u << 13;
        private const uint WakeUp = 1u << 31;

        // DIEPINT, DOEPINT.
        private const uint TransferComplete = 1u << 0;
        private const uint SetupPhaseDone = 1u << 3;
        private const uint TokenWhileEmpty = 1u << 4;
        private const uint FifoEmpty = 1u << 7;

        // PKTSTS (57.14.7).
        private const uint OutPacket = 2;
        private const uint OutDone = 3;
        private const uint SetupDone = 4;
        private const uint SetupPacket = 6;

        private enum Registers : long
        {
            GOTGCTL = 0x000,
            GOTGINT = 0x004,
            GAHBCFG = 0x008,
            GUSBCFG = 0x00C,
            GRSTCTL = 0x010,
            GINTSTS = 0x014,
            GINTMSK = 0x018,
            GRXSTSR = 0x01C,
            GRXSTSP = 0x020,
            GRXFSIZ = 0x024,
            DIEPTXF0 = 0x028,
            HNPTXSTS = 0x02C,
            GCCFG = 0x038,
            CID = 0x03C,
            GSNPSID = 0x040,
            GLPMCFG = 0x054,
            DIEPTXF1 = 0x104,
            DCFG = 0x800,
            DCTL = 0x804,
            DSTS = 0x808,
            DIEPMSK = 0x810,
            DOEPMSK = 0x814,
            DAINT = 0x818,
            DAINTMSK = 0x81C,
            DIEPEMPMSK = 0x834,
            DIEPCTL0 = 0x900,
            DIEPINT0 = 0x908,
            DIEPTSIZ0 = 0x910,
            DIEPDMA0 = 0x914,
            DTXFSTS0 = 0x918,
            DOEPCTL0 = 0xB00,
            DOEPINT0 = 0xB08,
            DOEPTSIZ0 = 0xB10,
            DOEPDMA0 = 0xB14,
            PCGCCTL = 0xE00,
        }
    }

    /// One endpoint in one direction: control register, transfer size, interrupts (57.14.53 to 57.14.67).
    public class UsbEndpoint
    {
        public UsbEndpoint(int number, bool isIn)
        {
            Number = number;
            IsIn = isIn;
        }

        public void Reset()
        {
            settings = 0;
            Enabled = Nak = Stall = Data1 = disabling = false;
            Size = 0;
            Interrupt = 0;
        }

        public void BusReset()
        {
            settings &= ~(1u << 15);
            Stall = false;
        }

        /// DIEPCTL or DOEPCTL.
        public uint Control
        {
            get
            {
                return settings | (Number == 0 ? 1u << 15 : 0) | (Data1 ? 1u << 16 : 0) | (Nak ? 1u << 17 : 0) | (Stall ? 1u << 21 : 0)
                    | (disabling ? 1u << 30 : 0) | (Enabled ? 1u << 31 : 0);
            }

            set
            {
                settings = value & 0x03CC87FF;
                // The application cannot clear STALL of endpoint 0; SETUP does.
                Stall = (value & 1u << 21) != 0 || Number == 0 && Stall;
                if((value & 1u << 28) != 0)
                {
                    Data1 = false;
                }
                if((value & 1u << 29) != 0)
                {
                    Data1 = true;
                }
                if((value & 1u << 26) != 0)
                {
                    Nak = false;
                }
                if((value & 1u << 27) != 0)
                {
                    Nak = true;
                    Interrupt |= IsIn ? 1u << 6 : 0;
                }
                var disables = (value & 1u << 30) != 0;
                // OUT endpoint 0 cannot be disabled (57.14.60).
                disabling |= disables && Enabled && (IsIn || Number != 0);
                if(value >> 31 != 0 && !disables)
                {
                    Enabled = true;
                    disabling = false;
                }
                if(disabling && Nak)
                {
                    disabling = false;
                    Enabled = false;
                    Interrupt |= 1u << 1;
                }
            }
        }

        public bool Active { get { return Number == 0 || (settings & 1u << 15) != 0; } }

        public int MaxPacket { get { return Number == 0 ? 64 >> (int)(settings & 3) : (int)(settings & 0x7FF); } }

        public int FifoNumber { get { return Math.Min((int)(settings >> 22 & 15), 8); } }

        public int Bytes { get { return (int)(Size & ByteMask); } }

        public int Packets { get { return (int)(Size >> 19 & 0x3FF); } }

        /// A packet was transferred; whether it was the last one of the count.
        public bool Transferred(int bytes)
        {
            var packets = (uint)(Packets - 1) & (Number == 0 ? 3u : 0x3FFu);
            Size = (uint)Math.Max(0, Bytes - bytes) | packets << 19;
            return packets == 0;
        }

        public readonly int Number;
        public readonly bool IsIn;

        public bool Enabled;
        public bool Nak;
        public bool Stall;
        public bool Data1;
        public uint Size;
        public uint Interrupt;

        private uint ByteMask { get { return Number == 0 ? 0x7Fu : 0x7FFFFu; } }

        private uint settings;
        private bool disabling;
    }
}
