# SPDX-License-Identifier: Apache-2.0
"""A recording of an earlier version: `/tf` has the truth, and what a base tells is not there."""

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import BusMessage, Clock, Health, Imu, WheelEncoders
from groundlink.messages.navigation import Odometry, Transform, Transforms
from groundlink.recording.comparison import Comparison
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries, run_facts
from groundlink.recording.missing_readings import left_out
from groundlink.recording.reader import Recording
from groundlink.recording.ros1 import write_bag
from groundlink.recording.ros_channels import RosFile
from groundlink.recording.verifying import compared_messages, compared_span
from groundlink.report.analysis.gather import gather
from groundlink.report.page.page import page
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, diagnostics
from groundlink.ros.streams import outgoing, static_transforms
from services.recorder.recorder import Recorder
from services.recorder.verifier import ReferenceComparison
from services.replay.__main__ import playback

EPOCH = 1_700_000_000 * NANOS
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
NO_ERROR = memoryview(bytes(36 * 8))
LAB = load(SHIPPED / "indoor_lab.yaml")
RUN = "lab"
STEPS = 40


def told() -> Iterator[tuple[str, BusMessage]]:
    """Yield what was on the bus, by the names of ROS."""
    for step in range(STEPS):
        stamp, x_m = EPOCH + step * 8 * TICK_NANOS, 0.01 * step
        yield "/clock", Clock(stamp, EPOCH, step * 8, EPOCH)
        yield "/imu", Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0)
        sides = ("front_left", "front_right", "rear_left", "rear_right")
        yield "/wheel_encoders", WheelEncoders(stamp, "base_link", sides, (step,) * 4)
        yield (
            "/ground_truth/odom",
            Odometry(
                *(stamp, "world", "base_link", (x_m, 0.0, 0.1), UPRIGHT),
                *(STILL, STILL, NO_ERROR, NO_ERROR),
            ),
        )


@pytest.fixture
def earlier(tmp_path: Path) -> Iterator[Recording]:
    file = RosFile(tmp_path / "earlier.mcap")
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(LAB, RUN, EPOCH)))

    def write(topic: str, nanos: int, message: BusMessage) -> None:
        ros_type = CODECS[type(message)].ros_type
        file.topic(topic, ros_type, latched=topic == "/tf_static").write(nanos, to_cdr(message))

    mounts = static_transforms(LAB, EPOCH)
    assert mounts
    write("/tf_static", EPOCH, mounts)
    for topic, message in told():
        nanos: int = message.stamp_nanos  # type: ignore[attr-defined]
        write(topic, nanos, message)
        if isinstance(message, Odometry):
            moved = Transform(nanos, "world", "base_link", message.position_m, UPRIGHT)
            write("/tf", nanos, Transforms((moved,)))
    file.end(EPOCH + STEPS * 8 * TICK_NANOS)
    file.commit({})
    file.close()
    with Recording(tmp_path / "earlier.mcap") as recording:
        yield recording


def test_earlier_recording_equals_its_repeated_run(earlier: Recording) -> None:
    comparison = Comparison(compared_messages(earlier), compared_span(earlier), left_out(earlier))
    again = ReferenceComparison(earlier, comparison, expected=["/clock", "/imu"])
    keys = {stream.topic: stream.key for stream in outgoing(LAB, RUN)}
    recorder = Recorder(LAB, RUN, again.begin, duration_nanos=STEPS * 8 * TICK_NANOS)
    for topic, message in told():
        recorder.take(keys[topic], message)
    # Nor have ordered recordings any of these.
    told_now = diagnostics(EPOCH, [Health("physics", 7, 5, {})])
    again.topic(DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE).write(EPOCH, told_now)
    verdicts = {verdict.topic: verdict for verdict in comparison.verdicts()}
    assert {topic for topic, verdict in verdicts.items() if not verdict.is_equal} == set()
    assert {topic: verdict.equal for topic, verdict in verdicts.items()} == dict.fromkeys(
        ("/clock", "/imu", "/wheel_encoders", "/ground_truth/odom"), STEPS
    )


def test_earlier_recording_is_replayed_without_transforms(earlier: Recording) -> None:
    player = playback(earlier, RUN)
    due = list(player.play(EPOCH))
    assert player.refused == 0
    topics = {stream.key: topic for topic, stream in player.streams.items()}
    assert [(topics[row.key], row.message) for row in due] == list(told())


def test_a_report_is_made_of_it(earlier: Recording) -> None:
    gathered = gather(earlier, lambda share: None)
    (motion,) = gathered.motions
    assert motion.distance_m == pytest.approx(0.39)
    assert "/tf" in page(gathered)


def test_earlier_recording_converts_to_a_bag(earlier: Recording, tmp_path: Path) -> None:
    count = write_bag(tmp_path / "earlier.bag", earlier.types, earlier.read())
    assert count == earlier.messages == 1 + 5 * STEPS


def test_a_field_that_is_no_more_keeps_no_recording_from_being_read() -> None:
    entries = run_entries(describe_run(LAB, RUN, EPOCH))
    scenario = json.loads(entries["scenario"])
    scenario["vehicles"][0]["sensors"][1]["retired"] = None
    scenario["world"]["weather_of_old"] = {"rain": 1}
    scenario["old"] = [1]
    found = run_facts(entries | {"scenario": json.dumps(scenario), "mood": "good"})
    assert found.scenario == LAB


def test_other_damage_is_still_refused() -> None:
    entries = run_entries(describe_run(LAB, RUN, EPOCH))
    scenario = json.loads(entries["scenario"])
    scenario["seed"] = "many"
    with pytest.raises(msgspec.ValidationError):
        run_facts(entries | {"scenario": json.dumps(scenario)})
