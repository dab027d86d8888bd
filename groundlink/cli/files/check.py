# SPDX-License-Identifier: Apache-2.0
"""`groundlink check SCENARIO`: load a scenario and print what a run of it would start.

A setting that would work badly is a warning with a fix; one that cannot work is an error.
"""

import argparse
import math
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from groundlink.bus.topics import driver_name
from groundlink.cli import Subparsers
from groundlink.cli.run.running import SCENARIO_HELP
from groundlink.cli.terminal.json_output import add_json_option, print_json
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.episode import routes
from groundlink.loader import load
from groundlink.ros.base import Base
from groundlink.ros.message_sizes import Cut, NeverFits, cut, fitting_block_deg
from groundlink.ros.streams import TRUE_MAP_TOPIC, answers_mistake
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.route import Route
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.build import solids, world_hash
from groundlink.world.terrain import Terrain


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("check", help="check a scenario without starting anything")
    parser.add_argument("scenario", help=SCENARIO_HELP)
    parser.add_argument(
        "--urdf",
        type=Path,
        metavar="FOLDER",
        help="write each vehicle's robot description, as on /robot_description, to VEHICLE.urdf",
    )
    add_json_option(parser)
    parser.set_defaults(command=check)


def check(options: argparse.Namespace) -> int:
    """Print the content of the scenario.

    Raises
    ------
    UserError
        if a sensor's messages exceed every datagram size, or `answers` names an unknown topic.
    """
    with progress(f"checking {options.scenario}"):
        scenario = load(options.scenario, warn=_warn)
        if mistake := answers_mistake(scenario):
            raise UserError(f"{options.scenario}: {mistake}")
        content = _content(scenario)
        if options.urdf is not None:
            _write_urdf(scenario, options.urdf)
    if options.json:
        print_json(content)
        return 0
    print(f"{options.scenario}: `{scenario.name}` is valid")
    for line in _lines(content):
        print(f"  {line}")
    return 0


