# SPDX-License-Identifier: Apache-2.0
"""GNSS receiver model (section 3.3.5 of the paper), with drift, startup, outages and latency.

Fix i is measured at event i of the rate's schedule, at the antenna's position at that instant, and
published after the receiver's latency. Its stamp is the instant of measurement. The antenna's
position in the world is converted to Earth-centered axes, the errors are added, and the sum is
converted to latitude, longitude and altitude. The errors are drawn along east, north and up of the
world's origin, because a receiver is less accurate vertically. If both are configured alike, the
result is the paper's error of equal size along the Earth's axes. Hidden parts of the sky scale the
errors by the dilution of precision. Reflections shift the position by their errors of range. With
too few satellites there is no fix.

Without a fix, at startup or in an outage, the receiver reports status -1 and NaN at its rate. The
type of solution depends on the satellites and on how long they have been received (`fix_state`).
False fixes are not modeled.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, Schedule, exact
from groundlink.core.errors import UserError
from groundlink.core.fields import Vector3
from groundlink.core.frames import Floats, matrix_from_quaternion
from groundlink.messages.base import BadBusMessage, State, floats, packed
from groundlink.messages.navigation import NavSatFix
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.error_processes import BLOCK_TICKS, ErrorProcesses
from services.sensors.noise.normal import PolarNormal
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.runtime import nmea
from services.sensors.runtime.model import Datagram
from services.sensors.runtime.next_event import Event, NextEvent

from .fix_state import FixState, Solved
from .geodesy import Geodetic, TangentPlane, geodetic_from_ecef
from .multipath import range_errors_m
from .reception import Path, Reception, Signals
from .sky import Satellite
from .spec import Gnss, Solution


class FixErrors(NamedTuple):
    """Errors of one fix along east, north and up, under an open sky."""

    position_m: Vector3
    velocity_mps: Vector3


class GnssErrors:
    """Error model of a receiver: white noise, slow drift and velocity noise.

    An error is a function of the seed, the sensor's name and the number of the fix; it does not
    depend on the start time of the process.
    """

    def __init__(self, spec: Gnss, streams: RandomStreams) -> None:
        self._streams = streams
        self._schedule = Schedule.at(spec.rate_hz)
        axes = (spec.horizontal, spec.horizontal, spec.vertical)
        self._white = [axis.white_stddev_m for axis in axes]
        self._velocity = spec.velocity_stddev_mps
        self._drift = ErrorProcesses(
            streams,
            "drift",
            stddevs=[axis.drift_stddev_m for axis in axes],
            time_constants_s=[spec.drift_time_s] * 3,
            noise_source="marsaglia",
        )
        self.variances_m2 = [axis.white_stddev_m**2 + axis.drift_stddev_m**2 for axis in axes]

    def of_fix(self, index: int) -> FixErrors:
        """Return the errors of fix `index`."""
        tick = self._schedule.tick(index)
        normal = PolarNormal(self._streams.at("white", tick)).draw(6).tolist()
        block, row = divmod(tick, BLOCK_TICKS)
        drift = self._drift.block(block)[row].tolist()
        east, north, up = (
            sigma * number + slow
            for sigma, number, slow in zip(self._white, normal[:3], drift, strict=True)
        )
        ve, vn, vu = (self._velocity * number for number in normal[3:])
        return FixErrors((east, north, up), (ve, vn, vu))


SERVICES = {"gps": 1, "glonass": 2, "beidou": 4, "galileo": 8}
"""Bits of sensor_msgs/NavSatStatus.service by `Walker.system`."""

FIXES_REMEMBERED = 256
"""Number of stored solutions. Native messages remain available for fixes that are delayed by up to
12 s at 20 Hz."""

DIAGONAL_KNOWN = 2
"""sensor_msgs/NavSatFix.COVARIANCE_TYPE_DIAGONAL_KNOWN."""


class _Kind(NamedTuple):
    """Codes of one kind of solution."""

    status: int
    """Status in sensor_msgs/NavSatStatus."""

    quality: int
    mode: str
    """Quality in GGA, and mode in RMC and VTG: see `nmea.Epoch`."""

    minute_decimals: int


KINDS = {
    "single_point": _Kind(0, 1, "A", 5),
    "sbas": _Kind(1, 2, "D", 5),
    "rtk_float": _Kind(2, 5, "F", 7),
    "rtk_fix": _Kind(2, 4, "R", 7),
}
"""Codes by the scenario's `solution`."""


class Details(NamedTuple):
    """What native messages say of a fix."""

    epoch: nmea.Epoch
    signals: Signals
    solved: Solved | None
    up_mps: float = 0.0


@dataclass(frozen=True)
class _Measured:
    """Measured fix that is not published yet because of the receiver's latency."""

    tick: int
    """Tick whose state completed the measurement."""

    memory: bytes
    """Memory before the measurement."""

    due_tick: int
    fix: NavSatFix
    details: Details


