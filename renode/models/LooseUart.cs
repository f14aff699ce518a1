// A serial line that never waits for its reader: between USART3 and a pseudo terminal.
//
// Renode's pseudo terminal writes in the thread of the core. Once the kernel's buffer is full and no program reads, the write
// blocks, and with it the core and `quit`. This stands between: a thread of its own writes, and bytes that find the queue full
// are dropped, as on a wire that nobody listens to.

using System;
using System.Collections.Generic;
using System.IO;
using System.Threading;
using Antmicro.Renode.Core;
using Antmicro.Renode.Peripherals.UART;

namespace Antmicro.Renode.Peripherals.ForceRig
{
    public class LooseUart : IUART
    {
        public LooseUart(IMachine machine, IUART uart, SerialLine line)
        {
            this.uart = uart;
            this.line = line;
            uart.CharReceived += Arrived;
            var writer = new Thread(Write) { IsBackground = true, Name = "loose UART" };
            writer.Start();
        }

        public void Reset()
        {
        }

        /// From the terminal to the board, at the baud rate.
        public void WriteChar(byte value)
        {
            line.Queue(new[] { value });
        }

        /// Removes a link that an earlier run left behind.
        public void RemoveLink(string path)
        {
            File.Delete(path);
        }

        /// Bytes of the board that nobody read.
        public long Dropped { get; private set; }

        public uint BaudRate { get { return uart.BaudRate; } }

        public Bits StopBits { get { return uart.StopBits; } }

        public Parity ParityBit { get { return uart.ParityBit; } }

        public event Action<byte> CharReceived;

        private void Arrived(byte value)
        {
            if(CharReceived == null)
            {
                return;
            }
            lock(queue)
            {
                if(queue.Count >= Most)
                {
                    Dropped++;
                    return;
                }
                queue.Enqueue(value);
                Monitor.Pulse(queue);
            }
        }

        private void Write()
        {
            while(true)
            {
                byte value;
                lock(queue)
                {
                    while(queue.Count == 0)
                    {
                        Monitor.Wait(queue);
                    }
                    value = queue.Dequeue();
                }
                try
                {
                    var received = CharReceived;
                    if(received != null)
                    {
                        received(value);
                    }
                }
                catch(IOException)
                {
                    // The terminal is closed: there is nobody to read.
                }
            }
        }

        private readonly IUART uart;
        private readonly SerialLine line;
        private readonly Queue<byte> queue = new Queue<byte>();

        /// A quarter of a second at 2 Mbaud.
        private const int Most = 65536;
    }
}
