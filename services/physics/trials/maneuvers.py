# SPDX-License-Identifier: Apache-2.0
"""Maneuvers of the trials: stand, drive straight, turn, stop, climb and lean.

Each takes a vehicle's model and returns figures with their limits. The same model gives the same
figures.
"""

from collections.abc import Iterator
from math import atan2, cos, degrees, hypot, radians, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import TICK_RATE_HZ, TICK_SECONDS
from groundlink.report.analysis.trials import Trial, TrialCurve, TrialFigure, TrialPlot
from groundlink.scenario.running_gear import Omnidirectional, SideSteered
from groundlink.scenario.schema import Placement
from groundlink.scenario.vehicle import VehicleModel
from services.physics.dynamics.backend import GRAVITY_MPS2
from services.physics.dynamics.bullet import BulletBackend

from .track import FLOOR_M, NAME, Drive, drive, put, ramp, rolled, slope, travels

CURVE_TICKS = 8
"""Ticks between points of a curve: 50 points a second."""

STAND_SECONDS = 2.0
SHAKING_MPS2 = 0.05
"""An IMU of 0.05 m/s2 noise would not show it."""

STOOD_M = 1e-3
STOOD_DEG = degrees(2e-3)

STRAIGHT_M = 10.0
STRAIGHT_SECONDS = 30.0
"""Slow vehicles drive for this long only."""

WITHIN = 0.01
"""Share by which distances and rates may differ."""

TURN_RADPS = 0.6
TURN_SECONDS = 3.0
SIDEWAYS_SECONDS = 3.0
HARDLY = 0.1
"""Below this share of the commanded rate the wheels do not turn the vehicle."""

WANDER_M = 0.1
"""Distance from its place of a vehicle that turns on the spot."""

RUN_UP_M = 0.9 * FLOOR_M
"""Length of the floor for the run-up and the stop."""

STOP_FACTOR = 1.25
"""A longer way than by the drive's own deceleration, by this factor, is too long."""

NOSE_DEG = 20.0
"""Pitch at a stop; springs give way by a few degrees."""

CLIMB_DEG = 20.0
CLIMB_M = 20.0
CLIMB_MPS = 1.0
CLIMBED_SHARE = 0.65
"""Share of the height that the way up would reach without slip."""

CLIMB_FROM_M = -1.0
SLOPE_AT_M = 4.0
HOLD_SECONDS = 10.0
HELD_M = 0.005
PITCH_DEG = 5.0
"""How far a vehicle on its springs is from the slope's angle."""

LEAN_DEGPS = 2.5
"""Speed at which the slope gets steeper; springs follow it."""

LEAN_MAX_DEG = 60.0
TIPPED_DEG = 25.0
"""Lean on level ground: farther than springs give way."""

SLID_M = 0.3
SLIDING_MPS = 0.03
"""Speed aside that a vehicle on its springs does not reach by leaning alone."""

TIPPING_DEGPS = 3 * LEAN_DEGPS
"""Springs give way more slowly."""


def all_trials(model: VehicleModel, *, climb_deg: float = CLIMB_DEG) -> Iterator[Trial]:
    """Yield all trials of a vehicle, as they are done."""
    for trial in (stand, straight, turn, stop):
        yield trial(model)
    if isinstance(model.drive, Omnidirectional):
        yield sideways(model)
    yield climb(model, climb_deg)
    yield lean(model, climb_deg)


