// The rig around the board: the plant, fault injection, and records of samples and truth.
//
// The plant is computed on its own time grid and moves forward only. Every access states an instant; the plant,
// the converters' input samples and the rows of truth are computed up to it in the order of time.

using System;
using System.Collections.Generic;
using System.IO;
using Antmicro.Renode.Core;
using Antmicro.Renode.Exceptions;
using Antmicro.Renode.Logging;
using Antmicro.Renode.Peripherals.Bus;
using Antmicro.Renode.Peripherals.CPU;
using Antmicro.Renode.Utilities;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Something that takes samples of the plant at instants of its own.
    public interface ISampler
    {
        /// Next instant at which it needs the plant, `ulong.MaxValue` for none.
        ulong NextSample { get; }
        void TakeSample();
    }

    /// The way of one sample: conversion ready, DAC output updated.
    public struct SampleTrip
    {
        public int Unit;
        public ulong ReadyNs;
        public ulong UpdateNs;
        public int Code;
        public uint Dac;
    }

    /// The plant's true state at one instant.
    public struct TruthRow
    {
        public ulong TimeNs;
        public double[] Plant;
        public double[] Volts;
        public bool AmplifierOn;
    }

    public class Rig : IPeripheral, IDisposable
    {
        public Rig(IMachine machine)
        {
            this.machine = machine;
            time = new VirtualTime(machine);
            for(var unit = 0; unit < Units; unit++)
            {
                Trips[unit] = new List<SampleTrip>();
            }
        }

        /// Loads the plant. `configuration`: path of a TOML file, or empty for the default rig.
        public void Open(ReadFilePath library, ulong seed, string configuration = "")
        {
            if(plant != null)
            {
                throw new RecoverableException("the plant is open already");
            }
            plant = new PlantLibrary(library, seed, configuration.Length == 0 ? null : File.ReadAllText(configuration));
            if(plant.Units != Units)
            {
                throw new RecoverableException("the plant has " + plant.Units + " units, the board " + Units);
            }
            Seed = seed;
            if(Opened != null)
            {
                Opened();
            }
        }

        public void Dispose()
        {
            if(plant != null)
            {
                plant.Dispose();
            }
        }

        /// A reset of the board. The rig around it goes on.
        public void Reset()
        {
            Resets++;
            Unhang();
        }

        /// A stream of random numbers of its own for each user.
        public Random64 Stream(ulong user)
        {
            return new Random64(Seed * 0x9E3779B97F4A7C15UL + user);
        }

        public void AddSampler(ISampler sampler)
        {
            samplers.Add(sampler);
        }

        /// Takes the plant, its samples and its rows of truth up to instant `to`.
        public void CatchUp(ulong to)
        {
            if(plant == null)
            {
                throw new RecoverableException("no plant: `rig Open` names the library");
            }
            while(true)
            {
                var next = nextRow;
                ISampler who = null;
                foreach(var sampler in samplers)
                {
                    if(sampler.NextSample < next)
                    {
                        next = sampler.NextSample;
                        who = sampler;
                    }
                }
                if(next > to)
                {
                    break;
                }
                plant.AdvanceTo(next);
                if(who != null)
                {
                    who.TakeSample();
                }
                else
                {
                    TakeRow(next);
                    nextRow += RowNs;
                }
            }
            plant.AdvanceTo(to);
        }

        /// Bridge output in V per V as the converter of `unit` sees it: cell, and what pulls on the cable.
        public double Bridge(int unit)
        {
            return plant.Bridge(unit) + pull[unit] * plant.BridgePerNewton(unit);
        }

        public long Counts(int unit, ulong at)
        {
            if(frozen[unit] == null)
            {
                CatchUp(at);
                return plant.Counts(unit) - lost[unit];
            }
            return frozen[unit].Value;
        }

        public void SetVolts(int unit, double value, ulong at)
        {
            if(plant == null)
            {
                return;
            }
            CatchUp(at);
            volts[unit] = value;
            plant.SetAmplifierVolts(unit, value);
        }

        public void SetAmplifierPower(bool on, ulong at)
        {
            if(plant == null || on == AmplifierOn)
            {
                return;
            }
            CatchUp(at);
            AmplifierOn = on;
            plant.SetAmplifierPower(on);
        }

        /// Converter: a conversion is ready. Those before a calibration are not counted: nobody reads them.
        public void NoteReady(int unit, ulong at, int code, bool calibrated)
        {
            Conversions[unit] += calibrated ? 1u : 0u;
            ready[unit] = at;
            codes[unit] = code;
        }

        /// Converter: its result was read.
        public void NoteRead(int unit)
        {
            ConversionsRead[unit]++;
            answering[unit] = true;
        }

        /// DAC: the output of `unit` was updated.
        public void NoteUpdate(int unit, uint code, ulong at)
        {
            if(!answering[unit])
            {
                return;
            }
            answering[unit] = false;
            var trips = Trips[unit];
            if(trips.Count >= MostTrips)
            {
                trips.RemoveRange(0, MostTrips / 2);
            }
            trips.Add(new SampleTrip { Unit = unit, ReadyNs = ready[unit], UpdateNs = at, Code = codes[unit], Dac = code });
        }

        // Actions from outside. Units count from 1 here, as in messages.

        public void MoveRobot(bool moving)
        {
            CatchUp(time.Now);
            plant.SetRobotMoving(moving);
        }

        public void PullCable(int unit, double newton)
        {
            pull[Index(unit)] = newton;
        }

        public void FreezeEncoder(int unit, bool freeze)
        {
            var index = Index(unit);
            var now = Counts(index, time.Now);
            if(freeze)
            {
                frozen[index] = now;
            }
            else if(frozen[index] != null)
            {
                frozen[index] = null;
                // What moved while the plug was out is lost for the counter.
                lost[index] = plant.Counts(index) - now;
            }
        }

        /// Turns the shaft of an encoder by hand, in counts: what the plant does comes on top.
        public void TurnEncoder(int unit, int counts)
        {
            lost[Index(unit)] -= counts;
        }

        /// Puts a branch to itself at the entry of the superloop's stage `samples`, which runs with interrupts enabled: they go
        /// on. It lasts until the next reset.
        public void HangLoop()
        {
            Patch(0xE7FE);
        }

        /// The superloop's stage `samples` returns at once, until the next reset.
        public void SkipSamples()
        {
            // BX LR.
            Patch(0x4770);
        }

        /// Addresses in RAM where a word of this value stands, for FlipBit.
        public string FindWord(uint value)
        {
            var found = new List<string>();
            foreach(var memory in new[] { Tuple.Create(0x20000000UL, 0x20000), Tuple.Create(0x24000000UL, 0x80000) })
            {
                var bytes = machine.SystemBus.ReadBytes(memory.Item1, memory.Item2);
                for(var at = 0; at + 4 <= bytes.Length; at += 4)
                {
                    if(BitConverter.ToUInt32(bytes, at) == value)
                    {
                        found.Add("0x" + (memory.Item1 + (ulong)at).ToString("X"));
                    }
                }
            }
            return string.Join(" ", found);
        }

        public void FlipBit(ulong address, int bit)
        {
            machine.SystemBus.WriteByte(address, (byte)(machine.SystemBus.ReadByte(address) ^ 1 << bit));
        }

        /// Latencies of a unit from DRDY to the updated DAC output since ForgetTrips, in ns.
        public string LatenciesNs(int unit)
        {
            var all = new List<string>();
            foreach(var trip in Trips[Index(unit)])
            {
                all.Add((trip.UpdateNs - trip.ReadyNs).ToString());
            }
            return string.Join(" ", all);
        }

        /// As LatenciesNs, each behind the code of its conversion and a colon.
        public string CodesAndLatenciesNs(int unit)
        {
            var all = new List<string>();
            foreach(var trip in Trips[Index(unit)])
            {
                all.Add(trip.Code + ":" + (trip.UpdateNs - trip.ReadyNs));
            }
            return string.Join(" ", all);
        }

        /// Begins a new measurement of LatenciesNs.
        public void ForgetTrips()
        {
            foreach(var trips in Trips)
            {
                trips.Clear();
            }
        }

        /// True cable tension in N.
        public double Tension(int unit)
        {
            CatchUp(time.Now);
            return plant.Truth()[PlantLibrary.TruthRig + PlantLibrary.TruthUnit * Index(unit)];
        }

        /// Voltage at a DAC's output in V.
        public double Volts(int unit)
        {
            return volts[Index(unit)];
        }

        public static int Index(int unit)
        {
            if(unit < 1 || unit > Units)
            {
                throw new RecoverableException("units count from 1 to " + Units);
            }
            return unit - 1;
        }

        /// Rows of truth since the last call, one a millisecond.
        public TruthRow[] TakeRows()
        {
            CatchUp(time.Now);
            var taken = rows.ToArray();
            rows.Clear();
            return taken;
        }

        public double[] Truth()
        {
            CatchUp(time.Now);
            return plant.Truth();
        }

        /// Samples' trips since the last call, in the order of the DAC updates.
        public SampleTrip[] TakeTrips()
        {
            var all = new List<SampleTrip>();
            foreach(var trips in Trips)
            {
                all.AddRange(trips);
                trips.Clear();
            }
            all.Sort((a, b) => a.UpdateNs.CompareTo(b.UpdateNs));
            return all.ToArray();
        }

        public ulong Seed { get; private set; }

        public int Resets { get; private set; }

        public bool AmplifierOn { get; private set; }

        public ulong Now { get { return time.Now; } }

        /// Whether rows of truth are kept for `TakeRows`.
        public bool KeepRows { get; set; }

        public event Action Opened;

        public readonly List<SampleTrip>[] Trips = new List<SampleTrip>[Units];
        public readonly ulong[] Conversions = new ulong[Units];
        public readonly ulong[] ConversionsRead = new ulong[Units];

        public const int Units = 6;

        private void TakeRow(ulong at)
        {
            if(KeepRows)
            {
                rows.Add(new TruthRow { TimeNs = at, Plant = plant.Truth(), Volts = (double[])volts.Clone(), AmplifierOn = AmplifierOn });
            }
        }

        private void Patch(ushort instruction)
        {
            var at = SamplesEntry;
            hungAt = at;
            hungCode = machine.SystemBus.ReadWord(at);
            machine.SystemBus.WriteWord(at, instruction);
        }

        /// Entry of `Board::samples`, which keeps its own symbol (board/src/firmware.rs).
        private ulong SamplesEntry
        {
            get
            {
                for(var at = FlashStart; at < FlashStart + FlashSize; at += 2)
                {
                    string name;
                    Symbol symbol;
                    if(!machine.SystemBus.TryFindSymbolAt(at, out name, out symbol))
                    {
                        continue;
                    }
                    if(name != null && name.Contains("Board") && name.Contains("samples"))
                    {
                        return symbol.Start.RawValue & ~1UL;
                    }
                    at = Math.Max(at, (symbol.End.RawValue & ~1UL) - 2);
                }
                throw new RecoverableException("the image has no symbol `Board::samples`");
            }
        }

        private void Unhang()
        {
            if(hungAt != null)
            {
                machine.SystemBus.WriteWord(hungAt.Value, hungCode);
                hungAt = null;
            }
        }

        private PlantLibrary plant;
        private ulong nextRow = RowNs;
        private ulong? hungAt;
        private ushort hungCode;

        private readonly IMachine machine;
        private readonly VirtualTime time;
        private readonly List<ISampler> samplers = new List<ISampler>();
        private readonly List<TruthRow> rows = new List<TruthRow>();
        private readonly double[] volts = new double[Units];
        private readonly double[] pull = new double[Units];
        private readonly long?[] frozen = new long?[Units];
        private readonly long[] lost = new long[Units];
        private readonly ulong[] ready = new ulong[Units];
        private readonly int[] codes = new int[Units];
        private readonly bool[] answering = new bool[Units];

        private const ulong FlashStart = 0x08000000;
        private const ulong FlashSize = 0x100000;
        private const ulong RowNs = 1000000;
        private const int MostTrips = 200000;
    }

    /// SplitMix64, and normal deviates from it.
    public sealed class Random64
    {
        public Random64(ulong seed)
        {
            state = seed;
        }

        /// Uniform in [0, 1).
        public double Uniform()
        {
            unchecked
            {
                state += 0x9E3779B97F4A7C15UL;
                var z = state;
                z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9UL;
                z = (z ^ z >> 27) * 0x94D049BB133111EBUL;
                return ((z ^ z >> 31) >> 11) / 9007199254740992.0;
            }
        }

        /// Mean 0, standard deviation 1 (Box and Muller).
        public double Normal()
        {
            return Math.Sqrt(-2.0 * Math.Log(1.0 - Uniform())) * Math.Cos(2.0 * Math.PI * Uniform());
        }

        private ulong state;
    }
}
