# SPDX-License-Identifier: Apache-2.0
"""Scenarios of machines that have sensor kinds which this one lacks."""

from typing import Any

import msgspec
import pytest

from groundlink.bus.topics import process_names, sensor_outputs
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.scenario.decoding import decode_scenario, missing_kinds
from groundlink.scenario.every_sensor import UnknownSensor
from groundlink.scenario.sensor_kinds import kind_of

LAB = load("indoor_lab")
SONAR = {
    "kind": "sonar",
    "name": "bow",
    "topic": "/sonar",
    "frame": "bow",
    "package": "sonar-sensor",
    "rate_hz": 5.0,
    "pings": 3,
}


def plain(scenario: Any) -> Any:
    return msgspec.msgpack.decode(msgspec.msgpack.encode(scenario))


def with_sonar() -> Any:
    lab = plain(LAB)
    lab["vehicles"][0]["sensors"].insert(1, SONAR)
    return lab


def test_a_scenario_of_known_kinds_is_what_it_was() -> None:
    assert decode_scenario(msgspec.msgpack.encode(LAB)) == LAB


def test_a_sensor_of_an_unknown_kind_keeps_its_place() -> None:
    found = decode_scenario(msgspec.msgpack.encode(with_sonar()))
    names = LAB.sensor_names()
    assert found.sensor_names() == [names[0], "rover/bow", *names[1:]]
    sonar = found.vehicles[0].sensors[1]
    assert isinstance(sonar, UnknownSensor)
    assert sonar.message_rate_hz == 5.0
    assert sensor_outputs(sonar) == []
    assert process_names(found)["rover/bow"] == ""
    line = "sensor `bow`: the kind `sonar` is not installed here. Fix: pip install sonar-sensor"
    assert missing_kinds(found) == [line]
    with pytest.raises(UserError, match="pip install sonar-sensor"):
        kind_of(sonar)


def test_it_travels_on_as_it_came() -> None:
    once = decode_scenario(msgspec.msgpack.encode(with_sonar()))
    assert decode_scenario(msgspec.msgpack.encode(once)) == once
    sonar = once.vehicles[0].sensors[1]
    assert isinstance(sonar, UnknownSensor)
    assert sonar.fields == SONAR


def test_another_mistake_is_one_still() -> None:
    wrong = with_sonar()
    wrong["vehicles"][0]["sensors"][0]["topic"] = 3
    with pytest.raises(msgspec.ValidationError, match="topic"):
        decode_scenario(msgspec.msgpack.encode(wrong))
