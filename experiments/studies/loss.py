# SPDX-License-Identifier: Apache-2.0
"""Effect of a lossy link on SLAM: the same drive in real time over links that lose datagrams."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader

from experiments.estimation.estimators import GICP, LIDAR_INERTIAL, SLAM_2D, run_estimator
from experiments.estimation.evaluation import Evaluation, write_rows
from experiments.experiment import ExperimentOptions, record_setup
from experiments.recording.recordings import RecordedRun
from experiments.recording.setups import IN_REAL_TIME, Setup
from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.streams import TF_STATIC_TOPIC

from .track import there_and_back

SECONDS = 40.0
SHORT_SECONDS = 12.0

RESENT: Any = {"resend": 0.5}
"""What is lost is asked for again, for half a second."""


class LossyLink(NamedTuple):
    """A link to ROS."""

    lost: float
    """Share of datagrams."""

    repair: Any = "none"
    datagram: str = "loopback"
    """Datagram size: `loopback` or `mtu`."""

    @property
    def words(self) -> str:
        """Name in tables."""
        small = ", datagrams of 1,472 bytes" if self.datagram == "mtu" else ""
        return f"{100 * self.lost:g} % lost{small}{', repaired' if self.repair == RESENT else ''}"


LINKS = (
    LossyLink(0.0),
    LossyLink(0.01),
    LossyLink(0.01, RESENT),
    LossyLink(0.05),
    LossyLink(0.05, RESENT),
    LossyLink(0.01, datagram="mtu"),
    LossyLink(0.01, RESENT, "mtu"),
)

TOPICS = ("/points", "/scan", "/imu", "/odom")

_TIME = struct.Struct("<iI")
"""A stamp, behind the CDR's four bytes."""

Row = tuple[str, ...]


def loss(options: ExperimentOptions) -> Sequence[Evaluation]:
    """Run SLAM by clouds, and by scans, on data that came over links that lose datagrams."""
    results: list[Evaluation] = []
    rows: list[Row] = []
    for link in LINKS:
        case = link.words
        setup = Setup(
            name="loss",
            scenario="track",
            seconds=SHORT_SECONDS if options.short else SECONDS,
            sensors={"lidar": {"datasheet": "sensors/vlp16.yaml"}},
            vehicle={
                "placement": {"x_m": -4.0, "y_m": 0.0, "yaw_deg": 0.0},
                "route": there_and_back(4.0, 0.6),
            },
            top={"gateway": {"datagram": link.datagram}},
            link={"seed": 7, "to_ros": {"loss": link.lost}},
            repair=link.repair,
            time=IN_REAL_TIME,
        )
        recording = record_setup(options, setup)
        arrived = {delivery.topic: delivery for delivery in recording.deliveries}
        told = [f"{arrived[topic].arrived} of {arrived[topic].sent}" for topic in TOPICS]
        options.console.print(
            f"loss, {case}: " + ", ".join(map(" ".join, zip(TOPICS, told, strict=True)))
        )
        errors = [_error(options, recording, case, which, results) for which in _RUNS]
        rows.append((case, *told, *errors))
    head = ("link", *TOPICS, *(f"{which}, ATE (m)" for which in _RUNS))
    write_rows(options.folder("tables") / "loss_arrived.csv", head, rows)
    return results


def _error(
    options: ExperimentOptions,
    recording: RecordedRun,
    case: str,
    which: str,
    results: list[Evaluation],
) -> str:
    """Return how well a program did, in words, and add it to the results; it may do nothing."""
    try:
        result = _RUNS[which](options, recording, case)
    except UserError as error:
        options.console.print(f"loss, {case}: {which}: {error}")
        return "none"
    results.append(result)
    return f"{result.ate_m:.4f}"


def _inertial(options: ExperimentOptions, recording: RecordedRun, case: str) -> Evaluation:
    bag = options.folder("runs", recording.folder.name) / "in_order.mcap"
    bag.unlink(missing_ok=True)
    in_order(recording.bag, bag)
    return run_estimator(options, LIDAR_INERTIAL, recording, experiment="loss", case=case, bag=bag)[
        0
    ]


def in_order(bag: Path, out: Path) -> None:
    """Write clouds, the IMU and mounts of a bag in the order of their stamps.

    What is sent again comes after what overtook it; genz-lio's loader refuses such a bag.
    """
    found = []
    with bag.open("rb") as stream:
        for schema, channel, message in make_reader(stream).iter_messages(
            ["/points", "/imu", TF_STATIC_TOPIC]
        ):
            assert schema is not None
            second, nano = _TIME.unpack_from(message.data, 4)
            nanos = 0 if channel.topic == TF_STATIC_TOPIC else second * NANOS + nano
            found.append((nanos, channel.topic, schema.name, message.data))
    file = RosFile(out)
    for nanos, topic, ros_type, cdr in sorted(found):
        latched = topic == TF_STATIC_TOPIC
        file.topic(topic, ros_type, latched=latched).write(nanos, memoryview(cdr))
    file.commit({})
    file.close()


def _lidar(options: ExperimentOptions, recording: RecordedRun, case: str) -> Evaluation:
    return run_estimator(options, GICP, recording, experiment="loss", case=case)[0]


def _scans(options: ExperimentOptions, recording: RecordedRun, case: str) -> Evaluation:
    return run_estimator(options, SLAM_2D, recording, experiment="loss", case=case)[0]


_RUNS = {"LiDAR and IMU": _inertial, "LiDAR alone": _lidar, "scans": _scans}
