# SPDX-License-Identifier: Apache-2.0
"""Guard: faults put into data on purpose must be detected.

Each fault is applied to a copy of the bag of one recording. A program detects a fault if its error
grows clearly; a direct test, if a quantity leaves its tolerance. The experiment fails if a fault is
missed, or reported where there is none.
"""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from experiments.estimation.estimators import GICP, KISS, LIDAR_INERTIAL, Estimator, run_estimator
from experiments.estimation.evaluation import Evaluation, write_rows
from experiments.experiment import ExperimentOptions, record_setup
from experiments.recording.faults import CLOUD, FAULTS, IMU, TF, BagFault, with_fault
from experiments.recording.recordings import RecordedRun
from experiments.recording.setups import Setup
from groundlink.core.errors import UserError
from groundlink.messages.base import POINT
from groundlink.ros.streams import TF_STATIC_TOPIC
from groundlink.ros.types import STORE, nanos, xyz, xyzw
from groundlink.scene.build import solids

from .direct import CheckedQuantity, LidarSweep, imu_quantities, scan_quantities
from .track import there_and_back

SECONDS = 40.0
SHORT_SECONDS = 14.0

WORSE = 2.0
"""Times the error without a fault ..."""

WORSE_M = 0.02
"""... and this much more: then a program is said to find the fault."""

SETUP = Setup(
    name="guard",
    scenario="track",
    seconds=SECONDS,
    sensors={
        "lidar": {"datasheet": "sensors/vlp16.yaml"},
        "scanner": None,
        "odometry": None,
        "encoders": None,
    },
    vehicle={
        "placement": {"x_m": -4.0, "y_m": 0.0, "yaw_deg": 0.0},
        "route": there_and_back(4.0, 1.0, laps=2),
    },
)
"""The hall of the track, of which all surfaces are boxes and cylinders, with turns on the spot."""

LISTENERS: dict[str, tuple[Estimator, ...]] = {
    IMU: (LIDAR_INERTIAL,),
    CLOUD: (LIDAR_INERTIAL, KISS, GICP),
}
"""Estimators that use messages of a type."""


def guard(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Check that faults that are put into data on purpose are found.

    Each fault is shown to the programs that take its messages, and to direct tests.
    """
    seconds = SHORT_SECONDS if options.short else SECONDS
    recording = record_setup(options, dataclasses.replace(SETUP, seconds=seconds))
    results: list[Evaluation] = []
    rows: list[tuple[str, CheckedQuantity]] = [("", quantity) for quantity in direct(recording)]
    clean: dict[str, Evaluation] = {}
    for estimator in (LIDAR_INERTIAL, KISS, GICP):
        result, _ = run_estimator(
            options, estimator, recording, experiment="guard", case="no fault"
        )
        clean[result.program] = result
        results.append(result)
    finders: list[tuple[str, str]] = []
    wrong = [q.words for _, q in rows if not q.holds]
    missed = [f"without a fault: {words}" for words in wrong]
    for name, fault in FAULTS.items():
        bag = options.folder("runs", recording.folder.name) / f"{name}.mcap"
        bag.unlink(missing_ok=True)
        with_fault(recording.bag, bag, fault)
        found = _by_programs(options, recording, bag, name, fault, clean, results)
        quantities = direct(recording, bag)
        rows += [(name, quantity) for quantity in quantities]
        found += [f"{q.words}: {q.value:.3g}" for q in quantities if not q.holds]
        options.console.print(f"guard: {fault.words}: found by {'; '.join(found) or 'no check'}")
        finders.append((fault.words, "; ".join(found) or "no check"))
        if not found:
            missed.append(fault.words)
        bag.unlink()
    tables = options.folder("tables")
    write_rows(tables / "guard_found.csv", ("fault", "found by"), finders)
    write_rows(
        tables / "guard_direct.csv",
        ("fault", "quantity", "value", "expected", "tolerance", "holds"),
        [_row(name, quantity) for name, quantity in rows if not (name and quantity.holds)],
    )
    if missed:
        raise UserError("guard: expectations not met: " + "; ".join(missed))
    return results


def _by_programs(
    options: ExperimentOptions,
    recording: RecordedRun,
    bag: Path,
    name: str,
    fault: BagFault,
    clean: dict[str, Evaluation],
    results: list[Evaluation],
) -> list[str]:
    """Return the programs that fail or get clearly worse; add their results."""
    found = []
    for estimator in LISTENERS.get(fault.ros_type, (LIDAR_INERTIAL,)):
        program = estimator.program.name
        try:
            result, _ = run_estimator(
                options, estimator, recording, experiment="guard", case=name, bag=bag
            )
        except UserError as error:
            options.console.print(str(error))
            found.append(f"{program} (it fails)")
            continue
        results.append(result)
        usual_m = clean[program].ate_m
        if is_worse(result.ate_m, usual_m):
            found.append(f"{program} ({100 * usual_m:.1f} -> {100 * result.ate_m:.1f} cm)")
    return found


def is_worse(error_m: float, usual_m: float) -> bool:
    """Return whether an error is clearly larger than it is without a fault."""
    return error_m > WORSE * usual_m and error_m > usual_m + WORSE_M


def published_mounts(bag: Path) -> dict[str, tuple[float, ...]]:
    """Return base_from_frame of each sensor's frame as a bag has it: x, y, z, qx, qy, qz, qw.

    A fault of the bag may have moved them from `Dataset.mount`.
    """
    found: dict[str, tuple[float, ...]] = {}
    with bag.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages([TF_STATIC_TOPIC]):
            tree: Any = STORE.deserialize_cdr(message.data, TF)
            for link in tree.transforms:
                at = link.transform
                found[link.child_frame_id] = (*xyz(at.translation), *xyzw(at.rotation))
    return found


def direct(recording: RecordedRun, bag: Path | None = None) -> list[CheckedQuantity]:
    """Return what the direct tests say of a recording's bag, or of another one of the same run."""
    bag = bag or recording.bag
    base, frames = recording.truth(), published_mounts(bag)
    sweeps = []
    stamps, rates, forces = [], [], []
    with bag.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(["/points", "/imu"]):
            if channel.topic == "/points":
                cloud: Any = STORE.deserialize_cdr(message.data, CLOUD)
                points = np.frombuffer(cloud.data, POINT)
                places = np.stack([points[axis] for axis in "xyz"], axis=1).astype(np.float64)
                times = points["time"].astype(np.float64)
                sweeps.append(LidarSweep(nanos(cloud.header.stamp) / 1e9, places, times))
            else:
                imu: Any = STORE.deserialize_cdr(message.data, IMU)
                stamps.append(nanos(imu.header.stamp) / 1e9)
                rates.append(xyz(imu.angular_velocity))
                forces.append(xyz(imu.linear_acceleration))
    return [
        *scan_quantities(sweeps, base.seen_from(frames["lidar_link"]), solids(recording.scenario)),
        *imu_quantities(
            np.array(stamps), np.array(rates), np.array(forces), base.seen_from(frames["imu_link"])
        ),
    ]


def _row(name: str, q: CheckedQuantity) -> tuple[str, ...]:
    numbers = (f"{q.value:.4g}", f"{q.expected:.5g}", f"{q.tolerance:g}")
    return (name or "none", q.words, *numbers, "yes" if q.holds else "no")
