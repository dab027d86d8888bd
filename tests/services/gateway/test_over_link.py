# SPDX-License-Identifier: Apache-2.0
"""A recording over an emulated link: what arrives, when, and that it repeats."""

from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from groundlink.core.clock import NANOS
from groundlink.emulation.script import LinkEvent, LinkScript
from groundlink.emulation.settings import Impairment
from groundlink.recording.judging import judged
from groundlink.recording.reader import RecordedMessage, Recording
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.types import STORE
from groundlink.scenario import Scenario
from groundlink.scenario.expectations import TopicAge, TopicRate
from groundlink.scenario.faults import Delay
from services.gateway import over_link
from services.gateway.over_link import RecordedLink, write_over_link

EVERY_KIND = Path(__file__).parents[3] / "tests" / "compatibility" / "every_kind.mcap"
MS = 1_000_000


@pytest.fixture
def recording() -> Iterator[Recording]:
    with Recording(EVERY_KIND) as opened:
        yield opened


def by_topic(messages: Iterator[RecordedMessage]) -> dict[str, list[RecordedMessage]]:
    found = defaultdict(list)
    for message in messages:
        found[message.topic].append(message)
    return found


def link(**to_ros: Any) -> LinkScript:
    return LinkScript(seed=3, to_ros=Impairment(**to_ros))


def with_fault(recording: Recording, topic: str, fault: Delay) -> Scenario:
    scenario = recording.run.scenario
    vehicles = tuple(
        replace(
            vehicle,
            sensors=tuple(
                replace(sensor, faults=(fault,)) if sensor.topic == topic else sensor
                for sensor in vehicle.sensors
            ),
        )
        for vehicle in scenario.vehicles
    )
    return replace(scenario, vehicles=vehicles)


def test_perfect_link_delivers_each_message_when_it_is_complete(recording: Recording) -> None:
    sent, came = by_topic(recording.read()), by_topic(RecordedLink(recording, link()).messages())
    measuring_s = {
        sensor.topic: sensor.measuring_s
        for vehicle in recording.run.scenario.vehicles
        for sensor in vehicle.sensors
    }
    assert max(measuring_s.values()) > 0.05, "a LiDAR sends a revolution at its end"
    for topic, span_s in measuring_s.items():
        end_nanos = recording.last_nanos - span_s * NANOS
        in_time = [message for message in sent[topic] if message.nanos <= end_nanos]
        assert [message.cdr for message in came[topic]] == [message.cdr for message in in_time]
        assert [each.nanos for each in came[topic]] == [
            each.nanos + round(span_s * NANOS) for each in in_time
        ]


def test_same_link_gives_the_same_bytes(recording: Recording, tmp_path: Path) -> None:
    script = link(loss=0.1, burst=3, delay_ms=20, jitter_ms=30, duplicate=0.1)
    files = [tmp_path / "one.mcap", tmp_path / "two.mcap"]
    for file in files:
        write_over_link(recording, script, file)
    assert files[0].read_bytes() == files[1].read_bytes()
    write_over_link(recording, replace(script, seed=4), other := tmp_path / "other.mcap")
    assert other.read_bytes() != files[0].read_bytes()


def test_ground_truth_is_copied_even_where_it_is_sent_to_ros(recording: Recording) -> None:
    scenario = recording.run.scenario
    vehicles = tuple(
        replace(vehicle, ground_truth=replace(vehicle.ground_truth, push=True))
        for vehicle in scenario.vehicles
    )
    recording.run = replace(recording.run, scenario=replace(scenario, vehicles=vehicles))
    sent, came = (
        by_topic(messages)
        for messages in (recording.read(), RecordedLink(recording, link(loss=0.5)).messages())
    )
    for vehicle in vehicles:
        for topic in scenario.true_topics(vehicle):
            assert came[topic] == sent[topic] != []


def test_first_report_has_what_came_before_it(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_link, "PERIOD_NANOS", NANOS // 2)
    (report,) = by_topic(RecordedLink(recording, link()).messages())[DIAGNOSTICS_TOPIC]
    array: Any = STORE.deserialize_cdr(report.cdr, report.ros_type)
    (imu,) = (status for status in array.status if status.name == "gateway: /imu to ROS")
    assert float({pair.key: pair.value for pair in imu.values}["measured_hz"]) > 90


def test_datagrams_are_lost_delayed_and_cut_off(recording: Recording) -> None:
    half = (recording.first_nanos + recording.last_nanos) // 2
    at_s = (half - recording.run.epoch_nanos) / NANOS
    script = replace(
        link(loss=0.2, delay_ms=20), events=(LinkEvent(at_s=at_s, to_ros={"outage": True}),)
    )
    sent, came = by_topic(recording.read()), by_topic(RecordedLink(recording, script).messages())
    stamps = {message.cdr: message.nanos for message in sent["/imu"]}
    before = [message for message in sent["/imu"] if message.nanos < half]
    assert 0.6 < len(came["/imu"]) / len(before) < 0.95
    assert {message.nanos - stamps[message.cdr] for message in came["/imu"]} == {20 * MS}
    assert max(message.nanos for message in came["/imu"]) < half + 21 * MS


def test_delay_of_a_fault_counts_and_keeps_the_order(recording: Recording) -> None:
    stamps = {message.cdr: message.nanos for message in by_topic(recording.read())["/imu"]}
    recording.run = replace(
        recording.run,
        scenario=with_fault(recording, "/imu", Delay(at_s=0.0, for_s=0.1, delay_s=0.2)),
    )
    came = by_topic(RecordedLink(recording, link()).messages())["/imu"]
    late = [message.nanos - stamps[message.cdr] for message in came]
    assert late[0] == 200 * MS
    assert [message.nanos for message in came] == sorted(message.nanos for message in came)
    assert late[-1] == 0
    assert any(0 < each < 200 * MS for each in late), "they wait for those before them"


def test_expectations_judge_what_arrives(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(over_link, "PERIOD_NANOS", NANOS // 10)  # the recording is short
    expect = (
        TopicRate(topic="/imu", at_least_hz=99.0),
        TopicAge(topic="/imu", at_most_ms=25.0),
        TopicAge(name="fresh", topic="/imu", at_most_ms=15.0),
    )
    scenario = replace(recording.run.scenario, expect=expect)
    verdicts = {}
    for loss in (0.0, 0.2):
        write_over_link(recording, link(loss=loss, delay_ms=20), file := tmp_path / f"{loss}.mcap")
        with Recording(file) as came:
            verdicts[loss] = [result.verdict for result in judged(came, scenario)]
    assert verdicts == {0.0: ["passed", "passed", "failed"], 0.2: ["failed", "passed", "failed"]}
