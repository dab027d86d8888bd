# SPDX-License-Identifier: Apache-2.0
"""Wheel odometry model: pose and twist from wheel counters, as a motor controller computes them.

The model uses only the output of `WheelCounters`, never ground truth. The counts equal those of the
referenced `encoders` sensor, including missed ticks and resets. The pose at the first reading is
the origin of the odometry frame (odom in REP 105, in which base_link is reported). The model
assumes motion in a plane, so z, roll and pitch are zero with a variance that means unknown; the
same holds for sideways velocity. A step that exceeds the speed of the wheels, as after a counter
reset, counts as no motion.
"""

import math

import msgspec
import numpy as np

from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.core.errors import UserError
from groundlink.messages import base as messages
from groundlink.messages.navigation import Odometry
from groundlink.scenario.running_gear import (
    Ackermann,
    Differential,
    Omnidirectional,
    SideSteered,
    SkidSteer,
    Towed,
    Tracked,
)
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.wheel_encoders import IncrementalEncoders
from services.sensors.runtime.next_event import NextEvent
from services.sensors.runtime.wheel_counters import WheelCounters, wrapped

from .omni_reckoning import OmniReckoning
from .reckoning import Floats, Reckoned, Reckoning
from .spec import WheelOdometry

UNKNOWN = 1e6
"""Variance of unobserved components, m^2 or rad^2 (per second squared for velocities)."""

POSSIBLE = 2.0
"""Multiple of the wheels' maximum speed. A larger step counts as no motion."""


SKID = {
    SkidSteer: (0.003, 0.04),
    Tracked: (0.015, 0.1),
    Differential: (5e-4, 0.0),
    Ackermann: (5e-4, 0.0),
    Omnidirectional: (2e-3, 0.0),
    Towed: (5e-4, 0.0),
}
"""Default `turn_stddev_share` and `skid_stddev_s` by drive: the skid of the shipped vehicles on
level ground at up to 1 m/s and 0.5 rad/s."""


class _Memory(msgspec.Struct, array_like=True):
    """Part of the odometry that the states do not determine."""

    counters: bytes
    nanos: int = -1
    """Sim time of the last reading; -1 for none."""

    ticks: tuple[int, ...] = ()
    """Counters at the last reading."""

    pose: Reckoned = msgspec.field(default_factory=Reckoned)


