# SPDX-License-Identifier: Apache-2.0
"""Codecs of the clock, velocity commands, IMU samples and wheel counters."""

import struct
from functools import lru_cache
from typing import Any

import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.messages.base import Clock, Command, Imu, WheelEncoders

from .codec import Codec, Moment, check_finite, stamp_and_frame
from .types import (
    WHEEL_ENCODERS_DEFINITION,
    header,
    nanos,
    quaternion,
    time,
    vector,
    xyz,
    xyzw,
)


def _clock(message: Clock) -> dict[str, Any]:
    return {"clock": time(message.stamp_nanos)}


def _clock_of(ros: Any, moment: Moment) -> Clock:
    stamp = nanos(ros.clock)
    epoch = moment.epoch_nanos
    return Clock(stamp, epoch, (stamp - epoch) // TICK_NANOS, episode=epoch)


def _twist(message: Command) -> dict[str, Any]:
    return {"linear": vector(message.linear_mps), "angular": vector(message.angular_radps)}


def _command_of(ros: Any, moment: Moment) -> Command:
    return Command(moment.nanos, xyz(ros.linear), xyz(ros.angular))


def read_twist(ros: Any, now_nanos: int) -> Command:
    """Return the velocity of a geometry_msgs/Twist, valid from `now_nanos`."""
    linear, angular = xyz(ros.linear), xyz(ros.angular)
    check_finite(*linear, *angular)
    return Command(now_nanos, linear, angular)


def read_twist_stamped(ros: Any, now_nanos: int) -> Command:
    """Return the velocity of a geometry_msgs/TwistStamped, valid from `now_nanos`.

    The stamp is ignored, since it may come from another clock than the run's.
    """
    return read_twist(ros.twist, now_nanos)


@lru_cache(maxsize=256)
def diagonal(variance: float) -> np.ndarray[Any, Any]:
    """Return the covariance of three independent axes, row-major, shape (9,)."""
    covariance = np.diag(np.full(3, variance, np.float64)).ravel()
    covariance.setflags(write=False)
    return covariance


def _imu(message: Imu) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "orientation": quaternion(message.orientation),
        "orientation_covariance": diagonal(message.orientation_variance),
        "angular_velocity": vector(message.angular_velocity_radps),
        "angular_velocity_covariance": diagonal(message.angular_velocity_variance),
        "linear_acceleration": vector(message.linear_acceleration_mps2),
        "linear_acceleration_covariance": diagonal(message.linear_acceleration_variance),
    }


@lru_cache(maxsize=4096)
def _imu_layout(frame: str) -> tuple[struct.Struct, int, bytes]:
    """Return the layout of an Imu as CDR, and length and text of its frame with the final zero."""
    text = frame.encode() + b"\0"
    # Behind the encapsulation header, stamp and length take 12 bytes; float64 is aligned to 8.
    padded = len(text) + (-12 - len(text)) % 8
    return struct.Struct(f"<4siII{padded}s37d"), len(text), text


def _imu_cdr(message: Imu) -> bytes:
    """Return the CDR of `_imu`, little-endian."""
    layout, length, text = _imu_layout(message.frame)
    turn, rate, force = (
        message.orientation_variance,
        message.angular_velocity_variance,
        message.linear_acceleration_variance,
    )
    return layout.pack(
        *(b"\0\1\0\0", *divmod(message.stamp_nanos, NANOS), length, text),
        *(*message.orientation, turn, 0.0, 0.0, 0.0, turn, 0.0, 0.0, 0.0, turn),
        *(*message.angular_velocity_radps, rate, 0.0, 0.0, 0.0, rate, 0.0, 0.0, 0.0, rate),
        *(*message.linear_acceleration_mps2, force, 0.0, 0.0, 0.0, force, 0.0, 0.0, 0.0, force),
    )


def _imu_of(ros: Any, moment: Moment) -> Imu:
    return Imu(
        *stamp_and_frame(ros),
        xyzw(ros.orientation),
        xyz(ros.angular_velocity),
        xyz(ros.linear_acceleration),
        float(ros.orientation_covariance[0]),
        float(ros.angular_velocity_covariance[0]),
        float(ros.linear_acceleration_covariance[0]),
    )


def _wheel_encoders(message: WheelEncoders) -> dict[str, Any]:
    return {
        "header": header(message.stamp_nanos, message.frame),
        "name": list(message.names),
        "ticks": np.array(message.ticks, np.int64),
    }


def _wheel_encoders_of(ros: Any, moment: Moment) -> WheelEncoders:
    return WheelEncoders(*stamp_and_frame(ros), tuple(ros.name), tuple(ros.ticks.tolist()))


CODECS = (
    Codec(Clock, "rosgraph_msgs/msg/Clock", _clock, _clock_of),
    Codec(Command, "geometry_msgs/msg/Twist", _twist, _command_of, read_twist),
    Codec(Imu, "sensor_msgs/msg/Imu", _imu, _imu_of, pack=_imu_cdr),
    Codec(
        WheelEncoders,
        "groundlink_msgs/msg/WheelEncoders",
        _wheel_encoders,
        _wheel_encoders_of,
        definition=WHEEL_ENCODERS_DEFINITION,
    ),
)
