# SPDX-License-Identifier: Apache-2.0
"""What a recording says about its run: the scenario, the versions, and what each topic holds.

Rule: one MCAP metadata record for the run, written first, and one for its topics, which is there
anew with every commit. Values are text; what has structure is JSON. The run's journal is attached,
part after part; one more record says where a recording ends to which everybody has come, and one
how many messages of each topic came faster than they could be written.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version

import msgspec

from groundlink import __version__
from groundlink.scenario import Scenario
from groundlink.world.build import world_hash

RUN_RECORD = "groundlink.run"
TOPICS_RECORD = "groundlink.topics"
END_RECORD = "groundlink.end"
DROPPED_RECORD = "groundlink.dropped"
JOURNAL_ATTACHMENT = "groundlink.journal"

_PACKAGES = ("eclipse-zenoh", "mcap", "msgspec", "numpy", "pybullet", "embreex", "rosbags")


class RunFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The run that a file holds."""

    run: str
    scenario: Scenario
    """Resolved: nothing else is needed to build its world."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    world_hash: str
    versions: dict[str, str]
    """Of Groundlink, Python and the packages, as the recorder had them."""


class TopicFacts(msgspec.Struct, frozen=True, kw_only=True):
    """What a file holds of one topic."""

    type: str
    messages: int
    first_nanos: int
    last_nanos: int
    declared_hz: float | None = None

    @property
    def measured_hz(self) -> float | None:
        """Counted in stamps, from the first to the last."""
        span = self.last_nanos - self.first_nanos
        return (self.messages - 1) * 1e9 / span if span > 0 else None


def facts(scenario: Scenario, run: str, epoch_nanos: int) -> RunFacts:
    """Return what is known of a run when its recording begins."""
    return RunFacts(
        run=run,
        scenario=scenario,
        epoch_nanos=epoch_nanos,
        world_hash=world_hash(scenario),
        versions=versions(),
    )


def versions() -> dict[str, str]:
    """Return the versions of what is installed here."""
    found = {"groundlink": __version__, "python": platform.python_version()}
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

    Raises
    ------
    msgspec.MsgspecError
        when it does not hold them.
    """
    plain: dict[str, object] = dict(entries)
    for name in ("scenario", "versions"):
        plain[name] = msgspec.json.decode(entries.get(name, ""))
    return msgspec.convert(plain, RunFacts, strict=False)


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
