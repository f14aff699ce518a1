"""The board's wire protocol for Robot Framework suites, from docs/protocol.md and wire/src/message.rs.

A third implementation on purpose: it shares no code with the firmware or with forcectl, so that a suite does
not check the code under test with itself. It handles bytes only; the suite transports them.
"""

import binascii
import struct

UNITS = 6

COMMANDS = ["Hello", "GetStatus", "GetConfig", "StageConfig", "StageBoard", "GetBoard", "CommitConfig", "Zero", "Arm", "Disarm",
            "Stop", "ClearFaults", "Setpoints", "Stream"]
PULLS = ["Down", "None", "Up"]
ERRORS = ["NotConnected", "Version", "State", "Faulted", "UnknownUnit", "UnitNotReady", "Range"]

# Integer fields of a unit's configuration, in the order of declaration; the filter is a variant.
CONFIG_FIELDS = ["enabled", "scale_pn_per_count", "zero_code", "stored_zero_code", "zero_deviation_un", "filter", "spike_limit_un", "kp_q16", "ki_q16",
                 "kd_q16", "damping_q16", "friction_feedforward", "friction_offset_un", "friction_gain_q16",
                 "coulomb_un", "coulomb_load_q16", "reversal_nm", "travel_nm_per_count",
                 "dac_counts_per_n_q16", "force_limit_un", "authority_un", "plausible_un", "slew_un_per_s", "over_tension_un",
                 "viscous_q16"] + ["ripple%d_%s" % (n, name) for n in (1, 2) for name in
                                   ("periods_per_count_q32", "phase_q32", "amplitude_un", "amplitude_load_q16")] + [
                     "cell_curve_nn_per_n2", "cell_creep_q16", "cell_creep_ms", "tension_max_un", "leaky_ki_q16"]


def cobs_encode(data):
    """Consistent overhead byte stuffing, without the closing zero."""
    out = bytearray()
    block = bytearray()
    for byte in data:
        if byte == 0:
            out.append(len(block) + 1)
            out += block
            block.clear()
        else:
            block.append(byte)
            if len(block) == 254:
                out.append(255)
                out += block
                block.clear()
    out.append(len(block) + 1)
    return bytes(out + block)


def cobs_decode(data):
    out = bytearray()
    at = 0
    while at < len(data):
        code = data[at]
        if code == 0 or at + code > len(data):
            raise ValueError("damaged byte stuffing")
        out += data[at + 1:at + code]
        at += code
        if code < 255 and at < len(data):
            out.append(0)
    return bytes(out)


class Reader:
    """postcard: little-endian base-128 integers, zigzag where signed, sequences behind their length."""

    def __init__(self, data):
        self.data = data
        self.at = 0

    def byte(self):
        self.at += 1
        return self.data[self.at - 1]

    def raw(self, count):
        self.at += count
        return self.data[self.at - count:self.at]

    def unsigned(self):
        value = shift = 0
        while True:
            byte = self.byte()
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value

    def signed(self):
        value = self.unsigned()
        return (value >> 1) ^ -(value & 1)

    def text(self):
        return self.raw(self.unsigned()).decode()


