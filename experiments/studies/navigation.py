# SPDX-License-Identifier: Apache-2.0
"""Navigation: the stack of `examples/navigation` drives to goals, around barrels in its way.

The run waits for the stack, so that a slow machine changes nothing. The first pose of the stack is
0.25 m and 6 degrees off. On each leg a barrel appears after the robot was told to go; no barrel is
on the map.
"""

import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

import groundlink
from experiments.estimation.evaluation import Evaluation, write_rows
from experiments.experiment import ExperimentOptions
from experiments.output import figures
from experiments.recording.recordings import gateway_addresses, process, ros_environment
from experiments.recording.setups import ROOT, loaded
from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.data.dataset import Dataset
from groundlink.data.trajectory import Trajectory
from groundlink.monitor.process_commands import free_endpoint
from groundlink.ros.diagnostics import CONTACT_PREFIX

EXAMPLE = ROOT / "examples" / "navigation"
SCENARIO = EXAMPLE / "lab_navigation.yaml"
HEIGHTS_M = ("0.05", "0.9")
"""Heights of the map's obstacles: from the floor to the top of the mast."""

FIRST_POSE = "[-4.4, 0.15, 0.1]"
LEG_S = 120.0
"""Longest wait for the end of a leg."""

JOIN_S = 60.0
LIMIT_M = 0.2
"""Largest distance from a goal."""

STANDS_MPS = 0.02


@dataclass(frozen=True)
class GoalLeg:
    """A goal, and a barrel on the way to it."""

    goal_m: tuple[float, float]
    barrel_m: tuple[float, float]


TOUR = (
    GoalLeg((4.4, -0.6), (0.0, -0.4)),
    GoalLeg((-3.2, 1.5), (1.2, 0.4)),
    GoalLeg((2.6, -0.8), (-0.8, 0.6)),
    GoalLeg((-4.4, 0.0), (-1.4, -0.6)),
)

HEAD = ("seed", "leg", "to the goal", "path", "largest error of the pose", "touched")


