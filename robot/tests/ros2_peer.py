"""A robot on ROS 2 for tests/ros2.rs, by another DDS (cyclonedds).

Publishes measured_js, measured_cp and servo_cf for the domain in argv[1], named as rmw names them, and prints each measured_cf
that it receives as a line of JSON. Ends with its standard input.
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
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), over.set()), daemon=True).start()
    zero = Vector3(0.0, 0.0, 0.0)
    while not over.is_set():
        now = time.time_ns()
        header = Header(Time(now // 1_000_000_000, now % 1_000_000_000), "")
        pose.write(PoseStamped(header, Pose(Vector3(0.02, -0.01, -0.08), Quaternion(0.0, 0.0, 0.0, 1.0))))
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
        for message in applied.take(N=100):
            force = message.wrench.force
            line = {"frame_id": message.header.frame_id, "force": [force.x, force.y, force.z]}
            print(json.dumps(line), flush=True)
        time.sleep(0.01)


main()
