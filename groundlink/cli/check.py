# SPDX-License-Identifier: Apache-2.0
"""`groundlink check SCENARIO`: read a scenario as a run would, and say what it would start."""

from __future__ import annotations

import argparse

from groundlink.scenario import load
from groundlink.topics import SENSOR_TOPICS, sensor_rate_hz
from groundlink.world.build import solids, world_hash


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("check", help="check a scenario without starting anything")
    parser.add_argument("scenario", help="scenario file (YAML)")
    parser.set_defaults(command=check)


def check(options: argparse.Namespace) -> int:
    """Print what the scenario holds."""
    scenario = load(options.scenario)
    world = scenario.world
    print(f"{options.scenario}: `{scenario.name}` is valid")
    print(f"  world    {world.name}, {len(solids(scenario))} solids, {world_hash(scenario)[:12]}")
    print(f"  time     {scenario.time.mode}, seed {scenario.seed}")
    for vehicle in scenario.vehicles:
        print(f"  vehicle  {vehicle.name} ({vehicle.model.name}) obeys {vehicle.command_topic}")
        for sensor in vehicle.sensors:
            kind = SENSOR_TOPICS[type(sensor)].name
            rate = sensor_rate_hz(sensor)
            print(f"  sensor   {vehicle.name}/{sensor.name} ({kind}): {sensor.topic}, {rate:g} Hz")
    print(f"  gateway  {scenario.gateway.bind}, sends to {scenario.gateway.peer}")
    return 0
