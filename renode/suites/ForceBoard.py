"""Keywords of the force board's suites: power it up, let time pass, send commands, inject faults, check the result.

Virtual time passes only inside of `Advance` and what builds on it, so a suite gives the same figures on a
slow machine as on a fast one. Units count from 1.
"""

import json
import os
import socket
import statistics
import subprocess
import tempfile
import time

from robot.api import logger
from robot.libraries.BuiltIn import BuiltIn

import force_wire as wire

BOARD_STATES = ["boot", "bring-up", "ready", "zeroing", "running", "stopping", "fault"]
UNIT_STATES = ["offline", "bring-up", "ready", "running", "faulted", "zeroing", "stopping"]
FAULTS = {"E-stop": 1, "setpoints expired": 2, "host stop": 3, "I2C bus stuck": 6, "mux silent": 7,
          "watchdog reset": 8, "configuration damaged": 11, "DAC bus fault": 13,
          "encoder counter fault": 14, "0 V has no effect": 15, "register changed": 18, "over-tension": 32, "sensor silent": 33,
          "sensor too slow": 34, "sensor too fast": 35, "bring-up failed": 36, "ADC saturated": 37,
          "sensor reads": 41, "encoder stands still": 42}
I2C1 = 0x40005400
SPI1 = 0x40013000
NOMINAL_SCALE_PN = 6_850_000
NOMINAL_TRAVEL_NM = -4_229
# What the firmware loads a counter with (board/src/hw/counters.rs).
COUNTER_BEGIN = 0x555555
HERE = os.path.dirname(os.path.abspath(__file__))


