# SPDX-License-Identifier: Apache-2.0
"""`groundlink check SCENARIO`: load a scenario and print what a run of it would start.

A setting that would work badly is a warning with a fix; one that cannot work is an error.
"""

import argparse
import math
import sys
from collections.abc import Iterator

import numpy as np

from groundlink.bus.topics import driver_name
from groundlink.cli import Subparsers
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.core.errors import UserError
from groundlink.episode import routes
from groundlink.loader import load
from groundlink.ros.message_sizes import Cut, NeverFits, cut, fitting_block_deg
from groundlink.ros.streams import answers_mistake
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.build import solids, world_hash


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("check", help="check a scenario without starting anything")
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.set_defaults(command=check)


def check(options: argparse.Namespace) -> int:
    """Print the content of the scenario.

    Raises
    ------
    UserError
        if a sensor's messages exceed every datagram size, or `answers` names an unknown topic.
    """
    scenario = load(options.scenario, warn=_warn)
    if mistake := answers_mistake(scenario):
        raise UserError(f"{options.scenario}: {mistake}")
    lines = list(_described(scenario))
    print(f"{options.scenario}: `{scenario.name}` is valid")
    for line in lines:
        print(f"  {line}")
    return 0


def _described(scenario: Scenario) -> Iterator[str]:
    """Yield the content of the scenario as lines."""
    world = scenario.world
    yield f"world    {world.name}, {len(solids(scenario))} solids, {world_hash(scenario)[:12]}"
    if terrain := world.terrain:
        size = np.subtract(terrain.high_m, terrain.low_m)
        yield (
            f"terrain  {size[0]:g} x {size[1]:g} m, {terrain.low_m[2]:.1f} to "
            f"{terrain.high_m[2]:.1f} m high, cells of {terrain.cell_m:g} m"
        )
    yield f"time     {scenario.time.mode}, seed {scenario.seed}"
    for vehicle in scenario.vehicles:
        yield f"vehicle  {vehicle.name} ({vehicle.model.name}), commands on {vehicle.command_topic}"
        if vehicle.route is not None:
            place = vehicle.placement
            way = routes.line(
                vehicle.route,
                start_m=(place.x_m, place.y_m),
                heading_rad=math.radians(place.yaw_deg),
            )
            speed = f"{vehicle.route.speed_mps:g} m/s"
            yield f"route    {driver_name(vehicle)}: {way.length_m:.1f} m at {speed}"
        for sensor in vehicle.sensors:
            rate = sensor.message_rate_hz
            topics = ", ".join(sensor.ros_topics().values())
            yield f"sensor   {vehicle.name}/{sensor.name} ({sensor.kind}): {topics}, {rate:g} Hz"
            for line in _sent(scenario, vehicle, sensor):
                yield f"         {line}"
            for fault in sensor.faults:
                yield f"         fault {fault}"
            if sensor.truth_topic is not None:
                yield "         ground truth:"
                for line in _sent(scenario, vehicle, sensor, truth=True):
                    yield f"         {line}"
        for stream in vehicle.streams:
            name = f"{vehicle.name}/{stream.name} ({stream.kind})"
            yield f"stream   {name}: {stream.topic}, {stream.rate_hz:g} Hz"
        truth = vehicle.ground_truth
        for topic in scenario.true_topics(vehicle):
            yield f"truth    {topic}, {truth.rate_hz:g} Hz, {_push_text(truth.push)}"
    bodies = scenario.bodies
    yield f"truth    {bodies.topic}, {bodies.rate_hz:g} Hz, {_push_text(bodies.push)}"
    yield f"gateway  {scenario.gateway.bind}, sends to {scenario.gateway.peer}"


def _warn(line: str) -> None:
    print(f"groundlink: warning: {line}", file=sys.stderr)


def _push_text(push: bool) -> str:
    return "always sent" if push else "sent to subscribers"


def _sent(
    scenario: Scenario, vehicle: Vehicle, sensor: SensorSpec, *, truth: bool = False
) -> list[str]:
    """Return the size of a sensor's largest message in datagrams, with a fix if it is too large."""
    gateway = scenario.gateway
    try:
        found = cut(vehicle, sensor, gateway, truth=truth)
    except NeverFits as error:
        fix = _fix(vehicle, sensor, scenario, "Fix: make its messages smaller")
        raise UserError(f"{vehicle.name}/{sensor.name}: {error}. {fix}") from None
    in_parts = "1 datagram" if found.parts == 1 else f"{found.parts} datagrams"
    lines = [f"messages of up to {found.body_bytes} bytes in {in_parts}"]
    if not found.fits:
        lines += _warning(scenario, vehicle, sensor, found)
    return lines


def _warning(scenario: Scenario, vehicle: Vehicle, sensor: SensorSpec, found: Cut) -> list[str]:
    gateway = scenario.gateway
    most = 127 if gateway.signed_peer else 255
    size = f"`{gateway.datagram}`" if isinstance(gateway.datagram, str) else gateway.datagram
    return [
        f"warning: exceeds {most} datagrams of {size}: datagrams grow to {found.datagram_bytes} "
        "bytes,",
        "which IP fragments: one lost frame loses a whole datagram.",
        _fix(vehicle, sensor, scenario, "Fix: larger datagrams"),
    ]


def _fix(vehicle: Vehicle, sensor: SensorSpec, scenario: Scenario, otherwise: str) -> str:
    block_deg = None
    if isinstance(sensor, RotatingLidar):
        block_deg = fitting_block_deg(vehicle, sensor, scenario.gateway)
    if block_deg is None:
        return otherwise
    return f"Fix: `block_deg: {block_deg:g}` for {vehicle.name}/{sensor.name}"