class GnssModel:
    """GNSS receiver of a vehicle (a `RememberingModel`).

    Attributes
    ----------
    satellites : tuple of Satellite
        In the order of `Signals`.

    Raises
    ------
    UserError
        when the world has no datum, or the satellites give no position.
    KernelsMissingError
        with `sky_view`, when the compiled loops are not installed.
    """

    def __init__(self, scenario: Scenario, vehicle: Vehicle, spec: Gnss) -> None:
        datum = scenario.world.datum
        if datum is None:
            raise UserError(
                f"`{spec.name}` needs the world's position on Earth. Fix: add `datum` to the world"
            )
        self._vehicle = vehicle.name
        self._frame = vehicle.frame_prefix + spec.frame
        self._link = vehicle.model.link_of(spec.mount)
        self._antenna_in_link = np.array(spec.mount.xyz_m)
        self._geoid_m = datum.geoid_m
        self._plane = TangentPlane(
            Geodetic.of_degrees(datum.latitude_deg, datum.longitude_deg, datum.altitude_m)
        )
        self._due = NextEvent(Schedule.at(spec.rate_hz))
        self._latency_nanos = int(exact(spec.latency_s) * NANOS)
        self._jitter_nanos = int(exact(spec.latency_jitter_s) * NANOS)
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")
        self._solutions = [
            (solution, GnssErrors(_with_noise_of(spec, solution), self._streams))
            for solution in spec.ranked_solutions()
        ]
        self._reception = Reception(scenario, vehicle, spec, self._plane)
        self.satellites: tuple[Satellite, ...] = self._reception.sky.satellites
        systems = {satellite.system for satellite in self.satellites}
        self._service = sum(SERVICES[system] for system in systems)
        self._talker = "GP" if systems == {"gps"} else "GN"
        self._multipath = spec.multipath
        self._state = FixState(spec.ranked_solutions(), len(self.satellites))
        self._sent: dict[int, Details] = {}
        unseen = Signals.none(len(self.satellites))
        self._nothing = Details(nmea.Epoch(0, 0, "N"), unseen, None)
        self.restart()

    def memory(self) -> bytes:
        """Return the locks before the first fix that is not published yet."""
        return self._waiting[0].memory if self._waiting else self._state.memory()

    def remember(self, memory: bytes) -> None:
        """Restore the result of an earlier `memory()`; empty memory is without locks."""
        self._state.remember(memory)

    def restart(self) -> None:
        """Forget earlier states and locks, and fixes that are not published yet."""
        self._reception.restart()
        self._state.restart()
        self._due.restart()
        self._pose: Floats = np.zeros(7)
        self._waiting: deque[_Measured] = deque()

    def settled_tick(self) -> int:
        """Return the tick whose state a successor must receive first; -1 before the first fix."""
        if self._waiting:
            return self._waiting[0].tick - 1
        return self._due.tick

    def readings(self, state: State) -> list[NavSatFix]:
        """Take the state of the next tick and return the fixes that are due for publication.

        Raises
        ------
        BadBusMessage
            when the state lacks the vehicle, or any vehicle with `sky_view`; the model is then
            restarted.
        """
        try:
            pose, velocity = self._motion(state)
            self._reception.take(state)
        except BadBusMessage:
            self.restart()
            raise
        last, self._pose = self._pose, pose
        if event := self._due.by(state.tick):
            self._waiting.append(self._measure(state, event, last, velocity))
        out = []
        while self._waiting and self._waiting[0].due_tick <= state.tick:
            out.append(self._waiting.popleft())
            self._sent[out[-1].fix.stamp_nanos] = out[-1].details
            if len(self._sent) > FIXES_REMEMBERED:
                del self._sent[next(iter(self._sent))]
        return [one.fix for one in out]

    def datagrams(self, fix: NavSatFix, epoch_nanos: int) -> list[Datagram]:
        """Return the NMEA sentences of a published fix."""
        return [Datagram(sentence) for sentence in nmea.sentences(self.details(fix).epoch)]

    def details(self, fix: NavSatFix) -> Details:
        """Return what native messages say of a published fix.

        Time, position and validity are those of `fix`, so all formats agree after a fault has
        changed the fix. The other values are those of the solution with this stamp, or of the
        newest. A model that has published no fix, such as that of a changed world, knows none.
        """
        newest = next(reversed(self._sent.values()), self._nothing)
        known = self._sent.get(fix.stamp_nanos, newest)
        epoch = known.epoch._replace(stamp_nanos=fix.stamp_nanos)
        if fix.status < 0 or not epoch.fixed:
            epoch = nmea.Epoch(fix.stamp_nanos, 0, "N", talker=self._talker)
            return Details(epoch, known.signals, None)
        epoch = epoch._replace(
            latitude_deg=fix.latitude_deg,
            longitude_deg=fix.longitude_deg,
            altitude_m=fix.altitude_m,
        )
        return known._replace(epoch=epoch)

    def _motion(self, state: State) -> tuple[Floats, Floats]:
        """Return the antenna's link's pose, shape (7,), and the base's velocity, shape (6,)."""
        vehicle = state.vehicles.get(self._vehicle)
        if vehicle is None or len(vehicle.poses()) <= self._link:
            name = self._vehicle
            raise BadBusMessage(f"state of tick {state.tick}: no link poses of `{name}`")
        velocity = floats(vehicle.base_velocity)
        if len(velocity) != 6:
            raise BadBusMessage(f"state of tick {state.tick}: no velocity of `{self._vehicle}`")
        return vehicle.poses()[self._link], velocity

    def _measure(self, state: State, event: Event, last: Floats, velocity: Floats) -> _Measured:
        """Return the fix of an event after the last tick and not after this tick.

        Parameters
        ----------
        last : shape (7,)
            Pose of the antenna's link at the last tick; zeros at the first.
        velocity : shape (6,)
            Velocity of the base at this tick.
        """
        # Zero if the event coincides with the tick. Only then may the last state be missing.
        back = (event.nanos - state.tick * TICK_NANOS) / TICK_NANOS
        lever = matrix_from_quaternion(self._pose[3:]) @ self._antenna_in_link
        antenna = self._pose[:3] + lever
        moving = velocity[:3] + np.cross(velocity[3:], lever)
        if back or (self._link and last.any()):
            before = last[:3] + matrix_from_quaternion(last[3:]) @ self._antenna_in_link
            if self._link:
                moving = (antenna - before) * TICK_RATE_HZ
            antenna = antenna + back * (antenna - before)
        stamp_nanos = state.epoch_nanos + event.nanos
        memory, due_tick = self._state.memory(), self._due_tick(event)
        signals = self._reception.signals(event.nanos, antenna)
        solved = self._state.take(event.nanos, signals)
        if solved is None:
            return _Measured(state.tick, memory, due_tick, *self._lost(stamp_nanos, signals))
        solution, errors = self._solutions[solved.rank]
        error = errors.of_fix(event.number)
        typical_enu = self._reception.sky.typical_dilution_enu
        worse = [
            now / usual
            for now, usual in zip(solved.geometry.dilution_enu, typical_enu, strict=True)
        ]
        east, north, up = (
            off * factor + shift
            for off, factor, shift in zip(
                error.position_m, worse, self._reflection_error_m(solved, signals), strict=True
            )
        )
        x, y, z = self._plane.ecef(_vector(antenna))
        dx, dy, dz = self._plane.turned((east, north, up))
        place = geodetic_from_ecef((x + dx, y + dy, z + dz))
        variances = [
            variance * factor**2
            for variance, factor in zip(errors.variances_m2, worse, strict=True)
        ]
        kind = KINDS[solution.type]
        fix = NavSatFix(
            stamp_nanos=stamp_nanos,
            frame=self._frame,
            status=kind.status,
            service=self._service,
            latitude_deg=math.degrees(place.latitude_rad),
            longitude_deg=math.degrees(place.longitude_rad),
            altitude_m=place.altitude_m,
            position_covariance_m2=packed(np.diag(variances)),
            covariance_type=DIAGONAL_KNOWN,
        )
        epoch = nmea.Epoch(
            *(stamp_nanos, kind.quality, kind.mode, kind.minute_decimals),
            geoid_m=self._geoid_m,
            east_mps=float(moving[0]) + error.velocity_mps[0],
            north_mps=float(moving[1]) + error.velocity_mps[1],
            satellites=solved.geometry.satellites,
            horizontal_dilution=solved.geometry.horizontal_dilution,
            talker=self._talker,
        )
        details = Details(epoch, signals, solved, float(moving[2]) + error.velocity_mps[2])
        return _Measured(state.tick, memory, due_tick, fix, details)

    def _due_tick(self, event: Event) -> int:
        """Return the tick at which the fix of an event is published, at the earliest."""
        nanos = event.nanos + self._latency_nanos
        if self._jitter_nanos:
            nanos += int(self._streams.at("latency", event.tick).random() * self._jitter_nanos)
        return -(-nanos // TICK_NANOS)

    def _reflection_error_m(self, solved: Solved, signals: Signals) -> Vector3:
        """Return the error of a position by reflected signals: east, north, up."""
        if self._multipath is None:
            return 0.0, 0.0, 0.0
        errors = range_errors_m(
            signals.detour_m,
            signals.path == Path.DIRECT,
            self._multipath,
            by_carrier=self._solutions[solved.rank][0].by_carrier,
        )
        return _vector(solved.geometry.estimator[:3] @ errors[solved.used])

    def _lost(self, stamp_nanos: int, signals: Signals) -> tuple[NavSatFix, Details]:
        """Return the messages of a receiver without a fix."""
        fix = NavSatFix(
            stamp_nanos=stamp_nanos,
            frame=self._frame,
            status=-1,
            service=self._service,
            latitude_deg=math.nan,
            longitude_deg=math.nan,
            altitude_m=math.nan,
            position_covariance_m2=packed(np.zeros(9)),
            covariance_type=0,
        )
        epoch = nmea.Epoch(stamp_nanos, 0, "N", talker=self._talker)
        return fix, Details(epoch, signals, None)


def _with_noise_of(spec: Gnss, solution: Solution) -> Gnss:
    """Return the receiver with the errors of one type of solution."""
    return replace(spec, horizontal=solution.horizontal, vertical=solution.vertical)


def _vector(xyz: Floats) -> Vector3:
    x, y, z = xyz.tolist()
    return x, y, z
