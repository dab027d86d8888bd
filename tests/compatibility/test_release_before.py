# SPDX-License-Identifier: Apache-2.0
"""A scenario and a recording of the release before still read as they did.

`every_kind.mcap` was recorded from `every_kind.yaml` by that release: 0.6 s of a rover with a
sensor of every kind. Neither file is ever edited; a new release adds files of its own.
"""

from collections import Counter
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.__main__ import main
from groundlink.loader import load
from groundlink.recording.reader import Recording
from services.replay.__main__ import playback

HERE = Path(__file__).parent
RECORDING = HERE / "every_kind.mcap"
SCENARIO = HERE / "every_kind.yaml"

COUNTS = {
    "/camera/camera_info": 3,
    "/camera/image_raw/compressed": 3,
    "/clock": 60,
    "/cmd_vel": 29,
    "/depth/camera_info": 3,
    "/depth/image_rect_raw": 3,
    "/faults/rover/lidar": 2,
    "/fix": 3,
    "/ground_truth/bodies": 6,
    "/ground_truth/odom": 30,
    "/ground_truth/tf": 30,
    "/ground_truth/wheels": 30,
    "/imu": 58,
    "/joint_states": 30,
    "/odom": 30,
    "/points": 6,
    "/points/truth": 6,
    "/robot_description": 1,
    "/scan": 6,
    "/sonar": 9,
    "/stereo/left/camera_info": 3,
    "/stereo/left/image_raw/compressed": 3,
    "/stereo/right/camera_info": 3,
    "/stereo/right/image_raw/compressed": 3,
    "/tf": 30,
    "/tf_static": 1,
    "/vitals": 6,
    "/wheel_encoders": 30,
}


def test_the_scenario_is_valid_without_a_warning(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(SCENARIO)]) == 0
    assert "warning" not in capsys.readouterr().err


def test_the_recording_has_its_messages_and_the_scenario() -> None:
    with Recording(RECORDING) as recording:
        assert Counter(message.topic for message in recording.read()) == COUNTS
        now = load(str(SCENARIO))
        # Shipped models have gained figures of effects, which act in none of its vehicles.
        vehicles = (replace(v, model=v.model.with_effects(v.effects)) for v in now.vehicles)
        now = replace(now, vehicles=tuple(vehicles))
        assert recording.run.scenario == replace(now, time=recording.run.scenario.time)
        assert recording.journal is not None
        told = {topic: facts.messages for topic, facts in recording.topics.items()}
        assert {topic: count for topic, count in told.items() if count} == COUNTS
        assert recording.end_nanos is not None


def test_every_stream_can_be_replayed() -> None:
    with Recording(RECORDING) as recording:
        player = playback(recording, recording.run.run)
        assert sum(1 for _ in player.play(recording.first_nanos)) > 300
        assert player.refused == 0


@pytest.mark.parametrize("words", [("convert", "out.bag"), ("report", "--out", "out.html")])
def test_commands_read_the_recording(tmp_path: Path, words: tuple[str, ...]) -> None:
    command, *options, out = words
    assert main([command, str(RECORDING), *options, str(tmp_path / out)]) == 0
    assert (tmp_path / out).stat().st_size > 10_000
