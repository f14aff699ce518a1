// The physics: the crate `plant` behind its C ABI (emulator/plant-abi), loaded at run time.
//
// Nothing of the motors, reels, cables and load cells is written again in C#.

using System;
using System.Runtime.InteropServices;
using System.Text;
using Antmicro.Renode.Exceptions;
using Antmicro.Renode.Utilities;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    /// Another thread may still compute a step while the emulation ends. From then on the plant stands still and gives zeros.
    public sealed class PlantLibrary : IDisposable
    {
        /// Numbers that the truth begins with, before three for each unit.
        public const int TruthRig = 9;
        public const int TruthUnit = 3;

        public PlantLibrary(string path, ulong seed, string configuration)
        {
            IntPtr library;
            if(!SharedLibraries.TryLoadLibrary(path, out library))
            {
                throw new ConstructionException("plant library " + path + " can't be loaded; build it with `cargo build -p plant-abi`");
            }
            var version = Bind<NoneToUint>(library, "plant_abi_version")();
            if(version != AbiVersion)
            {
                throw new ConstructionException("plant library " + path + " has ABI version " + version + ", the models need " + AbiVersion + ": build both from the same sources");
            }
            var create = Bind<NewPlant>(library, "plant_new");
            free = Bind<HandleToNone>(library, "plant_free");
            advance = Bind<HandleUlong>(library, "plant_advance_to");
            volts = Bind<HandleUnitDouble>(library, "plant_set_amplifier_volts");
            power = Bind<HandleByte>(library, "plant_set_amplifier_power");
            robot = Bind<HandleByte>(library, "plant_set_robot_moving");
            bridge = Bind<HandleUnitToDouble>(library, "plant_bridge_v_per_v");
            counts = Bind<HandleUnitToLong>(library, "plant_encoder_counts");
            truth = Bind<HandleTruth>(library, "plant_truth");
            perNewton = Bind<HandleUnitToDouble>(library, "plant_bridge_per_newton");
            var units = Bind<HandleToUint>(library, "plant_units");

            var error = new byte[512];
            var text = configuration == null ? null : Encoding.UTF8.GetBytes(configuration + "\0");
            handle = create(seed, text, error, (UIntPtr)(uint)error.Length);
            if(handle == IntPtr.Zero)
            {
                var end = Array.IndexOf(error, (byte)0);
                throw new ConstructionException("plant refuses its configuration: " + Encoding.UTF8.GetString(error, 0, end));
            }
            Units = (int)units(handle);
        }

        public void Dispose()
        {
            lock(guard)
            {
                if(handle != IntPtr.Zero)
                {
                    free(handle);
                    handle = IntPtr.Zero;
                }
            }
        }

        public void AdvanceTo(ulong nanoseconds) { Use(() => advance(handle, nanoseconds)); }

        public void SetAmplifierVolts(int unit, double value) { Use(() => volts(handle, (uint)unit, value)); }

        public void SetAmplifierPower(bool on) { Use(() => power(handle, (byte)(on ? 1 : 0))); }

        public void SetRobotMoving(bool moving) { Use(() => robot(handle, (byte)(moving ? 1 : 0))); }

        /// Bridge output in V per V of excitation.
        public double Bridge(int unit) { return Of(() => bridge(handle, (uint)unit)); }

        public long Counts(int unit) { return Of(() => counts(handle, (uint)unit)); }

        /// Tip position, velocity, force on the tip; then tension, reel speed and current of each unit.
        public double[] Truth()
        {
            var row = new double[TruthRig + TruthUnit * Units];
            Use(() => truth(handle, row, (UIntPtr)(uint)row.Length));
            return row;
        }

        public int Units { get; private set; }

        /// V/V that one newton along a cell's axis is worth, by its own sensitivity.
        public double BridgePerNewton(int unit) { return Of(() => perNewton(handle, (uint)unit)); }

        private void Use(Action action)
        {
            lock(guard)
            {
                if(handle != IntPtr.Zero)
                {
                    action();
                }
            }
        }

        private T Of<T>(Func<T> function)
        {
            lock(guard)
            {
                return handle != IntPtr.Zero ? function() : default(T);
            }
        }

        private static T Bind<T>(IntPtr library, string name)
        {
            return (T)(object)Marshal.GetDelegateForFunctionPointer(SharedLibraries.GetSymbolAddress(library, name), typeof(T));
        }

        private IntPtr handle;
        private readonly object guard = new object();
        private readonly HandleToNone free;
        private readonly HandleUlong advance;
        private readonly HandleUnitDouble volts;
        private readonly HandleByte power;
        private readonly HandleByte robot;
        private readonly HandleUnitToDouble bridge;
        private readonly HandleUnitToDouble perNewton;
        private readonly HandleUnitToLong counts;
        private readonly HandleTruth truth;

        private const uint AbiVersion = 2;

        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate uint NoneToUint();
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate IntPtr NewPlant(ulong seed, byte[] configuration, byte[] error, UIntPtr errorSize);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate void HandleToNone(IntPtr handle);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate uint HandleToUint(IntPtr handle);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate void HandleUlong(IntPtr handle, ulong value);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate void HandleByte(IntPtr handle, byte value);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate byte HandleUnitDouble(IntPtr handle, uint unit, double value);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate double HandleUnitToDouble(IntPtr handle, uint unit);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate long HandleUnitToLong(IntPtr handle, uint unit);
        [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
        private delegate UIntPtr HandleTruth(IntPtr handle, double[] row, UIntPtr room);
    }
}
