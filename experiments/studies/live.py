# SPDX-License-Identifier: Apache-2.0
"""Live SLAM: a SLAM node beside the bridge in real time; its results return to the bus.

The shipped `indoor_paper` in real time. The poses that returned on the bus are evaluated.
"""

import math
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml
from PIL import Image

import groundlink
from experiments.estimation.environments import python_of
from experiments.estimation.evaluation import Evaluation
from experiments.estimation.programs import DRIVERS, YAG_SLAM_LIVE
from experiments.experiment import ExperimentOptions, evaluate_estimate
from experiments.output import figures
from experiments.recording.recordings import (
    RecordedRun,
    gateway_addresses,
    last_json,
    process,
    ros_environment,
)
from experiments.recording.setups import IN_REAL_TIME, Setup, loaded
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus, BusError
from groundlink.bus.topics import FROM_ROS
from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.data.trajectory import Trajectory, read_tum, write_tum
from groundlink.messages.navigation import OccupancyGrid, PoseStamped
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario import Scenario

SECONDS, SHORT_S = 117.0, 22.0
"""Two laps, after 2 s of standstill."""

SCAN_FRAME = "scan_link"
DEPTH = 10_000
JOIN_S, LOOK_S = 60.0, 0.2
MOMENT_S = 1e-6
"""What a stamp and the same in a file may differ by."""
OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Of map_server's picture, whose first row is the northern one."""


def slam(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run 2D graph SLAM as a ROS node, in real time; its poses and map come back to the bus.

    Returns
    -------
    For each seed, the error of the poses that came back.
    """
    python = python_of(YAG_SLAM_LIVE, options.out, options.console)
    results = []
    for seed in options.seeds:
        seconds = SHORT_S if options.short else SECONDS
        setup = Setup(
            name="live", scenario="indoor_paper", seconds=seconds, seed=seed, time=IN_REAL_TIME
        ).varied(options.vary)
        folder = options.folder("runs", f"live-{seed}")
        recording, map_yaml = _run(options, setup, folder, str(python))
        tum = folder / "poses.tum"
        result, way = evaluate_estimate(
            *(options, recording, tum),
            frame="",
            experiment="live",
            program=YAG_SLAM_LIVE.name,
            case="poses as they came back",
            took_s=seconds,
            limit_m=0.05,
        )
        results.append(result)
        if seed == options.seeds[0]:
            scenario = recording.scenario
            figures.trajectories(options.figure("live"), scenario, [way])
            figures.map_beside_plan(options.figure("live_map"), scenario, map_yaml, way)
    return results


def _run(
    options: ExperimentOptions, setup: Setup, folder: Path, python: str
) -> tuple[RecordedRun, Path]:
    """Run the scenario and the node; leave truth, poses and map in the folder.

    Raises
    ------
    UserError
        when the node does not keep up, or what it told does not come back.
    """
    scenario = setup.write(folder, gateway_addresses())
    run, endpoint = f"live_{os.getpid()}", free_endpoint()
    environment = ros_environment()
    mount = [str(number) for number in _mount(loaded(folder))]
    node = (str(DRIVERS / YAG_SLAM_LIVE.driver), str(folder / "graph.tum"), "--mount", *mount)
    bus_file = folder / "bus.mcap"
    bus_file.unlink(missing_ok=True)
    up = ["-m", "groundlink", "up", str(scenario), "--run", run, "--listen", endpoint]
    up += ["--record", str(bus_file), "--duration", str(setup.seconds)]
    poses: BusInbox[PoseStamped] = BusInbox(depth=DEPTH)
    maps: BusInbox[OccupancyGrid] = BusInbox(depth=DEPTH)
    label = f"live, seed {setup.seed}"
    with process(node, folder / "node.log", environment, python) as slam_node:
        with process(up, folder / "up.log", environment) as supervisor:
            with _joined(endpoint, supervisor, folder) as bus:
                options.console.print(f"{label}: `groundlink view --connect {endpoint}` shows it")
                vehicle = loaded(folder).vehicles[0].name
                bus.subscribe(FROM_ROS["pose"].key_in(run, vehicle=vehicle), PoseStamped, poses)
                bus.subscribe(FROM_ROS["map"].key_in(run, vehicle=vehicle), OccupancyGrid, maps)
                while supervisor.poll() is None:
                    told = last_json(folder / "node.log")
                    options.console.progress(f"{label}: {told}")
                    if slam_node.poll() is not None:
                        raise UserError(f"{label}: the node ended early; see {folder / 'node.log'}")
                    time.sleep(LOOK_S)
        if supervisor.returncode:
            raise UserError(f"{label}: the run failed; see {folder / 'up.log'}")
    told = last_json(folder / "node.log")
    options.console.print(
        f"{label}: {told}; {len(poses)} poses and {len(maps)} maps arrived on the bus"
    )
    if told["late"] or not len(poses) or not len(maps):
        raise UserError(
            f"{label}: the node did not keep up, or published no pose or map; see {folder}"
        )
    map_yaml = _write(folder, poses, maps)
    came = read_tum(folder / "poses.tum").seconds
    sent = read_tum(folder / "graph.tum").between(came[0] - MOMENT_S, came[-1] + MOMENT_S)
    if len(sent.seconds) != len(came):
        raise UserError(f"{label}: {len(came)} of {len(sent.seconds)} poses arrived on the bus")
    with groundlink.open(bus_file) as dataset:
        write_tum(folder / "truth.tum", dataset.truth())
    return RecordedRun(folder), map_yaml


def _mount(scenario: Scenario) -> tuple[float, float, float]:
    """Return base_from_scan as x, y, yaw, as one tells it to a SLAM program."""
    (scanner,) = (s for s in scenario.vehicles[0].sensors if s.frame == SCAN_FRAME)
    x_m, y_m, _ = scanner.mount.xyz_m
    return x_m, y_m, math.radians(scanner.mount.rpy_deg[2])


def _joined(endpoint: str, supervisor: subprocess.Popen[str], folder: Path) -> Bus:
    """Return the bus of a run that is being started, as soon as there is one."""
    end_s = time.monotonic() + JOIN_S
    while supervisor.poll() is None and time.monotonic() < end_s:
        try:
            return Bus(connect=endpoint, observer=True)
        except BusError:
            time.sleep(LOOK_S)
    raise UserError(f"live: no bus at {endpoint}; see {folder / 'up.log'}")


def _write(folder: Path, poses: BusInbox[PoseStamped], maps: BusInbox[OccupancyGrid]) -> Path:
    """Write the poses that came as TUM, and the last map as map_server has it; return its YAML."""
    rows = [pose for _, pose in iter(lambda: poses.get(seconds=0), None)]
    *_, (_, grid) = iter(lambda: maps.get(seconds=0), None)
    seconds = np.array([row.stamp_nanos / NANOS for row in rows])
    at, turns = (
        np.array([getattr(r, name) for r in rows]) for name in ("position_m", "orientation")
    )
    write_tum(folder / "poses.tum", Trajectory(seconds, at, turns))
    cells = np.frombuffer(grid.cells, np.int8).reshape(grid.height, grid.width)
    picture = np.select([cells < 0, cells > 50], [UNKNOWN, OCCUPIED], FREE).astype(np.uint8)
    Image.fromarray(picture[::-1]).save(folder / "map.png")
    told = {
        "image": "map.png",
        "resolution": grid.resolution_m,
        "origin": [*grid.origin_position_m[:2], 0.0],
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    }
    file = folder / "map.yaml"
    file.write_text(yaml.safe_dump(told, sort_keys=False), encoding="utf-8")
    return file
