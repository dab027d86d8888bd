# SPDX-License-Identifier: Apache-2.0
"""Metadata of a recording: the scenario, the versions, and statistics of each topic.

The record of the run is written first; the record of the topics is written with every commit.
Values are text, structured values are JSON. The journal of the run is attached in parts. Two more
records hold the time up to which the recording is complete, and the messages dropped by the
recorder.
"""

import platform
import re
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import msgspec
from msgspec.structs import replace

from groundlink.core import VERSION
from groundlink.scenario import Scenario
from groundlink.scenario.decoding import put_unknown, take_unknown
from groundlink.scene.build import world_hash

RUN_RECORD = "groundlink.run"
TOPICS_RECORD = "groundlink.topics"
END_RECORD = "groundlink.end"
DROPPED_RECORD = "groundlink.dropped"
JOURNAL_ATTACHMENT = "groundlink.journal"
CHECKPOINT_ATTACHMENT = "groundlink.checkpoint"

_UNKNOWN = re.compile(
    r"Object contains unknown field `(?P<field>[^`]+)`(?: - at `\$(?P<path>(?:\.\w+|\[\d+\])*)`)?"
)
"""msgspec's error for an unknown field with its path."""

_PACKAGES = ("eclipse-zenoh", "mcap", "msgspec", "numpy", "pybullet", "embreex", "rosbags")


class RunFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Facts about the recorded run."""

    run: str
    scenario: Scenario
    """Resolved scenario, sufficient to build the world."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    world_hash: str
    versions: dict[str, str]
    """Versions of Groundlink, Python and packages of the recorder."""


class TopicFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Statistics of one recorded topic."""

    type: str
    messages: int
    first_nanos: int
    last_nanos: int
    declared_hz: float | None = None

    @property
    def measured_hz(self) -> float | None:
        """Rate by stamps, from the first message to the last."""
        span = self.last_nanos - self.first_nanos
        return (self.messages - 1) * 1e9 / span if span > 0 else None


def describe_run(scenario: Scenario, run: str, epoch_nanos: int) -> RunFacts:
    """Return the facts of a run for the begin of its recording."""
    return RunFacts(
        run=run,
        scenario=scenario,
        epoch_nanos=epoch_nanos,
        world_hash=world_hash(scenario),
        versions=versions(),
    )


def versions() -> dict[str, str]:
    """Return the versions of the installed software."""
    found = {"groundlink": VERSION, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def run_entries(run: RunFacts) -> dict[str, str]:
    """Return a run's facts as the entries of a metadata record."""
    return {name: _text(value) for name, value in msgspec.to_builtins(run).items()}


def run_facts(entries: Mapping[str, str]) -> RunFacts:
    """Return the facts that a metadata record holds.

    Unknown scenario fields, written by another version, are dropped.

    Raises
    ------
    msgspec.MsgspecError
        when the record is invalid.
    """
    plain: dict[str, Any] = dict(entries)
    for name in ("scenario", "versions"):
        plain[name] = msgspec.json.decode(entries.get(name, ""))
    unknown = take_unknown(plain["scenario"])
    while True:
        try:
            facts = msgspec.convert(plain, RunFacts, strict=False)
            return replace(facts, scenario=put_unknown(facts.scenario, unknown))
        except msgspec.ValidationError as error:
            if not _drop_unknown(plain, str(error)):
                raise


def _drop_unknown(plain: dict[str, Any], error: str) -> bool:
    """Delete an unknown field; return False for any other error."""
    found = _UNKNOWN.fullmatch(error)
    if found is None:
        return False
    holder: Any = plain
    for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", found["path"] or ""):
        holder = holder[name] if name else holder[int(index)]
    del holder[found["field"]]
    return True


def topic_entries(topics: Mapping[str, TopicFacts]) -> dict[str, str]:
    """Return the facts of topics, by name, as the entries of a metadata record."""
    return {name: msgspec.json.encode(topic).decode() for name, topic in topics.items()}


def topic_facts(entries: Mapping[str, str]) -> dict[str, TopicFacts]:
    """Return the facts of topics that a metadata record holds, by name."""
    return {
        name: msgspec.json.decode(text, type=TopicFacts) for name, text in sorted(entries.items())
    }


def _text(value: object) -> str:
    return value if isinstance(value, str) else msgspec.json.encode(value).decode()