def _write_urdf(scenario: Scenario, folder: Path) -> None:
    """Write the robot description of each vehicle to a file of its name."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {vehicle.name: folder / f"{vehicle.name}.urdf" for vehicle in scenario.vehicles}
    for file in files.values():
        check_new_file("--urdf", file)
    for vehicle in scenario.vehicles:
        with write_atomically(files[vehicle.name]) as part:
            part.write_text(Base(scenario, vehicle, scenario.name).description, encoding="utf-8")


def _content(scenario: Scenario) -> dict[str, Any]:
    """Return what a run of the scenario would start and send."""
    world = scenario.world
    bodies = scenario.bodies
    return {
        "scenario": scenario.name,
        "world": {
            "name": world.name,
            "solids": len(solids(scenario)),
            "hash": world_hash(scenario),
            "terrain": world.terrain and _terrain(world.terrain),
        },
        "mode": scenario.time.mode,
        "seed": scenario.seed,
        "vehicles": [_vehicle(scenario, vehicle) for vehicle in scenario.vehicles],
        "bodies": {"topic": bodies.topic, "rate_hz": bodies.rate_hz, "push": bodies.push},
        "true_map": scenario.true_map
        and {"topic": TRUE_MAP_TOPIC, "rate_hz": scenario.true_map.rate_hz, "push": True},
        "gateway": {"bind": scenario.gateway.bind, "peer": scenario.gateway.peer},
        "expectations": [expectation.title for expectation in scenario.expect],
    }


def _terrain(terrain: Terrain) -> dict[str, Any]:
    return {"low_m": terrain.low_m, "high_m": terrain.high_m, "cell_m": terrain.cell_m}


def _vehicle(scenario: Scenario, vehicle: Vehicle) -> dict[str, Any]:
    truth = vehicle.ground_truth
    return {
        "name": vehicle.name,
        "model": vehicle.model.name,
        "command_topic": vehicle.command_topic,
        "route": vehicle.route and _route(vehicle, vehicle.route),
        "sensors": [_sensor(scenario, vehicle, sensor) for sensor in vehicle.sensors],
        "streams": [
            {"name": f"{vehicle.name}/{stream.name}", "kind": stream.kind}
            | {"topics": [stream.topic], "rate_hz": stream.rate_hz}
            for stream in vehicle.streams
        ],
        "truth": [
            {"topic": topic, "rate_hz": truth.rate_hz, "push": truth.push}
            for topic in scenario.true_topics(vehicle)
        ],
    }


def _route(vehicle: Vehicle, route: Route) -> dict[str, Any]:
    place = vehicle.placement
    way = routes.line(
        route, start_m=(place.x_m, place.y_m), heading_rad=math.radians(place.yaw_deg)
    )
    return {
        "driver": driver_name(vehicle),
        "length_m": way.length_m,
        "speed_mps": route.speed_mps,
    }


def _sensor(scenario: Scenario, vehicle: Vehicle, sensor: SensorSpec) -> dict[str, Any]:
    topics = sensor.ros_topics()
    beside = {
        key: _size(scenario, vehicle, sensor, stream) if stream in topics else None
        for key, stream in (("largest_truth", "truth"), ("largest_labels", "labeled_points"))
    }
    return {
        "name": f"{vehicle.name}/{sensor.name}",
        "kind": sensor.kind,
        "topics": list(topics.values()),
        "rate_hz": sensor.message_rate_hz,
        "largest_message": _size(scenario, vehicle, sensor),
        "faults": [str(fault) for fault in sensor.faults],
        **beside,
    }


def _lines(content: dict[str, Any]) -> Iterator[str]:
    """Yield the content of a scenario as lines."""
    world = content["world"]
    yield f"world    {world['name']}, {world['solids']} solids, {world['hash'][:12]}"
    if terrain := world["terrain"]:
        low_m, high_m = terrain["low_m"], terrain["high_m"]
        size = np.subtract(high_m, low_m)
        yield (
            f"terrain  {size[0]:g} x {size[1]:g} m, {low_m[2]:.1f} to {high_m[2]:.1f} m high, "
            f"cells of {terrain['cell_m']:g} m"
        )
    yield f"time     {content['mode']}, seed {content['seed']}"
    for vehicle in content["vehicles"]:
        yield (
            f"vehicle  {vehicle['name']} ({vehicle['model']}), commands on "
            f"{vehicle['command_topic']}"
        )
        if route := vehicle["route"]:
            speed = f"{route['speed_mps']:g} m/s"
            yield f"route    {route['driver']}: {route['length_m']:.1f} m at {speed}"
        for sensor in vehicle["sensors"]:
            yield f"sensor   {_stream_text(sensor)}"
            yield from _indented(_size_lines(sensor["largest_message"]))
            yield from _indented(f"fault {fault}" for fault in sensor["faults"])
            if truth := sensor["largest_truth"]:
                yield from _indented(["ground truth:", *_size_lines(truth)])
            if labels := sensor["largest_labels"]:
                yield from _indented(["labeled points:", *_size_lines(labels)])
        for stream in vehicle["streams"]:
            yield f"stream   {_stream_text(stream)}"
        for truth in vehicle["truth"]:
            yield f"truth    {_truth_text(truth)}"
    yield f"truth    {_truth_text(content['bodies'])}"
    if content["true_map"]:
        yield f"truth    {_truth_text(content['true_map'])}"
    gateway = content["gateway"]
    yield f"gateway  {gateway['bind']}, sends to {gateway['peer']}"
    yield from (f"expect   {title}" for title in content["expectations"])


def _stream_text(stream: dict[str, Any]) -> str:
    topics = ", ".join(stream["topics"])
    return f"{stream['name']} ({stream['kind']}): {topics}, {stream['rate_hz']:g} Hz"


def _truth_text(truth: dict[str, Any]) -> str:
    push = "always sent" if truth["push"] else "sent to subscribers"
    return f"{truth['topic']}, {truth['rate_hz']:g} Hz, {push}"


def _size_lines(size: dict[str, Any]) -> list[str]:
    parts = size["datagrams"]
    in_parts = "1 datagram" if parts == 1 else f"{parts} datagrams"
    return [f"messages of up to {size['bytes']} bytes in {in_parts}", *size["warnings"]]


def _indented(lines: Iterable[str]) -> Iterator[str]:
    for line in lines:
        yield f"         {line}"


def _warn(line: str) -> None:
    print(f"groundlink: warning: {line}", file=sys.stderr)


def _size(
    scenario: Scenario, vehicle: Vehicle, sensor: SensorSpec, stream: str = ""
) -> dict[str, Any]:
    """Return the size of a sensor's largest message in datagrams, with a fix if it is too large."""
    try:
        found = cut(vehicle, sensor, scenario.gateway, stream)
    except NeverFits as error:
        fix = _fix(vehicle, sensor, scenario, "Fix: make its messages smaller")
        raise UserError(f"{vehicle.name}/{sensor.name}: {error}. {fix}") from None
    warnings = [] if found.fits else _warning(scenario, vehicle, sensor, found)
    return {"bytes": found.body_bytes, "datagrams": found.parts, "warnings": warnings}


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