def tour(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Drive to four goals on a map, around a barrel that appears on each way.

    Raises
    ------
    UserError
        when a goal is missed by more than `LIMIT_M`, or something was touched.
    """
    rows: list[tuple[str, ...]] = []
    failures = []
    for seed in options.seeds:
        folder = options.folder("runs", f"navigation-{seed}")
        legs = TOUR[:1] if options.short else TOUR
        _run(options, folder, seed, legs)
        with groundlink.open(folder / "run.mcap") as dataset:
            errors_s, errors_m = pose_errors(dataset)
            truth = dataset.truth()
            touches = touched(dataset)
        begin_s, paths = float(truth.seconds[0]), []
        for number, leg in enumerate(legs, 1):
            end_s, missed_m = arrival(truth, begin_s, leg.goal_m)
            driven = truth.between(begin_s, end_s)
            paths.append(driven)
            during = (errors_s >= begin_s) & (errors_s <= end_s)
            names = {name for second, name in touches if begin_s <= second <= end_s}
            rows.append(
                (
                    *(str(seed), str(number), f"{100 * missed_m:.1f} cm"),
                    *(f"{driven.length_m:.1f} m", f"{100 * errors_m[during].max():.1f} cm"),
                    ", ".join(sorted(names)) or "nothing",
                )
            )
            options.console.print("navigation: " + ", ".join(rows[-1]))
            if names:
                failures.append(f"seed {seed}, leg {number}")
            begin_s = end_s
        if seed == options.seeds[0]:
            figures.navigation(
                *(options.figure("navigation"), loaded(folder), paths),
                goals_m=[leg.goal_m for leg in legs],
                barrels_m=[leg.barrel_m for leg in legs],
            )
    write_rows(options.folder("tables") / "navigation_legs.csv", HEAD, rows)
    if failures:
        raise UserError(f"navigation: something was touched: {'; '.join(failures)}")
    return []


def _run(options: ExperimentOptions, folder: Path, seed: int, legs: Sequence[GoalLeg]) -> None:
    """Record a run with its legs into a folder."""
    document = yaml.safe_load(SCENARIO.read_text(encoding="utf-8"))
    document |= {"seed": seed, "gateway": gateway_addresses()}
    scenario = folder / "scenario.yaml"
    scenario.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    known, record = folder / "map.yaml", folder / "run.mcap"
    record.unlink(missing_ok=True)
    _groundlink("world", "map", scenario, "--heights-m", *HEIGHTS_M, "--out", known)
    endpoint, run = free_endpoint(), f"navigation_{os.getpid()}"
    environment = ros_environment()
    node = [str(EXAMPLE / "navigation_node.py"), "--ros-args"]
    node += ["-p", f"map:={known}", "-p", f"initial_pose:={FIRST_POSE}"]
    up = ["-m", "groundlink", "up", str(scenario), "--run", run, "--listen", endpoint]
    with (
        process(node, folder / "node.log", environment),
        process([*up, "--record", str(record)], folder / "up.log", environment),
    ):
        for number, leg in enumerate(legs, 1):
            label = f"navigation, seed {seed}, leg {number}"
            send = [str(EXAMPLE / "send_goal.py"), *map(str, leg.goal_m)]
            with process(send, folder / "goal.log", environment) as goal:
                barrel = f"barrel{number}"
                place = ",".join(map(str, leg.barrel_m))
                where = ("--connect", endpoint, "--run", run)
                _retried("spawn", "barrel", "--name", barrel, f"--at={place}", *where)
                began_s = time.monotonic()
                while goal.poll() is None:
                    if time.monotonic() - began_s > LEG_S:
                        raise UserError(f"{label}: not there after {LEG_S:g} s; see {folder}")
                    options.console.progress(label)
                    time.sleep(0.2)
            _groundlink("remove", barrel, *where)


def _groundlink(*words: object) -> None:
    command = [sys.executable, "-m", "groundlink", *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(done.stderr.strip())


def _retried(*words: object) -> None:
    """Run a command as soon as there is a run."""
    end_s = time.monotonic() + JOIN_S
    while True:
        try:
            return _groundlink(*words)
        except UserError:
            if time.monotonic() > end_s:
                raise
            time.sleep(0.2)


def arrival(truth: Trajectory, begin_s: float, goal_m: tuple[float, float]) -> tuple[float, float]:
    """Return when (s) the vehicle first stood near a goal, and how far (m) from it.

    Raises
    ------
    UserError
        when it never did.
    """
    distances_m = np.hypot(*(truth.positions_m[:, :2] - goal_m).T)
    steps_m = np.hypot(*np.diff(truth.positions_m[:, :2], axis=0, prepend=np.inf).T)
    stands = steps_m < STANDS_MPS * np.diff(truth.seconds, prepend=-np.inf)
    there = stands & (truth.seconds > begin_s) & (distances_m < LIMIT_M)
    if not there.any():
        raise UserError(f"navigation: never stood within {LIMIT_M} m of {goal_m}")
    first = int(np.argmax(there))
    return float(truth.seconds[first]), float(distances_m[first])


def pose_errors(dataset: Dataset) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the stamps (s) and the errors (m) of the stack's poses."""
    poses = dataset.poses("/pose")
    truth = dataset.truth()
    poses = poses.between(truth.seconds[0], truth.seconds[-1])
    true_m = truth.at(poses.seconds).positions_m
    return poses.seconds, np.hypot(*(poses.positions_m - true_m)[:, :2].T)


def touched(dataset: Dataset) -> list[tuple[float, str]]:
    """Return what the vehicle touched, with the time (s)."""
    return [
        (nanos / NANOS, value.key.removeprefix(CONTACT_PREFIX))
        for nanos, message in dataset.messages("/vitals")
        for status in message.status
        for value in status.values
        if value.key.startswith(CONTACT_PREFIX)
    ]
