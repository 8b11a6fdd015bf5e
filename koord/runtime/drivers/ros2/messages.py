"""Messages of ROS 2 as DDS carries them: the types, and their names on the wire.

A type `geometry_msgs/msg/Twist` is `geometry_msgs::msg::dds_::Twist_` there. Fields, their order
and their widths are those of the published packages geometry_msgs, std_msgs, nav_msgs, sensor_msgs
and ackermann_msgs. Needs `cyclonedds`.
"""

# Without annotations as text: the library reads them as types.

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import (
    array,
    float32,
    float64,
    int8,
    int32,
    sequence,
    uint8,
    uint16,
    uint32,
)

if TYPE_CHECKING:
    Covariance = list[float]
    Covariance9 = list[float]
    Numbers = list[float]
else:
    Covariance = array[float64, 36]
    Covariance9 = array[float64, 9]
    Numbers = sequence[float32]


def _no_covariance() -> list[float]:
    return [0.0] * 36


def _wire(package: str, name: str) -> str:
    """The name of a type on the wire."""
    return f"{package}::msg::dds_::{name}_"


# --- parts --------------------------------------------------------------------------------------


@dataclass
class Time(IdlStruct, typename=_wire("builtin_interfaces", "Time")):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename=_wire("std_msgs", "Header")):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Point(IdlStruct, typename=_wire("geometry_msgs", "Point")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Vector3(IdlStruct, typename=_wire("geometry_msgs", "Vector3")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
class Quaternion(IdlStruct, typename=_wire("geometry_msgs", "Quaternion")):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
class Pose(IdlStruct, typename=_wire("geometry_msgs", "Pose")):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseWithCovariance(IdlStruct, typename=_wire("geometry_msgs", "PoseWithCovariance")):
    pose: Pose = field(default_factory=Pose)
    covariance: Covariance = field(default_factory=_no_covariance)


@dataclass
class Twist(IdlStruct, typename=_wire("geometry_msgs", "Twist")):
    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class TwistWithCovariance(IdlStruct, typename=_wire("geometry_msgs", "TwistWithCovariance")):
    twist: Twist = field(default_factory=Twist)
    covariance: Covariance = field(default_factory=_no_covariance)


@dataclass
class Transform(IdlStruct, typename=_wire("geometry_msgs", "Transform")):
    translation: Vector3 = field(default_factory=Vector3)
    rotation: Quaternion = field(default_factory=Quaternion)


@dataclass
class AckermannDrive(IdlStruct, typename=_wire("ackermann_msgs", "AckermannDrive")):
    steering_angle: float32 = 0.0
    steering_angle_velocity: float32 = 0.0
    speed: float32 = 0.0
    acceleration: float32 = 0.0
    jerk: float32 = 0.0


# --- messages -----------------------------------------------------------------------------------


@dataclass
class PoseStamped(IdlStruct, typename=_wire("geometry_msgs", "PoseStamped")):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
class PoseWithCovarianceStamped(
    IdlStruct, typename=_wire("geometry_msgs", "PoseWithCovarianceStamped")
):
    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class TransformStamped(IdlStruct, typename=_wire("geometry_msgs", "TransformStamped")):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    transform: Transform = field(default_factory=Transform)


@dataclass
class TwistStamped(IdlStruct, typename=_wire("geometry_msgs", "TwistStamped")):
    header: Header = field(default_factory=Header)
    twist: Twist = field(default_factory=Twist)


@dataclass
class Odometry(IdlStruct, typename=_wire("nav_msgs", "Odometry")):
    header: Header = field(default_factory=Header)
    child_frame_id: str = ""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)


@dataclass
class AckermannDriveStamped(IdlStruct, typename=_wire("ackermann_msgs", "AckermannDriveStamped")):
    header: Header = field(default_factory=Header)
    drive: AckermannDrive = field(default_factory=AckermannDrive)


@dataclass
class LaserScan(IdlStruct, typename=_wire("sensor_msgs", "LaserScan")):
    header: Header = field(default_factory=Header)
    angle_min: float32 = 0.0
    angle_max: float32 = 0.0
    angle_increment: float32 = 0.0
    time_increment: float32 = 0.0
    scan_time: float32 = 0.0
    range_min: float32 = 0.0
    range_max: float32 = 0.0
    ranges: Numbers = field(default_factory=list)
    intensities: Numbers = field(default_factory=list)


@dataclass
class NavSatStatus(IdlStruct, typename=_wire("sensor_msgs", "NavSatStatus")):
    status: int8 = 0  #: -1: it has no fix
    service: uint16 = 1


@dataclass
class NavSatFix(IdlStruct, typename=_wire("sensor_msgs", "NavSatFix")):
    header: Header = field(default_factory=Header)
    status: NavSatStatus = field(default_factory=NavSatStatus)
    latitude: float64 = 0.0
    longitude: float64 = 0.0
    altitude: float64 = 0.0
    position_covariance: Covariance9 = field(default_factory=lambda: [0.0] * 9)
    position_covariance_type: uint8 = 0


@dataclass
class BatteryState(IdlStruct, typename=_wire("sensor_msgs", "BatteryState")):
    header: Header = field(default_factory=Header)
    voltage: float32 = 0.0
    temperature: float32 = 0.0
    current: float32 = 0.0
    charge: float32 = 0.0
    capacity: float32 = 0.0
    design_capacity: float32 = 0.0
    percentage: float32 = 0.0
    power_supply_status: uint8 = 0
    power_supply_health: uint8 = 0
    power_supply_technology: uint8 = 0
    present: bool = True
    cell_voltage: Numbers = field(default_factory=list)
    cell_temperature: Numbers = field(default_factory=list)
    location: str = ""
    serial_number: str = ""


@dataclass
class Float64(IdlStruct, typename=_wire("std_msgs", "Float64")):
    data: float64 = 0.0


@dataclass
class Bool(IdlStruct, typename=_wire("std_msgs", "Bool")):
    data: bool = False


@dataclass
class Int32(IdlStruct, typename=_wire("std_msgs", "Int32")):
    data: int32 = 0


@dataclass
class String(IdlStruct, typename=_wire("std_msgs", "String")):
    data: str = ""