def stand(model: VehicleModel) -> Trial:
    """Let a vehicle stand on level ground."""
    with put(model) as simulation:
        before = simulation.vehicle_states()[NAME].poses()[0].copy()
        stood = drive(simulation, STAND_SECONDS)
    shaking = float(np.abs(np.diff(stood.velocity[:, :3], axis=0)).max()) / TICK_SECONDS
    apart = np.abs(stood.pose[-1] - before)
    moved, turned = float(apart[:3].max()), degrees(2 * float(apart[3:].max()))
    return Trial(
        "stand",
        f"stand on level ground for {STAND_SECONDS:g} s",
        (
            _at_most("shaking", shaking, "m/s2", SHAKING_MPS2),
            _at_most("moved", 1e3 * moved, "mm", 1e3 * STOOD_M),
            _at_most("turned", turned, "deg", STOOD_DEG),
        ),
        (_over_time("height of the base, mm", ("true", 1e3 * stood.pose[:, 2])),),
        "check masses, `center_m` and the springs: softer springs and more damping shake less",
    )


def straight(model: VehicleModel) -> Trial:
    """Drive a vehicle straight ahead, at half its top speed."""
    speed = _cruising_mps(model)
    way = min(STRAIGHT_M, speed * STRAIGHT_SECONDS)
    with put(model, at=Placement(x_m=-STRAIGHT_M)) as simulation:
        drive(simulation, 0.5)
        driven = drive(simulation, way / speed + _acceleration_s(model, speed), (speed, 0.0))
    made = float(np.hypot(*(driven.pose[-1] - driven.pose[0])[:2]))
    if isinstance(model.drive, Omnidirectional):
        way_rolled, _, _ = rolled(model, driven)
    else:
        way_rolled = sum(travels(model, driven)) / 2
    return Trial(
        "straight",
        f"drive {way:.3g} m straight ahead at {speed:.3g} m/s",
        (
            _at_least("driven", made, "m", way),
            _near("speed", driven.speed, "m/s", speed, WITHIN),
            _near("rolled by the wheels", way_rolled, "m", made, WITHIN),
            _at_most("aside", abs(float(driven.pose[-1, 1])), "m", WITHIN * made),
        ),
        (_over_time("speed, m/s", _commanded(driven, speed), ("true", _ahead_mps(driven))),),
        "check `max_wheel_torque_nm`, wheel radii and friction, and that left and right are alike",
    )


def turn(model: VehicleModel) -> Trial:
    """Turn a vehicle on the spot, or on a circle of 1.2 times its least radius."""
    on_the_spot = model.least_radius_m == 0.0
    radius = 1.2 * model.least_radius_m
    speed = 0.0 if on_the_spot else min(2.0, _cruising_mps(model))
    rate = TURN_RADPS if on_the_spot else speed / radius
    with put(model) as simulation:
        begun = drive(simulation, TURN_SECONDS, (speed, rate))
        turned = drive(simulation, TURN_SECONDS, (speed, rate))
    true = float(turned.velocity[:, 5].mean())
    figures = [_near("yaw rate", true, "rad/s", rate, WITHIN)]
    multiplier = 1.0
    if isinstance(model.drive, Omnidirectional):
        counted = rolled(model, turned)[2]
        figures.append(_near("turned by the wheels", counted, "rad", true * TURN_SECONDS, WITHIN))
    else:
        sides = [model.wheels[shaft.wheels[0]].center_m[1] for shaft in model.counted]
        left, right = travels(model, turned)
        apart = max(sides) - min(sides)
        multiplier = (right - left) / (true * TURN_SECONDS) / apart if true else 0.0
        given = model.drive.track_multiplier if isinstance(model.drive, SideSteered) else 1.0
        figures.append(_near("effective over geometric track", multiplier, "", given, WITHIN))
    if on_the_spot:
        wandered = np.linalg.norm(turned.pose[:, :2] - turned.pose[0, :2], axis=1)
        figures.append(_at_most("wandered", float(wandered.max()), "m", WANDER_M))
    else:
        ground = float(np.hypot(turned.velocity[:, 0], turned.velocity[:, 1]).mean())
        figures.append(_near("radius", abs(ground / true) if true else 0.0, "m", radius, 0.1))
    whole = np.vstack((begun.pose, turned.pose))
    rates = np.concatenate((begun.velocity[:, 5], turned.velocity[:, 5]))
    path = _curve("true", whole[:, 0], whole[:, 1])
    asked = ("commanded", np.full(len(rates), rate))
    where = "on the spot" if on_the_spot else f"on a circle of {radius:.3g} m"
    return Trial(
        "turn",
        f"turn {where} at {rate:.3g} rad/s",
        tuple(figures),
        (
            _over_time("yaw rate, rad/s", asked, ("true", rates)),
            TrialPlot("x, m", "y, m", (path,), equal=True),
        ),
        _fix_of_turn(model, multiplier, true / rate),
    )