def unsigned(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def signed(value):
    return unsigned(value << 1 if value >= 0 else (-value << 1) - 1)


def _status(r):
    status = {"t_us": r.unsigned(), "state": r.byte(), "fault": r.unsigned(), "fault_detail": r.unsigned(),
              "estop_closed": r.byte() != 0, "units": []}
    for _ in range(UNITS):
        status["units"].append({
            "state": r.byte(), "fault": r.unsigned(), "fault_detail": r.unsigned(), "samples": r.unsigned(),
            "missed": r.unsigned(), "spikes": r.unsigned(), "failed_reads": r.unsigned(), "period_us": r.unsigned(),
            "tension_un": r.signed(), "adc_code": r.signed(), "encoder_counts": r.signed()})
    status["tip_force_un"] = [r.signed() for _ in range(3)]
    status["alive_withheld"] = r.byte() != 0
    for name in ("config_crc", "setpoint_age_ms", "frames_dropped", "frames_bad", "bus_recoveries",
                 "sleep_permille"):
        status[name] = r.unsigned()
    status["queue_high_water"] = r.byte()
    return status


def _sample(r, start_us):
    sample = {"unit": r.byte()}
    sample["t_us"] = (start_us + r.unsigned()) & 0xFFFFFFFF
    sample["adc_code"] = r.signed()
    sample["encoder_counts"] = r.signed()
    sample["dac_code"] = r.unsigned()
    sample["latency_us"] = r.unsigned()
    for name in ("tension", "setpoint", "p", "i", "d", "ff"):
        sample[name] = r.signed()
    sample["tip_force_mn"] = r.unsigned()
    sample["flags"] = r.byte()
    return sample


def _config(r):
    config = {}
    for name in CONFIG_FIELDS:
        if name in ("enabled", "friction_feedforward"):
            config[name] = r.byte() != 0
        elif name == "filter":
            kind = r.unsigned()
            config[name] = (kind, r.byte() if kind == 0 else r.unsigned())
        else:
            config[name] = r.signed()
    return config


def _encode_config(config):
    out = b""
    for name in CONFIG_FIELDS:
        if name in ("enabled", "friction_feedforward"):
            out += bytes([1 if config[name] else 0])
        elif name == "filter":
            kind, value = config[name]
            out += unsigned(kind) + (bytes([value]) if kind == 0 else unsigned(value))
        else:
            out += signed(config[name])
    return out


def _reply(r):
    reply = {"seq": r.unsigned()}
    variant = r.unsigned()
    if variant == 0:
        reply["response"] = "Done"
    elif variant == 1:
        reply["response"] = "Hello"
        reply["abi"] = r.unsigned()
        reply["schema"] = r.raw(8)
        reply["version"] = r.text()
        reply["core_hz"] = r.unsigned()
        reply["silicon"] = r.unsigned()
        reply["hse"] = r.byte() != 0
        reply["reset_flags"] = r.unsigned()
        reply["option_bytes"] = r.unsigned()
        reply["unique_id"] = [r.unsigned() for _ in range(3)]
        reply["dac_reset_pull"] = PULLS[r.unsigned()]
        reply["crash_record"] = None
        if r.byte():
            reply["crash_record"] = {"code": r.unsigned(), "detail": r.unsigned(), "pc": r.unsigned(),
                                     "text": r.text()}
    elif variant == 2:
        reply["response"] = "Status"
        reply["status"] = _status(r)
    elif variant == 3:
        reply["response"] = "Config"
        reply["config"] = _config(r)
    elif variant == 4:
        reply["response"] = "Board"
        reply["board"] = {"tip_force_limit_un": r.signed(), "pointer_ahead": r.byte() != 0}
    else:
        reply["response"] = "Rejected"
        reply["error"] = ERRORS[r.unsigned()]
        if reply["error"] == "Version":
            reply["abi"] = r.unsigned()
            reply["schema"] = r.raw(8)
        elif reply["error"] in ("State", "UnknownUnit"):
            reply["value"] = r.byte()
        elif reply["error"] == "Faulted":
            reply["value"] = r.unsigned()
        elif reply["error"] in ("UnitNotReady", "Range"):
            reply["value"] = (r.byte(), r.byte())
    return reply


def decode_board_frame(stuffed):
    """One frame without its closing zero; raises ValueError where it is damaged."""
    data = cobs_decode(stuffed)
    if len(data) < 5 or binascii.crc32(data[:-4]) != struct.unpack("<I", data[-4:])[0]:
        raise ValueError("frame with a wrong checksum")
    r = Reader(data[:-4])
    frame = {"seq": r.unsigned()}
    kind = r.unsigned()
    if kind == 0:
        frame["reply"] = _reply(r)
    elif kind == 1:
        start = r.unsigned()
        frame["samples"] = [_sample(r, start) for _ in range(r.unsigned())]
    elif kind == 2:
        frame["status"] = _status(r)
    elif kind == 3:
        frame["fault"] = {"t_us": r.unsigned(), "unit": r.byte(), "code": r.unsigned(), "detail": r.unsigned()}
    else:
        raise ValueError("unknown message %d" % kind)
    if r.at != len(r.data):
        raise ValueError("%d bytes left over in a frame" % (len(r.data) - r.at))
    return frame


def encode_command(seq, name, body=b"", damaged=False):
    """One frame with its closing zero. `damaged`: one bit of its checksum is wrong."""
    data = unsigned(seq) + unsigned(COMMANDS.index(name)) + body
    crc = binascii.crc32(data) ^ (1 << 12 if damaged else 0)
    return cobs_encode(data + struct.pack("<I", crc)) + b"\0"


class Decoder:
    """Takes bytes as they come, gives frames."""

    def __init__(self):
        self.rest = b""
        self.damaged = 0

    def feed(self, data):
        frames = []
        *whole, self.rest = (self.rest + data).split(b"\0")
        for part in whole:
            if not part:
                continue
            try:
                frames.append(decode_board_frame(part))
            except (ValueError, IndexError):
                self.damaged += 1
        return frames


def hello(abi, schema):
    return unsigned(abi) + schema


def setpoints(valid_ms, newton, inv_cos=1.0):
    body = unsigned(valid_ms)
    for unit, value in enumerate(newton):
        body += signed(round(value * 1e6)) + signed(round(inv_cos * 65536))
        # Three pairs of opposite cables.
        for axis in range(3):
            body += signed((16384 if unit % 2 == 0 else -16384) if axis == unit // 2 else 0)
        # No speed of the reel.
        body += bytes([0])
    return body
