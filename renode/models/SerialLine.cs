// The far end of USART3: bytes to the board arrive at its baud rate, bytes from the board are stored until they are taken.

using System;
using System.Collections.Generic;
using System.Text;
using Antmicro.Renode.Core;
using Antmicro.Renode.Exceptions;
using Antmicro.Renode.Peripherals.UART;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public class SerialLine : IPeripheral
    {
        public SerialLine(IMachine machine, IUART uart)
        {
            this.uart = uart;
            time = new VirtualTime(machine);
            uart.CharReceived += Arrived;
        }

        public void Reset()
        {
        }

        /// Puts bytes on the line to the board, as hexadecimal digits.
        public void Send(string digits)
        {
            Queue(FromHex(digits));
        }

        public void Queue(byte[] bytes)
        {
            lock(toBoard)
            {
                foreach(var value in bytes)
                {
                    toBoard.Enqueue(value);
                }
                if(toBoard.Count == 0 || busy)
                {
                    return;
                }
                busy = true;
            }
            Next(time.Now + ByteNs);
        }

        /// Takes what the board has sent since the last call, as hexadecimal digits.
        public string Take()
        {
            return ToHex(TakeBytes());
        }

        public byte[] TakeBytes()
        {
            lock(fromBoard)
            {
                var bytes = fromBoard.ToArray();
                fromBoard.Clear();
                return bytes;
            }
        }

        public static string ToHex(byte[] bytes)
        {
            var text = new StringBuilder(2 * bytes.Length);
            foreach(var value in bytes)
            {
                text.Append(value.ToString("x2"));
            }
            return text.ToString();
        }

        public static byte[] FromHex(string digits)
        {
            if(digits.Length % 2 != 0)
            {
                throw new RecoverableException("an odd number of hexadecimal digits");
            }
            var bytes = new byte[digits.Length / 2];
            for(var i = 0; i < bytes.Length; i++)
            {
                bytes[i] = Convert.ToByte(digits.Substring(2 * i, 2), 16);
            }
            return bytes;
        }

        /// Start bit, eight data bits, stop bit.
        private ulong ByteNs
        {
            get
            {
                // Before the board has set its own rate the far end talks at the one agreed on.
                var baud = uart.BaudRate;
                return baud == 0 ? 5000UL : 10000000000UL / baud;
            }
        }

        private void Next(ulong at)
        {
            time.At(at, now =>
            {
                byte value;
                bool more;
                lock(toBoard)
                {
                    value = toBoard.Dequeue();
                    more = toBoard.Count > 0;
                    busy = more;
                }
                uart.WriteChar(value);
                if(more)
                {
                    Next(now + ByteNs);
                }
            });
        }

        private void Arrived(byte value)
        {
            lock(fromBoard)
            {
                if(fromBoard.Count >= Most)
                {
                    // An interactive run, where nothing takes them.
                    fromBoard.RemoveRange(0, Most / 2);
                }
                fromBoard.Add(value);
            }
        }

        private bool busy;

        /// 40 s of the line at 2 Mbaud.
        private const int Most = 1 << 23;

        private readonly IUART uart;
        private readonly VirtualTime time;
        private readonly Queue<byte> toBoard = new Queue<byte>();
        private readonly List<byte> fromBoard = new List<byte>();
    }
}
