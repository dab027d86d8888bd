# SPDX-License-Identifier: Apache-2.0
"""What a bad link costs SLAM: the same drive in real time over links that lose datagrams.

Rule: bus, gateway, UDP Bridge, ROS node, bag, and only then programs; a link in the gateway loses
datagrams on their way to ROS, with a seed. Without loss the row is what a program makes of whole
data.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from groundlink.errors import UserError

from . import environments
from .evaluation import Result, write_rows
from .experiment import Options, judged
from .odometries import GICP, LIDAR_INERTIAL, ran
from .programs import YAG_SLAM
from .recordings import Recording, record
from .setups import IN_REAL_TIME, Setup
from .track import there_and_back

SECONDS = 40.0
SHORT_SECONDS = 12.0

RESENT: Any = {"resend": 0.5}
"""What is lost is asked for again, for half a second."""

LINKS: tuple[tuple[float, Any], ...] = (
    (0.0, "none"),
    (0.01, "none"),
    (0.01, RESENT),
    (0.05, "none"),
    (0.05, RESENT),
)
"""Share of datagrams that is lost, and what is done about it."""

TOPICS = ("/points", "/scan", "/imu", "/odom")

Row = tuple[str, ...]


def loss(options: Options) -> Sequence[Result]:
    """Run SLAM by clouds, and by scans, on data that came over each of the links."""
    results: list[Result] = []
    rows: list[Row] = []
    for share, repair in LINKS:
        case = f"{100 * share:g} % lost" + (", repaired" if repair == RESENT else "")
        setup = Setup(
            name="loss",
            scenario="track",
            seconds=SHORT_SECONDS if options.short else SECONDS,
            sensors={"lidar": {"datasheet": "sensors/vlp16.yaml"}},
            vehicle={
                "placement": {"x_m": -4.0, "y_m": 0.0, "yaw_deg": 0.0},
                "route": there_and_back(4.0, 0.6),
            },
            link={"seed": 7, "to_ros": {"loss": share}},
            repair=repair,
            time=IN_REAL_TIME,
        )
        recording = record(setup.varied(options.vary), options.out, options.say)
        arrived = {account.topic: account for account in recording.accounts}
        told = [f"{arrived[topic].arrived} of {arrived[topic].sent}" for topic in TOPICS]
        options.say(f"loss, {case}: " + ", ".join(map(" ".join, zip(TOPICS, told, strict=True))))
        errors = [_error(options, recording, case, which, results) for which in _RUNS]
        rows.append((case, *told, *errors))
    head = ("link", *TOPICS, *(f"{which}, ATE (m)" for which in _RUNS))
    write_rows(options.folder("tables") / "loss_arrived.csv", head, rows)
    return results


def _error(
    options: Options, recording: Recording, case: str, which: str, results: list[Result]
) -> str:
    """Return how well a program did, in words, and add it to the results; it may do nothing."""
    try:
        result = _RUNS[which](options, recording, case)
    except UserError as error:
        options.say(f"loss, {case}: {which}: {error}")
        return "none"
    results.append(result)
    return f"{result.ate_m:.4f}"


def _inertial(options: Options, recording: Recording, case: str) -> Result:
    return ran(options, LIDAR_INERTIAL, recording, experiment="loss", seed=1, case=case)[0]


def _lidar(options: Options, recording: Recording, case: str) -> Result:
    return ran(options, GICP, recording, experiment="loss", seed=1, case=case)[0]


def _scans(options: Options, recording: Recording, case: str) -> Result:
    tum = options.folder("runs", recording.folder.name) / "yag_slam.tum"
    began_s = time.monotonic()
    environments.run(
        YAG_SLAM,
        [recording.bag, tum],
        options.out,
        options.say,
        label=f"loss, {case}",
        log=tum.with_suffix(".log"),
    )
    return judged(
        options,
        recording,
        tum,
        frame="scan_link",
        seed=1,
        experiment="loss",
        program=YAG_SLAM.name,
        case=case,
        took_s=time.monotonic() - began_s,
    )[0]


_RUNS = {"LiDAR and IMU": _inertial, "LiDAR alone": _lidar, "scans": _scans}
