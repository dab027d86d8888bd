# SPDX-License-Identifier: Apache-2.0
"""A recording that was made up: a rover on a circle, a camera, losses, a gap and a bump."""

from collections.abc import Callable
from math import cos, sin
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.loader import load
from groundlink.messages.base import BusMessage, Command, Health, Imu, StreamReport, packed
from groundlink.messages.ground_truth import Contact, Vitals
from groundlink.messages.imagery import CompressedImage, Image
from groundlink.messages.missing_readings import MissingReadings, MissingSpan
from groundlink.messages.navigation import Odometry
from groundlink.recording.metadata import (
    RUN_RECORD,
    describe_run,
    run_entries,
)
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.report.analysis.gather import RunSummary, gather
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, diagnostics
from groundlink.scenario.expectations import NeverTouches
from groundlink.scenario.ros_side import Stream

EPOCH = 1_700_000_000 * NANOS
SECONDS = 6
RADIUS_M, SPEED_MPS = 1.5, 0.75
GAP_S = (2.0, 2.5)
"""Without a sample of the IMU."""

TOLD_TO_TICK = 950
"""Of the last sample that its process says is missing."""

EVIL = "<script>alert('&')</script>"
ZERO3 = (0.0, 0.0, 0.0)
NO_ERROR = packed(np.zeros(36))
JPEG = b"\xff\xd8\xff\xe0 made up"

STREAM = StreamReport(
    *("/imu", "Imu", 400.0, 399.5, 0.004, 2000, 3),
    age_p99_seconds=0.02,
    sent=2010,
    missing=3,
    dropped=2,
    in_flight=5,
)


def stamps(rate_hz: float) -> list[int]:
    return [EPOCH + round(i / rate_hz * NANOS) for i in range(round(SECONDS * rate_hz))]


def odometry(stamp: int) -> Odometry:
    angle = (stamp - EPOCH) / NANOS * SPEED_MPS / RADIUS_M
    place = (RADIUS_M * sin(angle), RADIUS_M * (1 - cos(angle)), 0.165)
    turn = (0.0, 0.0, sin(angle / 2), cos(angle / 2))
    moves = ((SPEED_MPS, 0.0, 0.0), (0.0, 0.0, SPEED_MPS / RADIUS_M))
    return Odometry(stamp, "world", "base_link", place, turn, *moves, NO_ERROR, NO_ERROR)


def vitals(stamp: int) -> Vitals:
    seconds = (stamp - EPOCH) / NANOS
    hit = Contact("table_3_leg_1", 900.0 - 100 * abs(seconds - 3.2), int(seconds * 400), 4)
    return Vitals(
        *(stamp, "rover", round(seconds * 400), 50 * seconds, 20 * seconds),
        (hit,) if 3.0 <= seconds < 3.5 else (),
    )


def imu(stamp: int) -> Imu:
    return Imu(stamp, "imu_link", (0.0, 0.0, 0.0, 1.0), ZERO3, ZERO3, 0.0, 0.0, 0.0)


def image(stamp: int) -> Image:
    shade = (stamp - EPOCH) * 200 // (SECONDS * NANOS)
    data = np.full((48, 64, 3), shade, np.uint8)
    return Image(stamp, "camera", 48, 64, "rgb8", 64 * 3, packed(data))


def write(path: Path) -> Path:
    """Write the recording."""
    lab = load("indoor_lab_tour")
    cameras = (
        Stream(name="camera", kind="image", topic="/camera/image", rate_hz=5.0),
        Stream(name="jpeg", kind="compressed_image", topic="/camera/jpeg", rate_hz=5.0),
    )
    scenario = replace(
        lab,
        description=EVIL,
        vehicles=(replace(lab.vehicles[0], streams=cameras),),
        expect=(NeverTouches(), NeverTouches(name="hit", allowed=("table_3",))),
    )
    records: list[tuple[int, str, BusMessage]] = []
    records += [(s, "/ground_truth/odom", odometry(s)) for s in stamps(50)]
    records += [(s, "/vitals", vitals(s)) for s in stamps(10)]
    records += [
        (s, "/imu", imu(s)) for s in stamps(400) if not GAP_S[0] < (s - EPOCH) / NANOS < GAP_S[1]
    ]
    first, last, now = (EPOCH + tick * TICK_NANOS for tick in (801, TOLD_TO_TICK, 1000))
    told = MissingSpan("overloaded", first, last, TOLD_TO_TICK - 800, ("",))
    records.append((now, "/gaps/rover/imu", MissingReadings(now, "rover/imu", (told,))))
    records += [(s, "/cmd_vel", Command(s, (0.8, 0.0, 0.0), (0.0, 0.0, 0.5))) for s in stamps(20)]
    records += [(s, "/camera/image", image(s)) for s in stamps(5)]
    records += [
        (s, "/camera/jpeg", CompressedImage(s, "camera", "jpeg", memoryview(JPEG)))
        for s in stamps(5)
    ]
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "made_up", EPOCH)))
    for stamp, topic, message in sorted(records, key=lambda record: record[0]):
        ros_type = CODECS[type(message)].ros_type
        file.topic(topic, ros_type).write(stamp, to_cdr(message))
    for second, stamp in enumerate(stamps(1)):
        gateway = Health(
            *("gateway", 99, second * 400, {"stale": 4, "commands": 0}),
            (replace(STREAM, age_seconds=0.004 + 0.001 * second),),
            "lab-pc",
        )
        file.topic(DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE).write(stamp, diagnostics(stamp, [gateway]))
    declared = {"/imu": 400.0, "/ground_truth/odom": 50.0, "/vitals": 10.0, "/camera/image": 5.0}
    file.commit(declared)
    file.close()
    return path


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("report") / "made_up.mcap")


def gathered_from(
    path: Path, progress: Callable[[float], object] = lambda share: None
) -> RunSummary:
    with Recording(path) as opened:
        return gather(opened, progress)


@pytest.fixture(scope="session")
def gathered(recording: Path) -> RunSummary:
    return gathered_from(recording)