def _fix_of_turn(model: VehicleModel, multiplier: float, share: float) -> str:
    """Return what to try if a vehicle turns at another rate, which is this share of the command."""
    if isinstance(model.drive, Omnidirectional):
        return "check `max_wheel_torque_nm`, and `angle_deg` and friction of the `rollers`"
    if not isinstance(model.drive, SideSteered):
        return "check `max_steering_deg`, `steering_torque_nm` and the friction of the tires"
    if share < HARDLY:
        return "check `max_wheel_torque_nm`, or lower `axle_friction_ratio`: it hardly turns"
    return f"set `track_multiplier: {multiplier:.3g}`, the measured one"


def sideways(model: VehicleModel) -> Trial:
    """Drive a base with rollers to the left, and then between left and back."""
    speed = _cruising_mps(model) / 2
    with put(model) as simulation:
        left = drive(simulation, SIDEWAYS_SECONDS, (0.0, 0.0, speed))
        part = speed / sqrt(2)
        drive(simulation, 2 * _acceleration_s(model, speed), (-part, 0.0, part))
        begun = simulation.vehicle_states()[NAME].poses()[0, :2].copy()
        between = drive(simulation, SIDEWAYS_SECONDS, (-part, 0.0, part))
    moved = left.last[:2]
    x, y = between.last[:2] - begun
    heading = degrees(2 * float(np.abs(between.pose[:, 5]).max()))
    _, rolled_left, _ = rolled(model, left)
    made = float(left.pose[-1, 1] - left.pose[0, 1])
    way = np.vstack((left.pose, between.pose))
    return Trial(
        "sideways",
        f"drive to the left at {speed:.3g} m/s, then between left and back",
        (
            _near("speed to the left", float(left.velocity[-1, 1]), "m/s", speed, WITHIN),
            _near("rolled by the wheels", rolled_left, "m", made, WITHIN),
            _at_most("forward", abs(float(moved[0])), "m", WITHIN * made),
            _near("direction", degrees(atan2(y, x)), "deg", 135.0, 0.0, 1.0),
            _near("speed", between.speed, "m/s", speed, WITHIN),
            _at_most("turned", heading, "deg", 1.0),
        ),
        (TrialPlot("x, m", "y, m", (_curve("true", way[:, 0], way[:, 1]),), equal=True),),
        "check `max_wheel_torque_nm`, and `angle_deg` and friction of the `rollers`",
    )


