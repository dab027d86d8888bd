# SPDX-License-Identifier: Apache-2.0
"""One pass over a recording finds what was put into it."""

from pathlib import Path

import pytest

from groundlink.report.analysis import gather as module
from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.sensors import ImuSamples
from groundlink.report.analysis.streams import StreamTimes
from groundlink.ros.types import STORE
from tests.groundlink.report.conftest import (
    GAP_S,
    JPEG,
    RADIUS_M,
    SECONDS,
    SPEED_MPS,
    gathered_from,
)


def stream(gathered: RunSummary, topic: str) -> StreamTimes:
    [found] = [stream for stream in gathered.streams if stream.topic == topic]
    return found


def test_rates_are_those_of_the_stamps(gathered: RunSummary) -> None:
    truth = stream(gathered, "/ground_truth/odom")
    assert (truth.declared_hz, truth.messages, truth.gaps) == (50.0, 50 * SECONDS, 0)
    assert truth.measured_hz == pytest.approx(50.0)
    bins = truth.bins()
    assert bins is not None
    assert bins.kept.all()
    assert not bins.silent.any()
    assert bins.edges_s == pytest.approx([0, 1, 2, 3, 4, 5, SECONDS - 1 / 400])


def test_a_gap_is_found_where_it_is(gathered: RunSummary) -> None:
    imu = stream(gathered, "/imu")
    assert imu.gaps == 1
    longest = imu.largest_gaps[0]
    assert longest.nanos / 1e9 == pytest.approx(GAP_S[1] - GAP_S[0])
    assert gathered.seconds(longest.from_nanos) == pytest.approx(GAP_S[0])
    bins = imu.bins()
    assert bins is not None
    assert bins.kept.tolist() == [True, True, False, True, True, True]
    assert not bins.silent.any()
    assert imu.measured_hz is not None
    assert imu.measured_hz < 370


def test_the_way_and_the_speed_are_those_of_the_truth(gathered: RunSummary) -> None:
    [motion] = gathered.motions
    assert motion.distance_m == pytest.approx(SPEED_MPS * SECONDS, rel=0.01)
    assert motion.top_speed_mps == SPEED_MPS
    x, y = motion.place(0.0) or (9.0, 9.0)
    assert (x, y) == pytest.approx((0.0, 0.0))
    track = motion.track()
    assert ((track[:, 1] ** 2 + (track[:, 2] - RADIUS_M) ** 2) ** 0.5) == pytest.approx(RADIUS_M)
    assert motion.asked[0] == pytest.approx((0.0, 0.8, 0.5))


def test_energy_is_the_last_total_and_a_contact_is_one_event(gathered: RunSummary) -> None:
    [energy] = gathered.energies
    assert energy.last is not None
    assert energy.last.motor_work_j == pytest.approx(50 * (SECONDS - 0.1))
    [event] = energy.events
    assert event.name == "table_3_leg_1"
    assert event.begin_seconds == pytest.approx(3.0)
    assert event.end_seconds == pytest.approx(3.4)
    assert event.force_n == pytest.approx(900.0)
    assert event.force_seconds == pytest.approx(3.2, abs=0.003)
    assert event.ticks == 20


def test_the_mission_is_judged_by_truth_commands_and_contacts(gathered: RunSummary) -> None:
    [mission] = gathered.missions
    assert (mission.vehicle, mission.state, mission.ending) == ("rover", "driving", None)
    assert mission.driven_m == pytest.approx(SPEED_MPS * mission.seconds, rel=0.01)
    assert mission.speed_share == pytest.approx(SPEED_MPS / 0.8, abs=0.02)
    assert mission.turn_share == pytest.approx(1.0, abs=0.02)


def test_process_diagnostics_are_kept(gathered: RunSummary) -> None:
    assert gathered.diagnostics.processes["gateway"]["host"] == "lab-pc"
    assert gathered.diagnostics.processes["gateway"]["stale"] == "4"
    words = gathered.diagnostics.streams["/imu", "to ROS"]
    assert (words.last["missing"], words.last["dropped"]) == ("3", "2")
    assert [age for _, age, _ in words.ages] == pytest.approx([0.004 + 0.001 * i for i in range(6)])


def test_cameras_have_some_pictures_over_the_whole_run(gathered: RunSummary) -> None:
    raw, jpeg = gathered.cameras
    assert (raw.topic, jpeg.topic) == ("/camera/image", "/camera/jpeg")
    assert len(raw.pictures) == len(jpeg.pictures) == 6
    times = [at for at, _ in raw.pictures]
    assert times[0] < 1.0
    assert times[-1] > SECONDS - 1.2
    assert raw.pictures[0][1].startswith("data:image/png;base64,")
    assert jpeg.pictures[0][1].startswith("data:image/jpeg;base64,")
    assert JPEG


def test_only_shown_messages_are_decoded(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    decoded: dict[str, int] = {}

    class Counting:
        @staticmethod
        def deserialize_cdr(data: bytes, ros_type: str) -> object:
            decoded[ros_type] = decoded.get(ros_type, 0) + 1
            return STORE.deserialize_cdr(data, ros_type)

    monkeypatch.setattr(module, "STORE", Counting)
    monkeypatch.setattr(module, "MAX_SAMPLES", 300)
    gathered = gathered_from(recording)
    (samples,) = (r for r in gathered.readings["rover"] if isinstance(r, ImuSamples))
    assert 250 < decoded["sensor_msgs/msg/Imu"] == len(samples.rows) <= 300
    assert decoded["sensor_msgs/msg/Image"] == 6
    assert decoded["nav_msgs/msg/Odometry"] == 50 * SECONDS


def test_progress_goes_from_nothing_to_all(recording: Path) -> None:
    told: list[float] = []
    gathered_from(recording, told.append)
    assert told == sorted(told)
    assert (told[0], told[-1]) == (0.0, 1.0)
    assert len(told) > 2
