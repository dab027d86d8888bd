# SPDX-License-Identifier: Apache-2.0
"""What of a recording can be compared, and how its run is told again."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS, Schedule
from groundlink.core.errors import UserError
from groundlink.episode.fault_messages import Faults
from groundlink.episode.journal import (
    Commanded,
    JointsCommanded,
    Journal,
    dumped,
    encode_entry,
    this_platform,
)
from groundlink.loader import load
from groundlink.messages.base import BusMessage, Clock, Command, Imu, packed
from groundlink.messages.missing_readings import Cause, MissingReadings, MissingSpan
from groundlink.messages.navigation import JointState
from groundlink.recording import missing_readings as missing
from groundlink.recording import verifying
from groundlink.recording.comparison import ComparedSpan
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.streams import faults_topic, missing_readings_topic
from groundlink.scenario import Scenario
from groundlink.scenario.expectations import NeverTouches
from groundlink.scenario.faults import Bias, Drop, Fault, Stuck
from groundlink.scene.loaded_world import with_world
from services.sensors.encoders.spec import Encoders

EPOCH = 1_000 * NANOS
STILL = (0.0, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
ENTRY = encode_entry(Commanded(3, "rover", Command(0, STILL, STILL)))
IMU = "rover/imu"


def clock(seconds: float) -> Clock:
    tick = round(seconds * 400)
    return Clock(EPOCH + tick * TICK_NANOS, EPOCH, tick, 1)


Rows = Iterable[tuple[str, BusMessage]]


def record(
    path: Path,
    scenario: Scenario,
    rows: Rows,
    end_nanos: int | None = None,
    known: Journal | None = None,
    begin_s: float = 0.0,
) -> Recording:
    """Return a recording of some messages, and of a clock."""
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "lab", EPOCH)))
    clocks = [("/clock", clock(begin_s + i / 10)) for i in range(100)]
    for topic, message in sorted([*clocks, *rows], key=lambda row: stamp(row[1])):
        form = CODECS[type(message)]
        file.topic(topic, form.ros_type).write(stamp(message), to_cdr(message))
    file.lacks({"/imu": 2, "/ground_truth/odom": 1})
    if known is not None:
        file.add_journal(EPOCH, dumped(known))
    if end_nanos is not None:
        file.end(end_nanos)
    file.commit({})
    file.close()
    return Recording(path)


def stamp(message: Any) -> int:
    nanos: int = message.stamp_nanos
    return nanos


def journal(scenario: Scenario, seconds: float) -> Journal:
    return Journal(
        made_on=this_platform(),
        run="lab",
        episode=1,
        epoch_nanos=EPOCH,
        scenario=scenario,
        tick=round(seconds * 400),
        digest="",
        entries=(ENTRY,),
    )


LAST = EPOCH + 9_900_000_000


@pytest.mark.parametrize(
    ("end_s", "journal_s", "expected"),
    [
        (9.0, 9.95, ComparedSpan(EPOCH, EPOCH + 9 * NANOS, EPOCH, EPOCH + 9 * NANOS)),
        (None, 9.95, ComparedSpan(EPOCH, LAST + 1, EPOCH, LAST - NANOS)),
        (None, None, ComparedSpan(EPOCH, LAST + 1, EPOCH, LAST - NANOS)),
        (None, 6.0, ComparedSpan(EPOCH, EPOCH + 5 * NANOS, EPOCH, EPOCH + 5 * NANOS)),
    ],
    ids=["whole", "ended early", "without a journal", "journal cut off"],
)
def test_compared_span(
    lab: Scenario,
    tmp_path: Path,
    end_s: float | None,
    journal_s: float | None,
    expected: ComparedSpan,
) -> None:
    end = None if end_s is None else EPOCH + round(end_s * NANOS)
    known = None if journal_s is None else journal(lab, journal_s)
    with record(tmp_path / "a.mcap", lab, [], end, known) as recording:
        assert verifying.compared_span(recording) == expected


def test_too_little_is_one_line(lab: Scenario, tmp_path: Path) -> None:
    with (
        record(tmp_path / "a.mcap", lab, [], None, journal(lab, 0.5)) as recording,
        pytest.raises(UserError, match="too short"),
    ):
        verifying.compared_span(recording)
    file = RosFile(tmp_path / "b.mcap")
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(lab, "lab", EPOCH)))
    file.commit({})
    file.close()
    with (
        Recording(tmp_path / "b.mcap") as recording,
        pytest.raises(UserError, match="no messages recorded"),
    ):
        verifying.compared_span(recording)


def imu(seconds: float) -> tuple[str, Imu]:
    nanos = EPOCH + round(seconds * NANOS)
    return "/imu", Imu(nanos, "imu_link", UPRIGHT, STILL, STILL, 0.0, 0.0, 0.0)


def faults(seconds: float, *active: Fault) -> tuple[str, Faults]:
    nanos = EPOCH + round(seconds * NANOS)
    return faults_topic(IMU), Faults(nanos, IMU, round(seconds * 400), active)


def test_topics_not_compared_have_a_reason(lab: Scenario, tmp_path: Path) -> None:
    command = ("/cmd_vel", Command(EPOCH, STILL, STILL))
    gaps = (missing_readings_topic(IMU), MissingReadings(EPOCH, IMU, ()))
    rows: list[tuple[str, BusMessage]] = [imu(1.0), command, gaps, faults(2.0, Stuck(at_s=2.0))]
    with record(tmp_path / "a.mcap", lab, rows) as recording:
        assert verifying.silent_sensors(recording, lab) == [
            "rover/lidar",
            "rover/encoders",
            "rover/camera",
        ]
        assert verifying.not_compared(recording) == {
            "/cmd_vel": "an input of the run, applied again from the recording",
            "/faults/rover/imu": "changed during the run; the repeated run has it from the start",
            "/gaps/rover/imu": "missing readings of the recorded run",
        }
        compared = {message.topic for message in verifying.compared_messages(recording)}
    assert compared == {"/clock", "/imu"}


STUCK, BIAS = Stuck(at_s=2.0), Bias(at_s=4.0, value=0.5)
DROP = Drop(at_s=3.0, for_s=1.0, share=0.5)
JOINED = "published by a process that joined late"
BY_HAND = "changed during the run; the repeated run has it from the start"
LIVE: dict[str, tuple[tuple[Fault, ...], Rows, tuple[Fault, ...] | None, str | None]] = {
    "none": ((), [], None, None),
    "the scenario's": (
        (DROP, BIAS),
        [faults(3.0, DROP), faults(4.0, BIAS)],
        None,
        None,
    ),
    "joined later": ((DROP,), [faults(0.5), faults(3.0, DROP), faults(4.0)], None, JOINED),
    "joined in the midst of one": ((DROP,), [faults(3.5, DROP), faults(4.0)], None, JOINED),
    "one more": (
        (DROP,),
        [faults(2.0, STUCK), faults(3.0, DROP, STUCK), faults(4.0, STUCK)],
        (DROP, STUCK),
        BY_HAND,
    ),
    "cleared": (
        (BIAS,),
        [faults(2.0, STUCK), faults(2.5), faults(4.0, BIAS), faults(6.0)],
        (replace(BIAS, for_s=2.0), replace(STUCK, for_s=0.5)),
        BY_HAND,
    ),
}


@pytest.mark.parametrize(("given", "told", "expected", "reason"), LIVE.values(), ids=LIVE)
def test_live_faults_become_the_scenarios(
    lab: Scenario,
    tmp_path: Path,
    given: tuple[Fault, ...],
    told: Rows,
    expected: tuple[Fault, ...] | None,
    reason: str | None,
) -> None:
    scenario = with_faults(lab, given)
    with record(tmp_path / "a.mcap", scenario, told, None, journal(scenario, 9.95)) as recording:
        found = verifying.live_faults(recording)
        assert found == ({} if expected is None else {IMU: expected})
        again = verifying.replay_journal(recording, scenario)
        why = verifying.not_compared(recording).get(faults_topic(IMU))
    assert why == reason
    pair = again.scenario.sensor(IMU)
    assert pair is not None
    assert pair[1].faults == (given if expected is None else expected)
    assert again.entries == (ENTRY,)
    assert again.scenario.time.mode == "fast"
    assert again.acks == {}
    assert again.tick > 10**12


def with_faults(scenario: Scenario, faults: tuple[Fault, ...]) -> Scenario:
    (vehicle,) = scenario.vehicles
    sensors = tuple(
        replace(sensor, faults=faults) if sensor.name == "imu" else sensor
        for sensor in vehicle.sensors
    )
    return replace(scenario, vehicles=(replace(vehicle, sensors=sensors),))


def test_without_a_journal_commands_are_taken_at_their_stamps(
    lab: Scenario, tmp_path: Path
) -> None:
    rows = [
        ("/cmd_vel", Command(EPOCH + tick * TICK_NANOS, (0.01 * tick, 0.0, 0.0), STILL))
        for tick in (40, 80)
    ]
    with record(tmp_path / "a.mcap", lab, rows) as recording:
        again = verifying.replay_journal(recording, lab)
    assert again.epoch_nanos == EPOCH
    assert list(again.read()) == [
        Commanded(tick, "rover", Command(tick * TICK_NANOS, (0.01 * tick, 0.0, 0.0), STILL))
        for tick in (40, 80)
    ]


def test_commands_of_joints_are_taken_again_as_those_of_the_vehicle(tmp_path: Path) -> None:
    tank = load("outdoor_paper")

    def command(stamp_nanos: int) -> JointState:
        at, nothing = packed(np.array([0.5])), memoryview(b"")
        return JointState(stamp_nanos, "", ("turret",), at, nothing, nothing)

    sent = ("/joint_commands", command(EPOCH + 40 * TICK_NANOS))
    where = ("/ground_truth/joints", command(EPOCH))
    with record(tmp_path / "a.mcap", tank, [sent, where]) as recording:
        again = verifying.replay_journal(recording, tank)
        why = verifying.not_compared(recording)
    assert list(again.read()) == [JointsCommanded(40, "tank", command(40 * TICK_NANOS))]
    assert why["/joint_commands"] == "an input of the run, applied again from the recording"
    assert where[0] not in why


@pytest.mark.parametrize("rate_hz", [400.0, 100.0, 30.0])
def test_the_clock_of_a_restore_that_is_not_due_does_not_come_again(
    lab: Scenario, tmp_path: Path, rate_hz: float
) -> None:
    scenario = replace(lab, time=replace(lab.time, clock_rate_hz=rate_hz))
    due = {Schedule.at(rate_hz).tick(i) for i in range(1300)}
    ticks = [1213, 1214, 1215, 1216, 1227]
    with record(
        tmp_path / "a.mcap", scenario, [("/clock", clock(tick / 400)) for tick in ticks]
    ) as recording:
        found = [(it.nanos - EPOCH) // TICK_NANOS for it in verifying.compared_messages(recording)]
    assert [tick for tick in found if tick in ticks] == [tick for tick in ticks if tick in due]


def gap(cause: Cause, first_s: float, last_s: float, *outputs: str) -> MissingSpan:
    first, last = (EPOCH + round(s * NANOS) for s in (first_s, last_s))
    return MissingSpan(cause, first, last, 1, outputs or ("",))


def test_missing_readings_are_read_with_their_cause(lab: Scenario, tmp_path: Path) -> None:
    told = [
        MissingReadings(
            EPOCH + NANOS, "rover/camera", (gap("not there", 0.0, 0.5, "", "camera_info"),)
        ),
        MissingReadings(
            EPOCH + 3 * NANOS,
            "rover/camera",
            (gap("overloaded", 2.0, 2.5), gap("states lost", 1.0, 1.1)),
        ),
    ]
    with record(
        tmp_path / "a.mcap", lab, [(missing_readings_topic("rover/camera"), g) for g in told]
    ) as it:
        cause_of = missing.left_out(it)
    picture, info = "/camera/image_raw/compressed", "/camera/camera_info"
    asked = ((picture, 0.25), (info, 0.5), (picture, 0.75), (picture, 1.0), (picture, 2.5))
    causes = [cause_of(topic, EPOCH + round(s * NANOS)) for topic, s in asked]
    assert causes == ["not there", "not there", None, "states lost", "overloaded"]
    assert cause_of(info, EPOCH + 2 * NANOS) is None
    assert [cause_of("/imu", EPOCH) for _ in range(3)] == ["recorder behind"] * 2 + [None]


@pytest.mark.parametrize(
    ("missed_ticks", "cause", "expected"),
    [
        (0.01, "not there", {"/odom", "/wheel_encoders"}),
        (0.0, "states lost", {"/odom"}),
        (0.01, "drop", set()),
    ],
)
def test_accumulating_topics_after_gaps_may_differ(
    tmp_path: Path, missed_ticks: float, cause: Cause, expected: set[str]
) -> None:
    tour = load("indoor_2d")
    (rover,) = tour.vehicles
    sensors = tuple(
        replace(sensor, missed_ticks=missed_ticks) if isinstance(sensor, Encoders) else sensor
        for sensor in rover.sensors
    )
    tour = replace(tour, vehicles=(replace(rover, sensors=sensors),))
    rows = [
        (
            missing_readings_topic(name),
            MissingReadings(EPOCH + NANOS, name, (gap(cause, 0.0, 0.5),)),
        )
        for name in ("rover/imu", "rover/encoders", "rover/odometry")
    ]
    with record(tmp_path / "a.mcap", tour, rows) as recording:
        assert missing.accumulating_topics(recording).keys() == expected


@pytest.mark.parametrize(("mode", "expected"), [("realtime", {"/odom"}), ("fast", set())])
def test_accumulating_topics_of_a_late_recording_may_differ(
    tmp_path: Path, mode: Literal["realtime", "fast"], expected: set[str]
) -> None:
    tour = load("indoor_2d")
    tour = replace(tour, time=replace(tour.time, mode=mode))
    with record(tmp_path / "a.mcap", tour, [], begin_s=2.0) as recording:
        assert missing.accumulating_topics(recording).keys() == expected


def test_a_run_in_a_loaded_world_is_repeated_in_it(tmp_path: Path, lab: Scenario) -> None:
    yard = with_world(lab, load("yard"))
    for loaded in (True, False):
        known = replace(journal(yard, 9.95), in_loaded_world=True if loaded else UNSET)
        path = tmp_path / f"{loaded}.mcap"
        with record(path, yard, [], known=known) as recording:
            again = verifying.in_recorded_world(recording, lab)
            assert again == (yard if loaded else lab)
            extent = verifying.compared_span(recording)
            lines = [*verifying.caveats(recording, again, extent)]
        told = any("world `yard` was loaded during the run" in line for line in lines)
        assert (told, any("world hash differs" in line for line in lines)) == (loaded, not loaded)


def test_late_recording_states_its_begin(tmp_path: Path, lab: Scenario) -> None:
    with record(tmp_path / "a.mcap", lab, [], begin_s=2.0) as recording:
        extent = ComparedSpan(EPOCH + 2 * NANOS, EPOCH + 9 * NANOS, EPOCH, EPOCH)
        said = list(verifying.caveats(recording, lab, extent))
    assert "the recording begins at 2.000 s: earlier messages are not compared" in said


def test_scenarios_differ_only_in_fields_that_change_bytes(lab: Scenario) -> None:
    paced = replace(lab, name="other", time=replace(lab.time, mode="fast", factor=3.0))
    assert verifying.scenario_difference(lab, paced) is None
    assert verifying.scenario_difference(lab, replace(lab, expect=(NeverTouches(),))) is None
    assert str(verifying.scenario_difference(lab, replace(lab, seed=2))) == (
        "seed: 1 recorded, 2 repeated"
    )
    faulty = verifying.scenario_difference(lab, with_faults(lab, (STUCK,)))
    assert str(faulty) == (
        "vehicles[0].sensors[1].faults (rover, imu): 0 elements recorded, 1 elements repeated"
    )


def test_vehicles_that_came_before_the_recording_are_expected(
    lab: Scenario, tmp_path: Path
) -> None:
    (rover,) = lab.vehicles
    second = replace(rover, name="second", namespace="/second")
    grown = replace(lab, vehicles=(rover, second))
    with record(tmp_path / "a.mcap", grown, [], None, journal(lab, 9.95)) as recording:
        assert verifying.with_later_vehicles(recording, lab) == grown
        assert verifying.later_sensors(recording) == [
            name for name in grown.sensor_names() if name.startswith("second/")
        ]
    with record(tmp_path / "b.mcap", lab, [], None, journal(lab, 9.95)) as recording:
        assert verifying.with_later_vehicles(recording, lab) == lab