def stop(model: VehicleModel) -> Trial:
    """Stop a vehicle from its full speed."""
    limit = model.drive.max_acceleration_mps2
    top = min(model.top_speed_mps, sqrt(RUN_UP_M * limit / 2))
    with put(model, at=Placement(x_m=-RUN_UP_M / 2)) as simulation:
        fast = drive(simulation, 1.3 * _acceleration_s(model, top) + 1.0, (top, 0.0))
        slow = drive(simulation, 2.0 * _acceleration_s(model, top) + 2.0, (0.0, 0.0))
    begin = fast.speed
    latency = model.drive.motor.latency_s if model.drive.motor else 0.0
    way = float(np.hypot(*(slow.pose[-1] - slow.pose[0])[:2]))
    shortest = begin**2 / (2 * limit) + begin * (latency + TICK_SECONDS)
    moving = np.flatnonzero(np.hypot(slow.velocity[:, 0], slow.velocity[:, 1]) > 0.01)
    seconds = (int(moving[-1]) + 1) * TICK_SECONDS if len(moving) else 0.0
    nose = float(np.abs(_pitch_deg(slow.pose)).max())
    speeds = np.concatenate((_ahead_mps(fast), _ahead_mps(slow)))
    asked = np.concatenate((np.full(len(fast.pose), top), np.zeros(len(slow.pose))))
    return Trial(
        "stop",
        f"stop from {top:.3g} m/s",
        (
            _at_least("speed reached", float(_ahead_mps(fast).max()), "m/s", 0.95 * top),
            _at_most("stopping distance", way, "m", STOP_FACTOR * shortest),
            TrialFigure("stopping time", seconds, "s", "", True),
            _at_most("pitch", nose, "deg", NOSE_DEG),
            _at_most("speed at the end", slow.speed, "m/s", 0.01),
        ),
        (_over_time("speed, m/s", ("commanded", asked), ("true", speeds)),),
        "check `max_wheel_torque_nm`, motor and friction, or lower `max_acceleration_mps2`",
    )


def climb(model: VehicleModel, climb_deg: float = CLIMB_DEG) -> Trial:
    """Drive a vehicle up a slope and let it stand there."""
    speed = min(_cruising_mps(model), CLIMB_MPS)
    ramp = slope(SLOPE_AT_M, degrees=climb_deg)
    with put(model, *ramp, at=Placement(x_m=CLIMB_FROM_M)) as simulation:
        climbed = drive(simulation, CLIMB_M / speed, (speed, 0.0))
        drive(simulation, 4.0)
        held = drive(simulation, HOLD_SECONDS)
    profile = _profile(climb_deg)
    length = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(profile, axis=0).T))))
    ideal = float(np.interp(CLIMB_M, length, profile[:, 1]))
    rise = float(climbed.pose[-1, 2]) - model.base_height_m
    slid = float(np.linalg.norm(held.pose[-1, :3] - held.pose[0, :3]))
    return Trial(
        "climb",
        f"climb a slope of {climb_deg:g} deg at {speed:.3g} m/s and stand on it for "
        f"{HOLD_SECONDS:g} s",
        (
            _at_least("height reached", rise, "m", CLIMBED_SHARE * ideal),
            _at_most("slid", 1e3 * slid, "mm", 1e3 * HELD_M),
            _near("pitch", -float(_pitch_deg(held.pose)[-1]), "deg", climb_deg, 0, PITCH_DEG),
        ),
        (
            TrialPlot(
                "x, m",
                "z, m",
                (
                    _curve("ground", profile[:, 0], profile[:, 1], 1),
                    _curve("true", climbed.pose[:, 0], climbed.pose[:, 2] - model.base_height_m),
                ),
                equal=True,
            ),
            _over_time("speed, m/s", _commanded(climbed, speed), ("true", _ahead_mps(climbed))),
        ),
        "check `max_wheel_torque_nm`, the motor's `stall_torque_nm`, friction and the center of "
        "mass; `--slope` sets a gentler slope",
    )