class WheelOdometryModel:
    """Wheel odometry of a vehicle (a `RememberingModel`)."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: WheelOdometry) -> None:
        encoders = next((s for s in vehicle.sensors if s.name == spec.encoders), None)
        if not isinstance(encoders, IncrementalEncoders):
            raise UserError(
                f"`{vehicle.name}/{spec.name}` `encoders`: expected the name of a sensor of kind "
                "`encoders`"
            )
        drive, shafts = vehicle.model.drive, vehicle.model.counted
        outward = [vehicle.model.wheels[shaft.wheels[0]].center_m[1] for shaft in shafts]
        lefts = [y > 0 for y in outward]
        self._pivot_x_m = drive.pivot_x_m(vehicle.model.wheels)
        self._frame = vehicle.frame_prefix + spec.frame
        self._child_frame = vehicle.frame_prefix + vehicle.model.base_frame
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._counters = WheelCounters(scenario, vehicle, encoders)
        per_radian = encoders.ticks_per_wheel_revolution / (2 * math.pi)
        self._most_per_second = POSSIBLE * drive.max_wheel_speed_radps * per_radian
        signs = [-1 if shaft.name in encoders.reversed_wheels else 1 for shaft in shafts]
        self._radians = np.array(signs) / per_radian
        self._reckoning: Reckoning | OmniReckoning
        if isinstance(drive, Omnidirectional):
            self._reckoning = _omni_reckoning(vehicle, drive, encoders, spec)
            self.remember(b"")
            self.restart()
            return
        # Rows are left and right. The travel of a side is the mean travel of its wheels.
        travels = np.zeros((2, len(shafts)))
        white = np.full(2, spec.travel_stddev**2)
        for i, (shaft, left, sign) in enumerate(zip(shafts, lefts, signs, strict=True)):
            radius = spec.wheel_radius_m or shaft.radius_m
            side, count = (0 if left else 1), lefts.count(left)
            travels[side, i] = sign * radius / per_radian / count
            white[side] += encoders.slip_stddev**2 * radius / count**2
        self._travels = travels
        # The difference of two counts contains the rounding of both, 1/12 of a squared tick each.
        # These errors do not accumulate: a pose contains the rounding of the first and the last
        # count only.
        self._rounding = np.diag((travels**2).sum(axis=1) / 6)
        scales = [encoders.scale_stddev / math.sqrt(lefts.count(left)) for left in (True, False)]
        turn_share, skid_s = SKID[type(drive)]
        if spec.turn_stddev_share is not None:
            turn_share = spec.turn_stddev_share
        if spec.skid_stddev_s is not None:
            skid_s = spec.skid_stddev_s
        track = np.mean(outward, where=lefts) - np.mean(outward, where=np.logical_not(lefts))
        # The rear wheels of a car do not skid in turns.
        multiplier = drive.track_multiplier if isinstance(drive, SideSteered) else 1.0
        self._reckoning = Reckoning(
            track_m=float(track) * (spec.track_multiplier or multiplier),
            travel_stddevs=np.sqrt(white).tolist(),
            constant_stddevs=(*scales, turn_share, skid_s, skid_s),
        )
        self.remember(b"")
        self.restart()

    def restart(self) -> None:
        """Forget earlier states. Called after a jump in time or a loss of states."""
        self._due.restart()
        self._counters.restart()

    def memory(self) -> bytes:
        """Return the memory for a successor whose first state is that of `settled_tick`."""
        memory = _Memory(self._counters.memory(), self._nanos, self._ticks, self._reckoning.pose)
        return msgspec.msgpack.encode(memory)

    def remember(self, memory: bytes) -> None:
        """Restore a predecessor's memory; empty memory resets to the initial condition."""
        past = msgspec.msgpack.decode(memory, type=_Memory) if memory else _Memory(b"")
        self._counters.remember(past.counters)
        self._nanos, self._ticks = past.nanos, past.ticks
        self._reckoning.pose = past.pose if memory else self._reckoning.origin()

    def settled_tick(self) -> int:
        """Return the tick up to which every reading has been yielded; -1 before the first."""
        return self._due.tick

    def readings(self, state: messages.State) -> list[Odometry]:
        """Return the reading that the next tick's state completes, if any.

        Raises
        ------
        BadBusMessage
            when the state lacks a wheel of the vehicle.
        """
        self._counters.advance(state)
        event = self._due.by(state.tick)
        if event is None:
            return []
        ticks = self._counters.ticks(event.nanos - state.tick * TICK_NANOS)
        return [self._odometry(state.epoch_nanos, event.nanos, ticks)]

    def _steps(self, nanos: int, ticks: tuple[int, ...]) -> tuple[list[int], float]:
        """Return the counts since the last reading, and their time in s; 0 for the first."""
        steps, seconds = [0] * len(ticks), 0.0
        if 0 <= self._nanos < nanos:
            seconds = (nanos - self._nanos) / NANOS
            steps = [wrapped(now - before) for now, before in zip(ticks, self._ticks, strict=True)]
            if max(map(abs, steps)) > self._most_per_second * seconds + 1:
                steps = [0] * len(steps)
        self._nanos, self._ticks = nanos, ticks
        return steps, seconds

    def _omni_odometry(
        self, stamp_nanos: int, reckoning: OmniReckoning, steps: list[int], seconds: float
    ) -> Odometry:
        """Return the odometry of a base that moves in all directions."""
        twist, spread, rounding = np.zeros(3), np.zeros((3, 3)), np.zeros((3, 3))
        if seconds:
            moved, spread = reckoning.step(self._radians * np.array(steps, np.float64))
            rounding = reckoning.from_wheels * self._radians**2 / 6 @ reckoning.from_wheels.T
            twist, spread = moved / seconds, (spread + rounding) / seconds**2
        pose = reckoning.pose
        c, s = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        forward, left, turn_rate = twist.tolist()
        return Odometry(
            stamp_nanos=stamp_nanos,
            frame=self._frame,
            child_frame=self._child_frame,
            position_m=(pose.x_m, pose.y_m, 0.0),
            orientation=(0.0, 0.0, math.sin(pose.yaw_rad / 2), math.cos(pose.yaw_rad / 2)),
            linear_mps=(forward, left, 0.0),
            angular_radps=(0.0, 0.0, turn_rate),
            pose_covariance=_in_space(
                reckoning.covariance() + turned @ rounding @ turned.T, (0, 1, 5)
            ),
            twist_covariance=_in_space(spread, (0, 1, 5)),
        )

    def _odometry(self, epoch_nanos: int, nanos: int, ticks: tuple[int, ...]) -> Odometry:
        """Advance to a reading of the counters and return the odometry."""
        steps, seconds = self._steps(nanos, ticks)
        reckoning = self._reckoning
        if isinstance(reckoning, OmniReckoning):
            return self._omni_odometry(epoch_nanos + nanos, reckoning, steps, seconds)
        speed, turn_rate, spread, rounding = 0.0, 0.0, np.zeros((2, 2)), np.zeros((2, 2))
        if seconds:
            left, right = (self._travels @ np.array(steps, np.float64)).tolist()
            way, turn, spread = reckoning.step(left, right, seconds)
            from_sides = reckoning.from_sides
            rounding = from_sides @ self._rounding @ from_sides.T
            spread = (spread + rounding) / seconds**2
            speed, turn_rate = way / seconds, turn / seconds
        pose, pivot = reckoning.pose, self._pivot_x_m
        cosine, sine = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        along, across = pivot * cosine, pivot * sine
        rolled = np.array([[cosine, 0.0], [sine, 0.0], [0.0, 1.0]])
        covariance = reckoning.covariance() + rolled @ rounding @ rolled.T
        # The wheels move the pivot; the base rotates about it.
        carried = np.array([[1.0, 0.0, across], [0.0, 1.0, -along], [0.0, 0.0, 1.0]])
        return Odometry(
            stamp_nanos=epoch_nanos + nanos,
            frame=self._frame,
            child_frame=self._child_frame,
            position_m=(pose.x_m + pivot - along, pose.y_m - across, 0.0),
            orientation=(0.0, 0.0, math.sin(pose.yaw_rad / 2), math.cos(pose.yaw_rad / 2)),
            linear_mps=(speed, -pivot * turn_rate, 0.0),
            angular_radps=(0.0, 0.0, turn_rate),
            pose_covariance=_in_space(carried @ covariance @ carried.T, (0, 1, 5)),
            twist_covariance=_in_space(spread, (0, 5)),
        )


