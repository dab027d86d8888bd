# SPDX-License-Identifier: Apache-2.0
"""Stalled steps: each stalling process is named once. Answers of a run, as text and JSON."""

import json
from typing import Any

import pytest

from groundlink.cli.run import fault, spawn
from groundlink.cli.run.control import StallReporter, print_status
from groundlink.episode.control import ControlAnswer
from groundlink.episode.fault_messages import FaultAnswer
from groundlink.messages.base import Health, encode
from groundlink.messages.stalls import Stalls
from groundlink.scenario.faults import Bias


class Bus:
    """A bus on which physics says who is silent."""

    def subscribe(self, key: str, message: type[Health], inbox: Any) -> None:
        self._inbox, self._key = inbox, key

    def silent(self, *names: str) -> None:
        counters = Stalls(silent_now=names).counters()
        self._inbox.put(self._key, encode(Health("physics", 1, 12, counters)), Health)


def test_who_holds_up_steps_is_said_once() -> None:
    bus: Any = Bus()
    waits = StallReporter(bus, "lab")
    assert waits.line(12) == ""
    bus.silent("rover/lidar")
    assert waits.line(12) == "run `lab`: waiting at tick 12 for rover/lidar"
    bus.silent("rover/lidar")
    assert waits.line(12) == ""
    bus.silent("rover/lidar", "rover/imu")
    assert waits.line(12) == "run `lab`: waiting at tick 12 for rover/lidar, rover/imu"
    bus.silent()
    assert waits.line(13) == ""


def test_answers_of_a_run_are_text_or_json(capsys: pytest.CaptureFixture[str]) -> None:
    answer = ControlAnswer("", tick=399, paused=True)
    biased = FaultAnswer(tick=400, active=(Bias(value=0.5),))

    def printed(*, as_json: bool) -> str:
        print_status("lab", answer, as_json=as_json)
        spawn._print_change("lab", "added", "box", answer, as_json=as_json)
        answers = {"rover/imu": biased, "rover/lidar": FaultAnswer(tick=400), "rover/gnss": None}
        fault._print_answers("lab", answers, as_json=as_json)
        return capsys.readouterr().out

    assert printed(as_json=False).splitlines() == [
        "run `lab` is paused at tick 399 (0.9975 s)",
        "run `lab`: added `box` at tick 400 (1.0000 s)",
        "rover/imu, from tick 400 (1.0000 s):",
        f"  {biased.active[0]}",
        "rover/lidar, from tick 400 (1.0000 s): no fault",
        "rover/gnss: does not respond",
    ]
    status, change, faults = _json_values(printed(as_json=True))
    assert status == {"run": "lab", "tick": 399, "sim_seconds": 0.9975, "paused": True}
    assert change == {"run": "lab", "tick": 400, "sim_seconds": 1.0, "added": "box"}
    assert [(told["sensor"], told["active"] and len(told["active"])) for told in faults] == [
        ("rover/imu", 1),
        ("rover/lidar", []),
        ("rover/gnss", None),
    ]
    assert faults[0]["active"][0]["kind"] == "bias"
    assert faults[0]["active"][0]["value"] == 0.5


def _json_values(text: str) -> list[Any]:
    values = []
    while text := text.strip():
        value, end = json.JSONDecoder().raw_decode(text)
        values.append(value)
        text = text[end:]
    return values