def lean(model: VehicleModel, least_deg: float = CLIMB_DEG) -> Trial:
    """Tilt the ground sideways under a standing vehicle until it slides or tips."""
    backend = BulletBackend()
    rows, tilt, what = [(0.0, 0.0, 0.0)], 0.0, "stands up to"
    with put(model, new_backend=lambda: backend) as simulation:
        while tilt < LEAN_MAX_DEG and what == "stands up to":
            tilt += LEAN_DEGPS * TICK_SECONDS
            across, down = sin(radians(tilt)), cos(radians(tilt))
            backend.set_gravity((0.0, -GRAVITY_MPS2 * across, -GRAVITY_MPS2 * down))
            simulation.step()
            if simulation.tick % CURVE_TICKS:
                continue
            x, y, _, qx, qy, qz, qw = simulation.vehicle_states()[NAME].poses()[0].tolist()
            rolled = degrees(atan2(2 * (qw * qx + qy * qz), 1 - 2 * (qx * qx + qy * qy)))
            rows.append((tilt, rolled, y))
            if abs(rolled) > TIPPED_DEG:
                what = "tips at"
            elif hypot(x, y) > SLID_M:
                what = "slides at"
    slopes, leans, aside = np.array(rows).T
    rates = np.abs(np.diff((leans, aside))) * TICK_RATE_HZ / CURVE_TICKS
    quiet = np.flatnonzero((rates[0] < TIPPING_DEGPS) & (rates[1] < SLIDING_MPS))
    limit = tilt if what == "stands up to" else float(slopes[max(quiet, default=-1) + 1])
    over_slope = _curve("true", slopes, leans, 1)
    return Trial(
        "lean",
        "stand across a slope that gets steeper until the vehicle slides or tips",
        (_at_least(what, limit, "deg", least_deg),),
        (TrialPlot("slope, deg", "lean on its springs, deg", (over_slope,)),),
        "lower the center of mass, widen the track, stiffen the springs, or raise the friction",
    )


def _cruising_mps(model: VehicleModel) -> float:
    return min(model.top_speed_mps / 2, 2.5)


def _acceleration_s(model: VehicleModel, speed: float) -> float:
    return speed / model.drive.max_acceleration_mps2


def _ahead_mps(driven: Drive) -> NDArray[np.float64]:
    """Return the speed along the base's x axis at each tick."""
    x, y, z, w = driven.pose[:, 3:].T
    axis = np.stack((1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)), axis=1)
    ahead: NDArray[np.float64] = np.sum(axis * driven.velocity[:, :3], axis=1)
    return ahead


def _pitch_deg(pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the pitch of poses; nose down is positive."""
    x, y, z, w = pose[:, 3:].T
    pitch: NDArray[np.float64] = np.degrees(np.arcsin(np.clip(2 * (w * y - x * z), -1.0, 1.0)))
    return pitch


def _profile(climb_deg: float) -> NDArray[np.float64]:
    """Return x and z of the ground under the climb: level, in steps to the slope, the slope."""
    points = [(CLIMB_FROM_M, 0.0), (SLOPE_AT_M, 0.0)]
    for pitch, piece_m in ramp(climb_deg, CLIMB_M):
        x, z = points[-1]
        points.append((x + piece_m * cos(pitch), z + piece_m * sin(pitch)))
    return np.array(points)


def _at_most(name: str, value: float, unit: str, most: float) -> TrialFigure:
    return TrialFigure(name, value, unit, f"at most {most:.3g}", value <= most)


def _at_least(name: str, value: float, unit: str, least: float) -> TrialFigure:
    return TrialFigure(name, value, unit, f"at least {least:.3g}", value >= least)


def _near(
    name: str, value: float, unit: str, target: float, share: float, apart: float = 0.0
) -> TrialFigure:
    """Return a figure that may differ from a target by a share of it, or by so much."""
    most = max(share * abs(target), apart)
    return TrialFigure(name, value, unit, f"{target:.3g} ± {most:.2g}", abs(value - target) <= most)


def _commanded(driven: Drive, speed: float) -> tuple[str, NDArray[np.float64]]:
    return "commanded", np.full(len(driven.pose), speed)


def _over_time(y_label: str, *series: tuple[str, NDArray[np.float64]]) -> TrialPlot:
    """Return series with a value a tick over time."""
    curves = (
        _curve(name, np.arange(1, len(values) + 1) / TICK_RATE_HZ, values)
        for name, values in series
    )
    return TrialPlot("time, s", y_label, tuple(curves))


def _curve(
    name: str, x: NDArray[np.float64], y: NDArray[np.float64], every: int = CURVE_TICKS
) -> TrialCurve:
    return TrialCurve(name, tuple(x[::every].tolist()), tuple(y[::every].tolist()))
