# SPDX-License-Identifier: Apache-2.0
"""`groundlink snapshot SCENARIO VEHICLE/CAMERA --at S --out DIR`: write one image of a camera.

Starts a run with this sensor and the drivers, as fast as possible, until the image is taken.
"""

import argparse
import os
from pathlib import Path

from groundlink.bus.core_topics import HEALTH, PHYSICS
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import driver_names, process_names
from groundlink.cli import Subparsers
from groundlink.cli.run import running, supervised
from groundlink.cli.terminal.progress import progress
from groundlink.core.clock import TICK_SECONDS
from groundlink.core.errors import UserError, did_you_mean
from groundlink.messages.base import Health
from groundlink.monitor import process_commands
from groundlink.monitor.supervisor import Supervisor
from groundlink.process.runner import stop_on_signals
from groundlink.scenario.cameras import Optics

from .world import is_picture

POLL_SECONDS = 0.02


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("snapshot", help="write the image of a camera at a sim time")
    parser.add_argument("scenario", help=running.SCENARIO_HELP)
    parser.add_argument("camera", help="VEHICLE/SENSOR such as rover/camera")
    parser.add_argument(
        "--at", type=float, default=1.0, metavar="S", help="sim time in seconds (%(default)g)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path(), metavar="DIR", help="folder for the files (default: .)"
    )
    parser.set_defaults(command=snapshot)


def snapshot(options: argparse.Namespace) -> int:
    """Write color, depth and labels of one sim time."""
    scenario = running.load_scenario(options.scenario)
    found = scenario.sensor(options.camera)
    if found is None or not isinstance(found[1], Optics):
        cameras = [
            f"{vehicle.name}/{sensor.name}"
            for vehicle in scenario.vehicles
            for sensor in vehicle.sensors
            if isinstance(sensor, Optics)
        ]
        hint = did_you_mean(options.camera, cameras) if cameras else "it has no cameras"
        raise UserError(f"scenario `{scenario.name}` has no camera `{options.camera}`; {hint}")
    if is_picture(options.out):
        raise UserError(
            f"--out {options.out}: expected a folder; color, depth and labels are written as PNG "
            "files"
        )
    if not options.at >= 0:
        raise UserError(f"--at {options.at:g}: expected seconds of sim time, 0 or more")
    run, endpoint = f"snapshot_{os.getpid()}", process_commands.free_endpoint()
    joining = process_commands.joining(run, endpoint)
    modules = process_names(scenario)
    commands = {
        "physics": [
            *("-m", modules["physics"], options.scenario),
            *("--mode", "fast", "--lockstep", "sensors", "--only", options.camera, *joining),
        ],
        options.camera: [
            *("-m", "services.sensors.rendering", "--name", options.camera),
            *("--at", repr(options.at), "--out", str(options.out), *joining),
        ],
    }
    for name in driver_names(scenario):
        commands[name] = ["-m", modules[name], "--name", name, *joining]
    stop = stop_on_signals()
    supervisor = Supervisor(commands, lambda _, line: print(line), finite={options.camera})
    camera, failed = supervisor.children[options.camera], None
    with Bus(listen=endpoint) as bus, progress(f"running to {options.at:g} s") as done:
        clock: BusInbox[Health] = BusInbox(depth=16)
        bus.subscribe(HEALTH.key_in(run, process=PHYSICS), Health, clock)
        supervisor.start()
        try:
            while not (stop.is_set() or camera.is_done or failed):
                failed = supervisor.poll()
                if arrived := clock.get(seconds=POLL_SECONDS):
                    done(arrived[1].tick * TICK_SECONDS / max(options.at, TICK_SECONDS))
        finally:
            supervisor.stop()
    if failed:
        return supervised.exit_code(supervisor.children[failed])
    return 0 if camera.is_done else 1
