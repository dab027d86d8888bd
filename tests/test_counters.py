# SPDX-License-Identifier: Apache-2.0
"""The page of counters has the names that processes count, and no others."""

import ast
import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import pytest

from groundlink.emulation.model import NOTES, OUTCOMES
from groundlink.episode.fault_messages import COUNTER_PREFIX as FAULT
from groundlink.messages.missing_readings import CAUSES, counters_of
from groundlink.messages.stalls import Stalls
from services.gateway.carrier import WIRE_COUNTERS
from services.gateway.missing_readings import COUNTER_PREFIX as NOT_COME
from services.gateway.reports import peer_counters
from udp_bridge.wire.control import LinkReport

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "reference" / "counters.md").read_text(encoding="utf-8")
KEPT_IN = ("counts", "_counts", "counters")
"""Attributes that hold counts by name."""


def section(title: str) -> str:
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def documented(text: str) -> set[str]:
    """Return the names in the first columns of all tables."""
    cells = re.findall(r"^\| (`.*?`) \|", text, re.MULTILINE)
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def keys(node: ast.AST) -> Iterator[str]:
    """Yield the texts that are keys of the dictionaries that an expression makes."""
    for inner in ast.walk(node):
        found: Sequence[ast.expr | None] = ()
        if isinstance(inner, ast.Dict):
            found = inner.keys
        elif isinstance(inner, ast.Call) and ast.unparse(inner.func) == "dict.fromkeys":
            found = inner.args[0].elts if isinstance(inner.args[0], ast.Tuple) else ()
        yield from (str(k.value) for k in found if isinstance(k, ast.Constant) and k.value)


def counted(*folders: str) -> set[str]:
    """Return the names that processes count in the sources of some folders."""
    names: set[str] = set()
    for file in (file for folder in folders for file in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and node.name in ("counters", "_beat"):
                names |= set(keys(node))
            elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                target = node.targets[0] if isinstance(node, ast.Assign) else node.target
                if isinstance(target, ast.Attribute) and target.attr in KEPT_IN:
                    names |= set(keys(node.value))
    return names


def of_physics() -> set[str]:
    stalls = Stalls(("<process>",), {"<process>": 1.0}, {"<process>": 1.0}, 1.0)
    return counted("services/physics") | stalls.counters().keys()


def of_sensors() -> set[str]:
    return counted("services/sensors") | set(CAUSES) | {"gap_<cause>", f"{FAULT}<kind>"}


def of_gateway() -> set[str]:
    report = LinkReport(0, 0, 0, 1, 0, (("<reason>", 1),))
    wire = {f"wire_{name}" for name in (*WIRE_COUNTERS, "refused_<reason>")}
    link = {"datagrams", "duplicated", *OUTCOMES, *NOTES, "waiting"}
    ways = {"to_ros", "from_ros"}
    counts = counted("services/gateway") - (ways - {"from_ros"})
    return counts | peer_counters(report).keys() | wire | link | {f"{NOT_COME}<topic>"}


NAMES: dict[str, Callable[[], set[str]]] = {
    "Physics": of_physics,
    "Sensors": of_sensors,
    "Gateway": of_gateway,
    "Recorder": partial(counted, "services/recorder"),
    "Driver": partial(counted, "services/driver"),
    "Replay": partial(counted, "services/replay"),
    "Viewer": partial(counted, "services/view"),
}


@pytest.mark.parametrize("title", NAMES)
def test_a_process_counts_what_its_section_says(title: str) -> None:
    assert documented(section(title)) == NAMES[title]()


def test_no_other_process_counts() -> None:
    assert counted("services/link", "services/router", "groundlink/process") == set()
    assert counters_of({"off": 1}) == {"gap_off": 1}


def test_causes_of_missing_readings_are_those_of_the_code() -> None:
    rows = dict(re.findall(r"^\| `([^`]+)` \| (.*) \|$", section("Sensors"), re.MULTILINE))
    assert {cause: rows[cause] for cause in CAUSES} == CAUSES