def _omni_reckoning(
    vehicle: Vehicle, drive: Omnidirectional, encoders: IncrementalEncoders, spec: WheelOdometry
) -> OmniReckoning:
    """Return the dead reckoning of a base that moves in all directions."""
    model = vehicle.model
    shafts, rows = model.counted, np.array(drive.rows(model.wheels))
    radii = np.array([shaft.radius_m for shaft in shafts])
    turn_share, _ = SKID[Omnidirectional]
    if spec.turn_stddev_share is not None:
        turn_share = spec.turn_stddev_share
    believed = np.array([spec.wheel_radius_m or radius for radius in radii])
    # The controller believes in its own radii; `track_multiplier` slows the wheels' turn alone.
    rows = rows * (radii / believed)[:, None] * [1.0, 1.0, spec.track_multiplier or 1.0]
    white = np.sqrt(spec.travel_stddev**2 + encoders.slip_stddev**2 * believed)
    return OmniReckoning(
        rows,
        believed.tolist(),
        travel_stddevs=white.tolist(),
        constant_stddevs=[*[encoders.scale_stddev] * len(shafts), turn_share],
    )


def _in_space(covariance: Floats, rows: tuple[int, ...]) -> memoryview:
    """Return a planar covariance as 6 x 6; components outside of the plane are unknown."""
    whole = UNKNOWN * np.eye(6)
    whole[np.ix_(rows, rows)] = covariance
    return messages.packed(whole)
