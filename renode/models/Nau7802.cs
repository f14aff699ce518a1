// Nuvoton NAU7802, 24-bit bridge ADC (data sheet rev 1.7): registers, power-up, calibration, conversions
// with their filter and noise, DRDY.

using System;
using Antmicro.Renode.Core;
using Antmicro.Renode.Logging;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public class Nau7802 : II2cChip, ISampler
    {
        /// `unit` from 1.
        public Nau7802(IMachine machine, Rig rig, int unit)
        {
            this.rig = rig;
            this.unit = Rig.Index(unit);
            time = new VirtualTime(machine);
            DRDY = new GPIO();
            weights = Sinc4(Oversampling);
            history = new double[weights.Length];
            PowerOnReset();
            rig.AddSampler(this);
            rig.Opened += delegate
            {
                random = rig.Stream((ulong)(100 + this.unit));
                // The RC oscillator: 3 % either way (data sheet 7.4).
                oscillator = 1.0 + 0.03 * (2.0 * random.Uniform() - 1.0);
                LoseCalibration();
            };
        }

        /// A reset of the board does not reach this part: it keeps its supply.
        public void Reset()
        {
        }

        public bool Start(bool read)
        {
            if(Unplugged || Nacks)
            {
                return false;
            }
            pointerNext = !read;
            return true;
        }

        public bool WriteByte(byte value)
        {
            if(NackBytes > 0)
            {
                NackBytes--;
                return false;
            }
            if(pointerNext)
            {
                pointer = value & 0x7F;
                pointerNext = false;
            }
            else
            {
                WriteRegister(pointer, value);
                pointer = pointer + 1 & 0x7F;
            }
            return true;
        }

        public byte ReadByte()
        {
            var value = ReadRegister(pointer);
            pointer = pointer + 1 & 0x7F;
            return value;
        }

        public void Stop()
        {
        }

        public void Write(byte[] data)
        {
            I2cBlocks.Write(this, data);
        }

        public byte[] Read(int count)
        {
            return I2cBlocks.Read(this, count);
        }

        public void FinishTransmission()
        {
        }

        public ulong NextSample { get { return converting ? nextSample : ulong.MaxValue; } }

        public void TakeSample()
        {
            history[taken % history.Length] = rig.Bridge(unit);
            taken++;
            sampleTime += PeriodNs / Oversampling;
            nextSample = (ulong)sampleTime;
        }

        /// Pulled out: no DRDY, no answer; or plugged in again, from power-on reset.
        public bool Unplugged
        {
            get
            {
                return unplugged;
            }

            set
            {
                unplugged = value;
                PowerOnReset();
            }
        }

        /// Does not acknowledge its address, while conversions go on.
        public bool Nacks { get; set; }

        /// So many of the next bytes written to it are not acknowledged, while its address is.
        public int NackBytes { get; set; }

        /// Factor on the rate of its oscillator.
        public double RateFactor
        {
            get { return rateFactor; }
            set { rateFactor = value; }
        }

        /// An excitation wire is open: the bridge gives nothing, whatever the force.
        public bool OpenBridge { get; set; }

        /// The result stays as it is, with DRDY as usual.
        public bool FrozenCode { get; set; }

        /// The two signal wires are exchanged.
        public bool WrongSign { get; set; }

        /// A variant: conversions need no CS and do not stop with it, as published drivers that never set it expect.
        public bool FreeRuns { get; set; }

        /// A variant: the six conversions that settle come with DRDY and a part of the load.
        public bool ReportsUnsettled { get; set; }

        /// A variant: the revision reads 0 without PUA, and a calibration fails that begins less than TRDY after PUA or before ten
        /// results have come since the last change, which published drivers wait for.
        public bool StartsSlowly { get; set; }

        /// Codes added to the next conversion, once.
        public int Spike { get; set; }

        /// Last conversion.
        public int Code { get { return result; } }

        /// Last conversion without noise and without error of the zero.
        public int IdealCode { get; private set; }

        /// Time of one conversion in us, with this part's own oscillator.
        public double PeriodUs { get { return PeriodNs / 1000.0; } }

        public GPIO DRDY { get; private set; }

        private double PeriodNs
        {
            get
            {
                return 1e9 / (Rate * oscillator * rateFactor);
            }
        }

        private int Rate
        {
            get
            {
                var code = registers[Control2] >> 4 & 7;
                return code < 4 ? 10 << code : 320;
            }
        }

        private int Gain { get { return 1 << (registers[Control1] & 7); } }

        private void PowerOnReset()
        {
            registers[PowerControl] = 0;
            ResetRegisters();
            poweredUpAt = ulong.MaxValue;
            pointer = 0;
        }

        private void ResetRegisters()
        {
            for(var i = 1; i < registers.Length; i++)
            {
                registers[i] = 0;
            }
            // Gain registers: 1.0.
            registers[0x07] = 0x80;
            registers[0x0E] = 0x80;
            LoseCalibration();
            calibrationFails = false;
            calibrating = false;
            calibrationEpoch++;
            result = 0;
            StopConversions();
        }

        private void StopConversions()
        {
            epoch++;
            converting = false;
            conversionReady = false;
            UpdateReadyPin();
        }

        private byte ReadRegister(int address)
        {
            var up = time.Now >= poweredUpAt;
            switch(address)
            {
            case PowerControl:
                return (byte)(registers[address] & ~0x28 | (conversionReady ? 0x20 : 0) | (up ? 0x08 : 0));
            case Control2:
                return (byte)(registers[address] & ~0x0C | (calibrationFails ? 8 : 0) | (calibrating ? 4 : 0));
            case Result:
                // Reading the first byte holds all three and answers the conversion.
                latched = result;
                if(conversionReady)
                {
                    conversionReady = false;
                    answered = true;
                    UpdateReadyPin();
                }
                return (byte)(latched >> 16);
            case Result + 1:
                return (byte)(latched >> 8);
            case Result + 2:
                if(answered)
                {
                    // Only now: a word for the DAC that was sent meanwhile cannot come from this result.
                    answered = false;
                    rig.NoteRead(unit);
                }
                return (byte)latched;
            case Adc:
                return (registers[Pga] & 0x80) == 0 ? registers[address] : (byte)0;
            case Revision:
                return (byte)(up && (!StartsSlowly || (registers[PowerControl] & 4) != 0) ? 0x0F : 0);
            default:
                return registers[address];
            }
        }

        private void WriteRegister(int address, byte value)
        {
            var before = registers[address];
            if(address != PowerControl && (registers[PowerControl] & 1) != 0)
            {
                // RR is a level: while it is set every other register stays at its reset value.
                this.Log(LogLevel.Warning, "register 0x{0:X2} written while RR is set", address);
                return;
            }
            switch(address)
            {
            case PowerControl:
                WritePowerControl(before, value);
                break;
            case Control1:
                registers[address] = value;
                if(((before ^ value) & 0x3F) != 0)
                {
                    Disturb();
                }
                UpdateReadyPin();
                break;
            case Control2:
                registers[address] = (byte)(value & ~0x0C);
                // CALS alone ignores a write while it is set. Another channel or rate spoils the calibration.
                if(((before ^ value) & 0xF0) != 0)
                {
                    Disturb();
                }
                if((value & 4) != 0 && !calibrating)
                {
                    Calibrate();
                }
                break;
            case Result:
            case Result + 1:
            case Result + 2:
            case Revision:
                this.Log(LogLevel.Warning, "write to read-only register 0x{0:X2}", address);
                break;
            default:
                registers[address] = value;
                if(address >= Offset1 && address < Offset1 + 14)
                {
                    Restart();
                }
                break;
            }
        }

        /// A change that moves the zero: settle again, and the old calibration no longer fits.
        private void Disturb()
        {
            LoseCalibration();
            calibrationSpoilt |= calibrating;
            Restart();
        }

        private void WritePowerControl(byte before, byte value)
        {
            registers[PowerControl] = (byte)(value & ~0x28);
            if((value & 1) != 0)
            {
                poweredUpAt = ulong.MaxValue;
                ResetRegisters();
                return;
            }
            if((value & 2) != 0 && poweredUpAt == ulong.MaxValue)
            {
                var upAt = time.Now + PowerUpNs;
                poweredUpAt = upAt;
                time.At(upAt, delegate
                {
                    if(poweredUpAt == upAt)
                    {
                        Restart();
                    }
                });
            }
            else if((value & 2) == 0)
            {
                poweredUpAt = ulong.MaxValue;
            }
            if((value & ~before & 4) != 0)
            {
                analogAt = time.Now + TrdyNs + (ulong)(5e9 / Rate);
            }
            if(((before ^ value) & NeededBits) != 0)
            {
                Restart();
            }
        }

        private int NeededBits { get { return FreeRuns ? 0x06 : 0x16; } }

        private bool CanConvert { get { return (registers[PowerControl] & NeededBits) == NeededBits && time.Now >= poweredUpAt && !calibrating && !unplugged; } }

        /// Six conversions settle after the start and after each change (data sheet 8.4): DRDY stays quiet, but in a variant.
        private void Restart()
        {
            StopConversions();
            if(!CanConvert)
            {
                return;
            }
            var now = time.Now;
            rig.CatchUp(now);
            converting = true;
            settling = SettlingConversions;
            toFlush = FlushedResults;
            taken = 0;
            sampleTime = now + PeriodNs / Oversampling;
            nextSample = (ulong)sampleTime;
            conversionEnd = now;
            ScheduleConversion();
        }

        private void ScheduleConversion()
        {
            var mine = epoch;
            conversionEnd += PeriodNs;
            time.At((ulong)conversionEnd, at =>
            {
                if(mine != epoch)
                {
                    return;
                }
                FinishConversion(at);
                ScheduleConversion();
            });
        }

        private void FinishConversion(ulong at)
        {
            rig.CatchUp(at);
            var bridge = 0.0;
            for(var i = 0; i < weights.Length; i++)
            {
                bridge += weights[i] * history[(taken + i) % history.Length];
            }
            // Ratiometric: full scale is half the reference, which is also the excitation (data sheet 8.1).
            if(OpenBridge)
            {
                bridge = 0.0;
            }
            else if(WrongSign)
            {
                bridge = -bridge;
            }
            IdealCode = (int)Math.Round(bridge * Gain * 16777216.0);
            var part = settling > 0 ? Settling[SettlingConversions - settling] : 1.0;
            var input = bridge * Gain * 16777216.0 + RawCounts;
            var code = part * input + NoiseCounts() - SignedCounts(Offset1) + Spike;
            Spike = 0;
            if((registers[Control2] & 0x80) != 0)
            {
                // Channel 2 is not wired: noise about zero.
                code = NoiseCounts();
            }
            if(!FrozenCode)
            {
                result = (int)Math.Round(Math.Max(-8388608.0, Math.Min(8388607.0, code)));
            }
            if(settling > 0)
            {
                settling--;
                if(!ReportsUnsettled)
                {
                    return;
                }
            }
            toFlush = Math.Max(0, toFlush - 1);
            rig.NoteReady(unit, at, result, calibrated);
            conversionReady = true;
            UpdateReadyPin();
        }

        /// The input's own offset, either way: an assumption, for the data sheet gives no figure. At gain 128 it is 0.3 N to 0.6 N.
        private void LoseCalibration()
        {
            calibrated = false;
            rawAtGain128 = (random.Uniform() < 0.5 ? -1.0 : 1.0) * RawOffsetCounts * (1.0 + random.Uniform());
        }

        private void Calibrate()
        {
            calibrating = true;
            calibrationSpoilt = StartsSlowly && (time.Now < analogAt || toFlush > 0);
            var channel = registers[Control2] >> 7;
            StopConversions();
            var mine = ++calibrationEpoch;
            time.At(time.Now + CalibrationNs, delegate
            {
                if(mine != calibrationEpoch)
                {
                    return;
                }
                calibrating = false;
                calibrationFails = calibrationSpoilt || (registers[PowerControl] & 6) != 6;
                if(!calibrationFails)
                {
                    calibrated = true;
                    WriteOffset(channel == 0 ? Offset1 : Offset2);
                }
                Restart();
                // The filter held the input all along: another try needs no results first.
                toFlush = 0;
            });
        }

        /// What a calibration leaves: the offset that it found in the channel's coefficient, a little elsewhere each time, as users of
        /// the part report.
        private void WriteOffset(int register)
        {
            var offset = (int)Math.Round(RawCounts - ZeroScatterCounts * random.Normal());
            registers[register] = (byte)(offset >> 16);
            registers[register + 1] = (byte)(offset >> 8);
            registers[register + 2] = (byte)offset;
        }

        private double RawCounts { get { return rawAtGain128 * Gain / 128.0; } }

        /// Three registers as a signed number.
        private int SignedCounts(int register)
        {
            return (registers[register] << 24 | registers[register + 1] << 16 | registers[register + 2] << 8) >> 8;
        }

        /// Input-referred noise: 50 nV at 10 SPS and gain 128, with the root of the rate (data sheet 7.2).
        private double NoiseCounts()
        {
            var volts = 50e-9 * Math.Sqrt(Rate / 10.0);
            var reference = Reference[registers[Control1] >> 3 & 7];
            return volts / reference * Gain * 16777216.0 * random.Normal();
        }

        private void UpdateReadyPin()
        {
            var activeLow = (registers[Control1] & 0x80) != 0;
            DRDY.Set(!unplugged && (conversionReady ^ activeLow));
        }

        /// Impulse response of a fourth-order sinc filter over `n` samples a conversion, oldest first, sum 1.
        private static double[] Sinc4(int n)
        {
            var response = new[] { 1.0 };
            for(var order = 0; order < 4; order++)
            {
                var next = new double[response.Length + n - 1];
                for(var i = 0; i < response.Length; i++)
                {
                    for(var j = 0; j < n; j++)
                    {
                        next[i + j] += response[i] / n;
                    }
                }
                response = next;
            }
            return response;
        }

        private int pointer;
        private bool pointerNext;
        private bool unplugged;
        private bool calibrating;
        private bool calibrationFails;
        private bool calibrationSpoilt;
        private bool calibrated;
        private bool converting;
        private bool conversionReady;
        private bool answered;
        private int settling;
        private int toFlush;
        private int result;
        private int latched;
        private int taken;
        private double sampleTime;
        private ulong nextSample;
        private double conversionEnd;
        private double oscillator = 1.0;
        private double rawAtGain128;
        private double rateFactor = 1.0;
        private ulong poweredUpAt;
        private ulong analogAt;
        private ulong epoch;
        private ulong calibrationEpoch;
        private Random64 random = new Random64(1);

        private readonly int unit;
        private readonly Rig rig;
        private readonly VirtualTime time;
        private readonly byte[] registers = new byte[128];
        private readonly double[] weights;
        private readonly double[] history;

        /// Share of the load in the conversions that settle; the same figures as the embedded rig's.
        private static readonly double[] Settling = { 0.04, 0.25, 0.58, 0.92, 0.98, 0.995 };

        private static readonly double[] Reference = { 4.5, 4.2, 3.9, 3.6, 3.3, 3.0, 2.7, 2.4 };

        private const int PowerControl = 0x00;
        private const int Control1 = 0x01;
        private const int Control2 = 0x02;
        private const int Result = 0x12;
        private const int Adc = 0x15;
        private const int Pga = 0x1B;
        private const int Revision = 0x1F;

        private const int Oversampling = 16;
        private const int SettlingConversions = 6;
        private const int FlushedResults = 10;
        private const int Offset1 = 0x03;
        private const int Offset2 = 0x0A;
        private const ulong PowerUpNs = 200000;
        private const ulong TrdyNs = 100000000;
        private const ulong CalibrationNs = 344000000;
        private const double ZeroScatterCounts = 600.0;
        private const double RawOffsetCounts = 45000.0;
    }
}
