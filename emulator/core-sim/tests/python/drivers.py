"""Other people's drivers of the NAU7802 on the model of the chip, which is at the other end of standard input and output.

Each transaction, each wait and each look at the clock is a line to the model, which answers with a line: time is the model's. What a
driver found goes out as `found NAME VALUE`.
"""

import sys
import time


def ask(*words):
    print(*words, flush=True)
    answer = sys.stdin.readline().split()
    if not answer:
        sys.exit("the model is gone")
    if answer[0] == "nack":
        raise OSError("not acknowledged")
    return [int(word) for word in answer[1:]]


def found(name, value):
    print("found", name, value, flush=True)


def load(microvolts_per_volt):
    ask("load", microvolts_per_volt)


# Before the drivers are loaded: they wait and look at the clock by this module.
time.sleep = lambda seconds: ask("wait", round(seconds * 1e9)) and None
time.time = lambda: ask("time")[0] * 1e-9


class Bus:
    """What smbus2 has, and a driver of the package qwiic_i2c."""

    def read_i2c_block_data(self, address, register, length):
        return ask("read", address, register, length)

    def write_i2c_block_data(self, address, register, data):
        ask("write", address, register, *data)

    def read_byte_data(self, address, register):
        return self.read_i2c_block_data(address, register, 1)[0]

    def write_byte_data(self, address, register, value):
        self.write_i2c_block_data(address, register, [value])

    readByte = read_byte_data
    writeByte = write_byte_data
    readBlock = read_i2c_block_data

    def isDeviceConnected(self, address):
        try:
            ask("write", address)
        except OSError:
            return False
        return True


def sparkfun():
    from qwiic_nau7802 import QwiicNAU7802

    scale = QwiicNAU7802(i2c_driver=Bus())
    found("begin", scale.begin())
    found("revision", scale.get_revision_code())
    # Its Arduino sister reads ten results away before it calibrates again.
    scale.get_average(10)
    found("calibrated", scale.calibrate_afe())
    scale.get_average(10)
    scale.calculate_zero_offset(16)
    load(200)
    scale.get_average(10)
    scale.calculate_calibration_factor(2.0, 16)
    found("codes-per-mv-per-v", scale.get_calibration_factor() * 10)
    if scale.get_calibration_factor() == 0:
        return
    load(-100)
    scale.get_average(10)
    found("weight", scale.get_weight(True, 16))


def ready(chip):
    for _ in range(100):
        if chip.cycle_ready:
            return True
        time.sleep(0.001)
    return False


def mean(chip, count):
    codes = []
    for _ in range(count):
        if not ready(chip):
            return float("nan")
        codes.append(chip.adco.value)
    return sum(codes) / count


def calibrate(chip):
    chip.set_cals(True)
    for _ in range(100):
        if not chip.cals:
            return not chip.cal_err
        time.sleep(0.01)
    return False


def typed():
    from nau7802 import NAU7802
    from typed_registers import SMBusRegisterBus

    chip = NAU7802(SMBusRegisterBus(Bus()))
    chip.initialize()
    chip.set_vldo(5)
    chip.set_gain(7)
    chip.set_crs(3)
    time.sleep(0.7)
    found("revision", chip.rev_id.rev_id)
    found("calibrated", calibrate(chip))
    found("ctrl2", chip.ctrl2.to_byte())
    mean(chip, 10)
    zero = mean(chip, 16)
    load(200)
    mean(chip, 10)
    found("codes-per-mv-per-v", (mean(chip, 16) - zero) * 5)
    first, second = chip.ocal1.value, chip.ocal2.value
    chip.set_channel(2)
    found("calibrated-2", calibrate(chip))
    found("offset-1-kept", chip.ocal1.value == first)
    found("offset-2-new", chip.ocal2.value != second)


{"sparkfun": sparkfun, "typed": typed}[sys.argv[1]]()
