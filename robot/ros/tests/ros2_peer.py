"""A robot on ROS 2 for tests/ros2.rs, by another DDS (cyclonedds).

Publishes measured_js, measured_cp, body/measured_cf and servo_cf for the domain in argv[1], named as rmw names them, and prints
each measured_cf, measured_cf_estimated and its half width that it receives as a line of JSON. operating_state is published as a dVRK 2 does: once,
when it changes, reliable and transient local. Each line of standard input is a command: `silence` ends the poses while the
joints go on, `command X` sends the rig the state_command X, another one is the robot's operating state from then on. The rig's
operating_state is printed when it comes. Ends with its standard input.
"""
import json
import sys
import threading
import time
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Vector3
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector3
    torque: Vector3


@dataclass
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header
    wrench: Wrench


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class OperatingState(IdlStruct, typename="crtk_msgs::msg::dds_::OperatingState_"):
    header: Header
    state: str
    is_homed: bool
    is_busy: bool


@dataclass
class StringStamped(IdlStruct, typename="crtk_msgs::msg::dds_::StringStamped_"):
    header: Header
    string: str


def main() -> None:
    participant = DomainParticipant(int(sys.argv[1]))
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(10))

    def topic(name, kind):
        return Topic(participant, "rt" + name, kind)

    joints = DataWriter(participant, topic("/arm/measured_js", JointState), qos=qos)
    pose = DataWriter(participant, topic("/arm/measured_cp", PoseStamped), qos=qos)
    request = DataWriter(participant, topic("/cable_rig/spatial/servo_cf", WrenchStamped), qos=qos)
    applied = DataReader(
        participant, topic("/cable_rig/spatial/measured_cf", WrenchStamped), qos=qos
    )
    estimated = DataReader(
        participant, topic("/cable_rig/spatial/measured_cf_estimated", WrenchStamped), qos=qos
    )
    half_width = DataReader(
        participant,
        topic("/cable_rig/spatial/measured_cf_estimated_half_width", WrenchStamped),
        qos=qos,
    )
    own = DataWriter(participant, topic("/arm/body/measured_cf", WrenchStamped), qos=qos)
    latched = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.Durability.TransientLocal,
        Policy.History.KeepLast(1),
    )
    operating = DataWriter(participant, topic("/arm/operating_state", OperatingState), qos=latched)

    def say(state):
        # Its stamp is left at 0, as publishers of events often do.
        operating.write(OperatingState(Header(Time(0, 0), ""), state, True, False))

    rig = DataReader(participant, topic("/cable_rig/operating_state", OperatingState), qos=latched)
    to_rig = DataWriter(participant, topic("/cable_rig/state_command", StringStamped), qos=qos)

    over, silence = threading.Event(), threading.Event()

    def commands():
        for line in sys.stdin:
            if line.strip() == "silence":
                silence.set()
            elif line.startswith("command "):
                to_rig.write(StringStamped(Header(Time(0, 0), ""), line.split()[1]))
            else:
                say(line.strip())
        over.set()

    say("ENABLED")
    threading.Thread(target=commands, daemon=True).start()
    zero = Vector3(0.0, 0.0, 0.0)
    while not over.is_set():
        now = time.time_ns()
        header = Header(Time(now // 1_000_000_000, now % 1_000_000_000), "")
        # A half turn about x: the tool's y and z are against the base frame's.
        where = Pose(Vector3(0.02, -0.01, -0.08), Quaternion(1.0, 0.0, 0.0, 0.0))
        if not silence.is_set():
            pose.write(PoseStamped(Header(header.stamp, "PSM1_base"), where))
        own.write(WrenchStamped(header, Wrench(Vector3(0.1, 0.2, 0.3), zero)))
        joints.write(
            JointState(
                header,
                ["shoulder", "elbow", "insertion"],
                [0.5, 1.5, 0.4],
                [0.01, 0.02, 0.003],
                [0.1, -0.2, 3.0],
            )
        )
        request.write(WrenchStamped(header, Wrench(Vector3(0.5, 1.5, -0.5), zero)))
        for name, reader in (
            ("applied", applied),
            ("estimated", estimated),
            ("half_width", half_width),
        ):
            # A writer that leaves is a sample without data.
            samples = (m for m in reader.take(N=100) if isinstance(m, WrenchStamped))
            for message in samples:
                force = message.wrench.force
                line = {
                    "topic": name,
                    "frame_id": message.header.frame_id,
                    "stamp": [message.header.stamp.sec, message.header.stamp.nanosec],
                    "force": [force.x, force.y, force.z],
                }
                print(json.dumps(line), flush=True)
        for message in rig.take(N=10):
            if isinstance(message, OperatingState):
                print(json.dumps({"topic": "rig", "state": message.state}), flush=True)
        time.sleep(0.01)


main()