class ForceBoard:
    ROBOT_LIBRARY_SCOPE = "TEST"
    models_of = None

    def __init__(self):
        self._forget()

    def _forget(self):
        self.line = "serial"
        self.decoder = wire.Decoder()
        self.seq = 0
        self.samples = []
        self.statuses = []
        self.faults = []
        self.replies = []
        self.board_seqs = []
        self.tensions = [0.0] * wire.UNITS
        self.holding = False
        self.hello = None
        self.peer = None

    # The emulation

    def run(self, command):
        return BuiltIn().run_keyword("Execute Command", command)

    def power_up_board(self, seed=1):
        """A new board, before its first instruction."""
        variables = BuiltIn().get_variables()
        for name, variable in (("bin", "${ELF}"), ("plant", "${PLANT}")):
            if variable in variables:
                self.run("$%s=@%s" % (name, variables[variable]))
        self.run("$seed=%s" % seed)
        self.run("include @%s" % os.path.join(HERE, "..", "board.resc"))
        self._forget()

    def advance(self, milliseconds):
        """Lets virtual time pass and collects the frames of the board."""
        self.run('emulation RunFor "%.6f"' % (float(milliseconds) / 1000.0))
        self._receive()

    def _receive(self):
        digits = self.run("%s Take" % self.line).strip()
        for frame in self.decoder.feed(bytes.fromhex(digits)):
            self.board_seqs.append(frame["seq"])
            for kind, received in (("status", self.statuses), ("fault", self.faults), ("reply", self.replies)):
                if kind in frame:
                    received.append(frame[kind])
            self.samples += frame.get("samples", [])

    def now_ms(self):
        return int(self.run("rig Now").strip(), 0) / 1e6

    # Talking to the board

    def request(self, command, body=b"", within_ms=200):
        """Sends a command and returns the board's reply; refused or silent is an error."""
        reply = self.ask(command, body, within_ms)
        if reply["response"] == "Rejected":
            raise AssertionError("%s rejected: %s %s" % (command, reply["error"], reply.get("value", "")))
        return reply

    def ask(self, command, body=b"", within_ms=200, damaged=False):
        self.seq = self.seq + 1 & 0xFFFF
        seq = self.seq
        self.run("%s Send \"%s\"" % (self.line, wire.encode_command(seq, command, body, damaged).hex()))
        for _ in range(int(within_ms) // 2):
            self.advance(2)
            for reply in self.replies:
                if reply["seq"] == seq:
                    self.replies.remove(reply)
                    return reply
        raise AssertionError("no response to %s within %s ms" % (command, within_ms))

    def send(self, command, body=b""):
        self.seq = self.seq + 1 & 0xFFFF
        self.run("%s Send \"%s\"" % (self.line, wire.encode_command(self.seq, command, body).hex()))

    def connect(self):
        """Sends Hello with the board's own ABI version and schema hash, and returns the board's information."""
        rejected = self.ask("Hello", wire.hello(0, bytes(8)), 500)
        if rejected.get("error") != "Version":
            raise AssertionError("Hello with another schema hash should be rejected, got %s" % rejected)
        self.hello = self.request("Hello", wire.hello(rejected["abi"], rejected["schema"]))
        logger.info("board: %s" % self.hello)
        return self.hello

    def status(self):
        return self.request("GetStatus")["status"]

    def bring_up_units(self, within_ms=6000, again=False, **changes):
        """Enables all units with the configuration in force, but for what is given, and waits until they are ready.

        `again`: faults of a bring-up are cleared once, and the units brought up again.
        """
        for unit in range(wire.UNITS):
            body = bytes([unit])
            config = self.request("GetConfig", body)["config"]
            config["enabled"] = True
            config["scale_pn_per_count"] = NOMINAL_SCALE_PN
            # As the rig file has it: the counters count down while a reel winds in.
            config["travel_nm_per_count"] = NOMINAL_TRAVEL_NM
            for name, value in changes.items():
                config[name] = int(value)
            self.request("StageConfig", body + wire._encode_config(config))
        self.request("CommitConfig")
        self.request("ClearFaults")
        if again:
            self.advance(1500)
            self.request("ClearFaults")
        self._wait(lambda s: all(u["state"] == 2 for u in s["units"]), within_ms, "six units ready")

    def _wait(self, condition, within_ms, what):
        waited = 0
        while True:
            status = self.status()
            if condition(status):
                return status
            if waited >= float(within_ms):
                raise AssertionError("not within %s ms: %s; last status %s" % (within_ms, what, status))
            self.advance(20)
            waited += 20

    def zero_units(self):
        """Zeroes all load cells; the cables are slack."""
        self.request("Zero", bytes([0x3F]))
        self.advance(50)
        self._wait(lambda s: s["state"] == 2, 3000, "zeroed and ready")

    def stream(self, decimation=1):
        self.request("Stream", bytes([int(decimation)]))

    def arm(self):
        """Arms with a holding tension of nothing; from here on setpoints go out every 10 ms."""
        self.request("Arm")
        self.holding = True

    def disarm(self):
        self.request("Disarm")
        self.holding = False

    def set_tensions(self, *newton):
        self.tensions = [float(n) for n in newton]

    def hold_for(self, milliseconds):
        """Sends the setpoints every 10 ms, as forcectl does, while time passes."""
        for _ in range(int(float(milliseconds) / 10)):
            self.send("Setpoints", wire.setpoints(100, self.tensions))
            self.advance(10)

    def armed_board(self, seed=1, tension=4.0, **changes):
        """Power-up to all six cables held at a tension, with these changes of the units' configurations."""
        self.power_up_board(seed)
        self.advance(300)
        self.connect()
        self.bring_up_units(**changes)
        self.zero_units()
        self.stream(1)
        self.arm()
        self.set_tensions(*[tension] * wire.UNITS)
        self.hold_for(600)

    def run_forcectl(self, *words):
        """Runs forcectl against this emulation and returns its figures.

        forcectl starts `renode-rig`, which waits at a port for this Renode to connect.
        """
        variables = BuiltIn().get_variables()
        for name in ("${FORCECTL}", "${RENODE_RIG}", "${ELF}"):
            if name not in variables:
                raise AssertionError("the suite needs the variable %s" % name)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        with tempfile.TemporaryDirectory() as folder:
            environment = dict(os.environ, FORCE_RIG_BIN=variables["${RENODE_RIG}"], FORCE_RENODE_ATTACH=str(port),
                               FORCE_FIRMWARE_ELF=variables["${ELF}"])
            command = [variables["${FORCECTL}"], "--json"] + [str(w) for w in words] + ["--out", folder]
            with open(os.path.join(folder, "err"), "w+") as err:
                process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=err, text=True)
                try:
                    self._connect_server(port, process)
                    out = process.communicate(timeout=900)[0]
                finally:
                    process.kill()
                    self.run("server Disconnect")
                err.seek(0)
                logger.info(err.read())
        logger.info(out)
        figures = json.loads(out)
        if "error" in figures:
            raise AssertionError("forcectl: %s" % figures["error"])
        return figures

    def begin_step(self, milliseconds):
        """Another program moves the emulation, and is in the middle of a step."""
        with socket.socket() as listener:
            listener.bind(("127.0.0.1", 0))
            listener.listen(1)
            self.run("server Connect %d" % listener.getsockname()[1])
            self.peer = listener.accept()[0]
        stream = self.peer.makefile("rw")
        if not stream.readline().startswith("ready"):
            raise AssertionError("the server is not ready")
        stream.write("advance %d\n" % (int(milliseconds) * 1000000))
        stream.flush()
        time.sleep(0.4)

    def _connect_server(self, port, process):
        for _ in range(100):
            try:
                self.run("server Connect %d" % port)
                return
            except Exception as refused:  # the remote library raises its own kinds
                if process.poll() is not None:
                    raise AssertionError("forcectl ended before it was connected: %s" % refused)
                time.sleep(0.1)
        raise AssertionError("renode-rig does not listen at port %d" % port)

    # USB

    def use_usb(self):
        """From here on the suite talks to the board by its USB port."""
        self.line = "usbHost"
        self.discard_input()

    def use_serial(self):
        """From here on the suite talks to the board by USART3."""
        self.line = "serial"
        self.discard_input()

    def discard_input(self):
        """Forgets what came by now, and a frame that was cut off."""
        self.run("%s Take" % self.line)
        self.decoder = wire.Decoder()
        self.board_seqs = []

    def host_state_should_be(self, state, within_ms=0):
        waited = 0
        while True:
            found = self.run("usbHost State").strip()
            if found == state:
                return
            if waited >= float(within_ms):
                raise AssertionError("the USB host is %s, expected %s" % (found, state))
            self.advance(10)
            waited += 10

    def descriptor(self, name):
        return list(bytes.fromhex(self.run("usbHost Descriptor \"%s\"" % name).strip()))

    def control_transfer_should_end(self, pattern, kind, request, value, index, length, data="", abandon=-1):
        """`data` for the device need not be as long as the `length` in the request. `abandon`: bytes after which the host stops."""
        self.run("usbHost Request %s %s %s %s %s \"%s\" %s" % (kind, request, value, index, length, data, abandon))
        for _ in range(100):
            self.advance(2)
            answer = self.run("usbHost Answer").strip()
            if answer:
                BuiltIn().should_match_regexp(answer, "^(%s)$" % pattern)
                return answer
        raise AssertionError("the control transfer %s is not over after 200 ms" % request)

    def send_in_packets(self, command, size):
        """A command in packets of `size` bytes, with an empty packet before each and at the end. The board must answer."""
        self.seq = self.seq + 1 & 0xFFFF
        frame = wire.encode_command(self.seq, command, b"")
        size = int(size)
        for at in range(0, len(frame), size):
            self.run('usbHost SendPacket ""')
            self.run('usbHost SendPacket "%s"' % frame[at:at + size].hex())
        self.run('usbHost SendPacket ""')
        for _ in range(50):
            self.advance(2)
            if any(reply["seq"] == self.seq for reply in self.replies):
                return
        raise AssertionError("no response to %s in packets of %d bytes" % (command, size))

    def path_from_drdy_to_dac(self, during):
        """Median, 99th percentile and largest of the time from DRDY to the output, at the devices, since `Forget Samples`."""
        all_ns = sorted(int(n) for unit in range(1, wire.UNITS + 1) for n in self.run("rig LatenciesNs %d" % unit).split())
        path = statistics.median(all_ns) / 1000, all_ns[len(all_ns) * 99 // 100] / 1000, all_ns[-1] / 1000
        logger.info("DRDY to DAC, %s: %.1f, %.1f, %.1f us (median, 99th percentile, largest of %d)" % ((during,) + path + (len(all_ns),)),
                    also_console=True)
        return path

    def samples_should_be_complete(self, milliseconds):
        """Since `Forget Samples` every conversion has come, but for the last ones on their way."""
        for unit in range(wire.UNITS):
            period_us = float(self.run("cell%d PeriodUs" % (unit + 1)).strip().replace(",", "."))
            expected = float(milliseconds) * 1000 / period_us
            got = len([s for s in self.samples if s["unit"] == unit])
            if not expected - 16 <= got <= expected + 16:
                raise AssertionError("unit %d: %d samples, its converter made %.0f" % (unit + 1, got, expected))

    # Causes of detections

    def codes_should_be_ideal_within(self, codes):
        for unit in range(1, wire.UNITS + 1):
            code, ideal = [self._signed(self.run("cell%d %s" % (unit, name))) for name in ("Code", "IdealCode")]
            logger.info("unit %d: %d, ideal %d" % (unit, code, ideal))
            if abs(code - ideal) > int(codes):
                raise AssertionError("unit %d: its converter says %d, without error it would be %d" % (unit, code, ideal))

    @staticmethod
    def _signed(text):
        value = int(text.strip(), 0)
        return value - (1 << 32) if value >= 1 << 31 else value

    def change_in_memory(self, value):
        """Flips a bit of every word in RAM that has this value."""
        found = self.run("rig FindWord %d" % int(value)).split()
        if not found:
            raise AssertionError("no word %s in RAM" % value)
        for address in found:
            self.run("rig FlipBit %s 4" % address)

    # Registers from outside, with the core halted

    def poke(self, address, value):
        self.run("sysbus WriteDoubleWord 0x%X 0x%X" % (int(str(address), 0), int(str(value), 0)))

    def peek(self, address):
        return int(self.run("sysbus ReadDoubleWord 0x%X" % int(str(address), 0)).strip(), 0)

    def halt_core_and_take_i2c1(self):
        """PB8 and PB9 belong to I2C1, which is on: 64 MHz, 400 kHz but for the filters."""
        self.run("cpu IsHalted true")
        self.poke(0x58020400, 0xFFFAFEBF)
        self.poke(0x58020404, 0x300)
        self.poke(0x58020424, 0x44)
        self.poke(I2C1 + 0x10, 0x00002A45)
        self.poke(I2C1, 1)

    def _i2c_wait(self, mask, what):
        for _ in range(200):
            flags = self.peek(I2C1 + 0x18)
            if flags & mask:
                return flags
            self.advance(0.01)
        raise AssertionError("I2C1: no %s, ISR 0x%X" % (what, flags))

    def _i2c_begin(self, address, read, count, auto_end):
        self.poke(I2C1 + 0x1C, 0x3F38)
        self.poke(I2C1 + 0x04, int(str(address), 0) << 1 | read << 10 | 1 << 13 | count << 16 | auto_end << 25)

    def i2c_write(self, address, digits, auto_end=True):
        """Writes bytes, all of which must be acknowledged."""
        data = bytes.fromhex(digits)
        self._i2c_begin(address, False, len(data), auto_end)
        for byte in data:
            flags = self._i2c_wait(1 << 1 | 1 << 4, "TXIS")
            if flags & 1 << 4:
                raise AssertionError("NACK from %s" % address)
            self.poke(I2C1 + 0x28, byte)
        self._i2c_wait(1 << 5 if auto_end else 1 << 6, "end of the transfer")

    def i2c_should_read(self, address, pointer, expected):
        """Writes the pointer where there is one, then, after a repeated START, reads."""
        if pointer:
            self.i2c_write(address, pointer, auto_end=False)
        count = len(expected) // 2
        self._i2c_begin(address, True, count, True)
        got = b""
        for _ in range(count):
            flags = self._i2c_wait(1 << 2 | 1 << 4, "RXNE")
            if flags & 1 << 4:
                raise AssertionError("NACK from %s" % address)
            got += bytes([self.peek(I2C1 + 0x24)])
        self._i2c_wait(1 << 5, "STOPF")
        if got != bytes.fromhex(expected):
            raise AssertionError("%s answers %s, expected %s" % (address, got.hex(), expected))

    def i2c_should_not_answer(self, address):
        self._i2c_begin(address, False, 0, True)
        flags = self._i2c_wait(1 << 5, "STOPF")
        if not flags & 1 << 4:
            raise AssertionError("%s acknowledges" % address)

    def halt_core_and_take_spi1(self):
        """PA5 and PB5 belong to SPI1, which is master, full duplex, 16 bits, mode 3, clocked by the HSI."""
        self.run("cpu IsHalted true")
        self.poke(0x58020000, 0xABFFFBFF)
        self.poke(0x58020020, 5 << 20)
        self.poke(0x58020400, 0xFFFFFABF)
        self.poke(0x58020420, 5 << 20)
        # CKPER, which is the HSI.
        self.poke(0x58024450, 4 << 12)
        self.poke(SPI1, 1 << 12)
        self.poke(SPI1 + 0x08, 1 << 28 | 15)
        self.poke(SPI1 + 0x0C, 1 << 22 | 3 << 24 | 1 << 26)

    def spi_exchange(self, word):
        self.poke(SPI1 + 0x04, 1)
        self.poke(SPI1, 1 << 12 | 1)
        self.poke(SPI1 + 0x20, word)
        self.poke(SPI1, 1 << 12 | 1 << 9 | 1)
        self.advance(0.1)
        status = self.peek(SPI1 + 0x14)
        if not status & 1 << 3:
            raise AssertionError("SPI1: no EOT, SR 0x%X" % status)
        answer = self.peek(SPI1 + 0x30)
        self.poke(SPI1 + 0x18, 0xFF8)
        self.poke(SPI1, 1 << 12)
        return answer

    def led_should_be(self, name, state):
        found = self.run("%sLED State" % name).strip()
        if found != ("True" if state == "on" else "False"):
            raise AssertionError("the %s LED is %s" % (name, found))

    # Looking at it

    def board_state_should_be(self, name):
        state = BOARD_STATES[self.status()["state"]]
        if state != name:
            raise AssertionError("board is in state %s, expected %s; %s" % (state, name, self.status()))

    def all_units_should_be(self, name):
        units = self.status()["units"]
        states = [UNIT_STATES[u["state"]] for u in units]
        if set(states) != {name}:
            raise AssertionError("units are %s, expected all %s; %s" % (states, name, units))

    def board_fault_should_be(self, name):
        status = self.status()
        if status["fault"] != FAULTS[name]:
            raise AssertionError("board fault is %d, expected %s (%d)" % (status["fault"], name, FAULTS[name]))

    def unit_fault_should_be(self, unit, name):
        status = self.status()
        got = status["units"][int(unit) - 1]["fault"]
        if got != FAULTS[name]:
            raise AssertionError("unit %s has fault %d, expected %s (%d); %s" % (unit, got, name, FAULTS[name], status))

    def output_should_be_zero(self, *units):
        """The DAC stands at mid-scale: 0 V."""
        for unit in units or range(1, wire.UNITS + 1):
            code = self.dac_code(unit)
            if code != 0x8000:
                raise AssertionError("DAC of unit %s stands at 0x%04X, not at 0 V" % (unit, code))

    def output_should_drive(self, *units):
        for unit in units or range(1, wire.UNITS + 1):
            if self.dac_code(unit) == 0x8000:
                raise AssertionError("DAC of unit %s stands at 0 V" % unit)

    def dac_code(self, unit):
        return int(self.run("dac%s Code" % unit).strip(), 0)

    def true_tension(self, unit):
        return float(self.run("rig Tension %s" % unit).strip().replace(",", "."))

    def tensions_should_be(self, newton, within):
        for unit in range(1, wire.UNITS + 1):
            tension = self.true_tension(unit)
            if abs(tension - float(newton)) > float(within):
                raise AssertionError("cable %d is at %.3f N, expected %s +- %s N" % (unit, tension, newton, within))
            logger.info("cable %d: %.3f N" % (unit, tension))

    def forget_samples(self):
        self.samples = []
        self.run("rig ForgetTrips")

    def samples_should_stream(self, seconds):
        """Six units at their converters' own rates, nothing missed, nothing dropped, numbers without a gap."""
        before = self.status()
        self.forget_samples()
        self.advance(float(seconds) * 1000)
        after = self.status()
        for unit in range(wire.UNITS):
            period_us = float(self.run("cell%d PeriodUs" % (unit + 1)).strip().replace(",", "."))
            expected = float(seconds) * 1e6 / period_us
            got = len([s for s in self.samples if s["unit"] == unit])
            if abs(got - expected) > 0.02 * expected + 6:
                raise AssertionError("unit %d: %d samples, its converter made %.0f" % (unit + 1, got, expected))
            missed = after["units"][unit]["missed"] - before["units"][unit]["missed"]
            if missed:
                raise AssertionError("unit %d: %d conversions missed" % (unit + 1, missed))
            reported = after["units"][unit]["period_us"]
            if abs(reported - period_us) > 0.01 * period_us:
                raise AssertionError("unit %d: the board measures a period of %d us, it is %.1f us" % (unit + 1, reported, period_us))
        if after["frames_dropped"] != before["frames_dropped"]:
            raise AssertionError("telemetry frames were dropped")
        self.frames_should_have_no_gap()

    def frames_should_have_no_gap(self):
        if self.decoder.damaged:
            raise AssertionError("%d damaged frames" % self.decoder.damaged)
        for a, b in zip(self.board_seqs, self.board_seqs[1:]):
            if b != (a + 1) & 0xFFFF:
                raise AssertionError("frame %d follows %d" % (b, a))

    def codes_should_come_from_the_converters(self):
        """The last code that each converter made is reported by the board, once its telemetry has come through."""
        codes = []
        for unit in range(wire.UNITS):
            code = int(self.run("cell%d Code" % (unit + 1)).strip(), 0)
            codes.append(code - (1 << 32) if code >= 1 << 31 else code)
        self.advance(20)
        for unit, code in enumerate(codes):
            reported = [s["adc_code"] for s in self.samples if s["unit"] == unit][-12:]
            if code not in reported:
                raise AssertionError("unit %d: the converter's %d is not among the codes reported: %s" % (unit + 1, code, reported))

    def position_should_follow_the_counter(self, unit):
        """The board's position, cut to 24 bits, is the counter's way from its begin within what moved since the last sample."""
        counter = int(self.run("counters Counter %s" % unit).strip(), 0)
        position = self.encoder_position(unit)
        apart = (position - (counter - COUNTER_BEGIN) + (1 << 23)) % (1 << 24) - (1 << 23)
        if abs(apart) > 50:
            raise AssertionError("unit %s: the board is at %d, its counter at %d" % (unit, position, counter))

    def latency_should_agree_from_both_ends(self, within_us=10):
        """Latency measured by the board (DRDY to DAC word) against the devices (DRDY to LDAC edge), sample by sample.

        Samples are paired by their codes, in order. A unit whose converter runs in step with another one's waits for it with
        every sample, so the medians of the units may differ; the two ends of one sample may not.
        """
        apart, total = [], 0
        for unit in range(1, wire.UNITS + 1):
            outside = [tuple(int(n) for n in pair.split(":")) for pair in self.run("rig CodesAndLatenciesNs %d" % unit).split()]
            inside = [s for s in self.samples if s["unit"] == unit - 1 and s["flags"] & 32]
            pairs, at = [], 0
            for sample in inside:
                found = [n for n in range(at, min(at + 20, len(outside))) if outside[n][0] == sample["adc_code"]]
                if found:
                    at = found[0] + 1
                    pairs.append((sample["latency_us"], outside[found[0]][1] / 1000.0))
            if len(pairs) < 0.9 * len(inside) or not pairs:
                raise AssertionError("unit %d: %d of %d samples have a DAC update" % (unit, len(pairs), len(inside)))
            own, other = zip(*pairs)
            logger.info("unit %d: %d samples, board %.0f us, outside %.1f/%.1f/%.1f us (median; min/median/max)" % (
                unit, len(pairs), statistics.median(own), min(other), statistics.median(other), max(other)), also_console=True)
            # Both ends of the board's figure are whole microseconds.
            total += len(pairs)
            apart += ["unit %d: board %.0f us, outside %.1f us" % (unit, mine, theirs) for mine, theirs in pairs
                      if not -2 <= theirs - mine <= float(within_us)]
        logger.info("%d of %d samples differ by more" % (len(apart), total), also_console=True)
        # The board sends each word again every millisecond. Where that falls between a conversion's result and its own word, the
        # devices take the repeated word for the answer.
        if len(apart) > 0.03 * total:
            raise AssertionError("%d of %d samples: %s" % (len(apart), total, "; ".join(apart[:10])))

    def faults_reported(self):
        return [(f["code"], f["unit"]) for f in self.faults]

    def reset_flags(self):
        return self.hello["reset_flags"]

    def crash_record_should_be(self, name):
        record = self.hello["crash_record"]
        if record is None or record["code"] != FAULTS[name]:
            raise AssertionError("crash record is %s, expected %s (%d)" % (record, name, FAULTS[name]))

    def encoder_position(self, unit):
        """Last extended position that the board reported for a unit."""
        return [s["encoder_counts"] for s in self.samples if s["unit"] == int(unit) - 1][-1]

    def number(self, command):
        """A property or method of a model as a number."""
        text = self.run(command).strip()
        return int(text, 0) if text.startswith("0x") else float(text.replace(",", "."))
