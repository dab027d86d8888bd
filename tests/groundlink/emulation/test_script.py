# SPDX-License-Identifier: Apache-2.0
"""Scripts are played as written, and mistakes in them are told before anything starts."""

from pathlib import Path
from typing import Any

import msgspec
import pytest

from groundlink.emulation.script import LinkEvent, LinkScript, ScriptPlayer, changed, parse_changes
from groundlink.emulation.settings import Impairment
from groundlink.loader.document import ScenarioError
from groundlink.loader.scenario_files import SHIPPED, load

SCRIPT = LinkScript(
    to_ros=Impairment(delay_ms=10),
    events=(
        LinkEvent(at_s=20, to_ros={"loss": 0}, from_ros={"outage": True}),
        LinkEvent(at_s=10, to_ros={"loss": 0.3}),
        LinkEvent(at_s=22, from_ros={"outage": False}),
    ),
)


def test_events_change_only_what_they_name() -> None:
    script = ScriptPlayer(SCRIPT)
    for seconds, to_ros, from_ros in [
        (0, Impairment(delay_ms=10), Impairment()),
        (9.99, Impairment(delay_ms=10), Impairment()),
        (10, Impairment(delay_ms=10, loss=0.3), Impairment()),
        (21, Impairment(delay_ms=10), Impairment(outage=True)),
        (30, Impairment(delay_ms=10), Impairment()),
        (12, Impairment(delay_ms=10, loss=0.3), Impairment()),  # physics began anew
    ]:
        assert script.at(seconds) == {"to_ros": to_ros, "from_ros": from_ros}


def test_a_change_during_a_run_holds_until_an_event_names_its_field() -> None:
    script = ScriptPlayer(SCRIPT)
    script.at(1)
    script.change("to_ros", {"loss": 0.5, "jitter_ms": 2})
    assert script.at(9)["to_ros"] == Impairment(delay_ms=10, loss=0.5, jitter_ms=2)
    assert script.at(10)["to_ros"] == Impairment(delay_ms=10, loss=0.3, jitter_ms=2)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"los": 0.1}, ["unknown field `los`", "did you mean `loss`?"]),
        ({"loss": 1.5}, ["`loss`", "<= 1"]),
        ({"loss": True}, ["`loss`", "expected `float`"]),
        ({"outage": 0.5}, ["`outage`", "expected `bool`"]),
        ({"burst": 0.5}, ["burst 0 or at least 1"]),
        ({"burst": 2, "loss": 0.7}, ["loss 0.7", "burst / (1 + burst)"]),
        ({"delay_ms": float("nan")}, ["`delay_ms`"]),
        ({"rate_mbps": float("inf")}, ["`rate_mbps`"]),
    ],
)
def test_mistakes_give_one_line(changes: dict[str, Any], words: list[str]) -> None:
    with pytest.raises(ValueError, match=r"^[^\n]+$") as refused:
        changed(Impairment(), changes)
    for word in words:
        assert word in str(refused.value)
    with pytest.raises(ValueError, match=r"event at 3 s: from_ros: "):
        LinkScript(events=(LinkEvent(at_s=3, from_ros=changes),))


def test_a_direction_that_is_none() -> None:
    with pytest.raises(ValueError, match="unknown direction `back`; expected to_ros or from_ros"):
        ScriptPlayer(SCRIPT).change("back", {})


def test_a_script_travels() -> None:
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(SCRIPT), type=LinkScript) == SCRIPT


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        ("", {}),
        ("to_ros.loss=0.1", {"to_ros": {"loss": 0.1}}),
        (
            "to_ros.loss=0.1;from_ros.outage=true;to_ros.burst=3",
            {"to_ros": {"loss": 0.1, "burst": 3.0}, "from_ros": {"outage": True}},
        ),
        ("from_ros.outage=false", {"from_ros": {"outage": False}}),
    ],
)
def test_changes_as_text(text: str, changes: dict[str, Any]) -> None:
    assert parse_changes(text) == changes


@pytest.mark.parametrize("text", ["loss=1", "to_ros.loss", "to_ros.loss=", "to_ros.loss=nan", "x"])
def test_text_that_is_no_change(text: str) -> None:
    with pytest.raises(ValueError, match=r"^`[^\n]+$"):
        parse_changes(text)


@pytest.mark.parametrize(
    ("gateway", "words"),
    [
        ("link: {to_ros: {los: 0.1}}", ["unknown key `gateway.link.to_ros.los`", "`loss`?"]),
        ("link: {to_ros: {loss: 2}}", ["gateway.link.to_ros.loss", "<= 1"]),
        ("link: {to_ros: {loss: 0.9, burst: 2}}", ["gateway.link.to_ros", "burst / (1 + burst)"]),
        (
            "link: {events: [{at_s: 3, to_ros: {los: 1}}]}",
            ["event at 3 s: to_ros: unknown field `los`"],
        ),
        ("peers: [a b]", ["gateway.peers"]),
        ("key_file: a, key_env: b", ["keep one"]),
    ],
)
def test_a_scenarios_mistakes_have_their_place(
    tmp_path: Path, gateway: str, words: list[str]
) -> None:
    file = tmp_path / "lab.yaml"
    shipped = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file.write_text(f"{shipped}\ngateway: {{{gateway}}}\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"^[^\n]+$") as refused:
        load(file)
    for word in [*words, f"{file}:{shipped.count(chr(10)) + 2}:"]:
        assert word in str(refused.value)
