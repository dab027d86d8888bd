# SPDX-License-Identifier: Apache-2.0
"""Comparison of two runs in lockstep by the traces of their ROS nodes.

A trace has each message that ROS got and published, with the tick of the barrier to which it
belongs (`udp_bridge.node.lockstep_trace`). Messages of a topic are compared in their order; bodies
from ROS by their values, since DDS leaves padding undefined.
"""

import base64
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct

from groundlink.core.clock import NANOS

from .differences import Difference, value_difference


class TracedMessage(Struct):
    """A line of a trace."""

    direction: Literal["to_ros", "from_ros"]
    tick: int
    topic: str
    stamp_nanos: int | None
    """None for a message without a header."""

    sha256: str
    type: str = ""
    """ROS type of a message from ROS; empty for a message to ROS."""

    body: str = ""
    """Body of a message from ROS, in base64."""

    turn: int = 0
    """Messages to ROS at this tick so far. Answers have the turn of their cause."""


class TraceDifference(Struct, frozen=True):
    """The first difference of a topic."""

    tick: int
    turn: int
    stamp_nanos: int | None
    number: int
    """Number of the message within its topic, from 1."""

    words: str
    """What differs, as text."""


class TracedTopic(Struct, frozen=True):
    """Result of the comparison of one topic."""

    topic: str
    node: str | None
    """Node of the scenario that publishes it."""

    first_run: int
    """Messages in the first run."""

    second_run: int
    equal: int
    """Messages that are equal, up to the first difference."""

    difference: TraceDifference | None


def read_trace(path: Path, end_tick: int) -> dict[str, list[TracedMessage]]:
    """Return the messages of each topic before a tick."""
    found: dict[str, list[TracedMessage]] = defaultdict(list)
    decoder = msgspec.json.Decoder(TracedMessage)
    tick, turn = -1, 0
    whole, _, _ = path.read_bytes().rpartition(b"\n")  # a killed node leaves half a line
    for line in whole.splitlines():
        message = decoder.decode(line)
        if message.tick != tick:
            tick, turn = message.tick, 0
        turn += message.direction == "to_ros"
        message.turn = turn
        if 0 <= tick < end_tick:
            found[message.topic].append(message)
    return found


def compare_traces(
    first: Mapping[str, Sequence[TracedMessage]],
    second: Mapping[str, Sequence[TracedMessage]],
    nodes: Mapping[str, str],
) -> list[TracedTopic]:
    """Compare two runs, topic by topic.

    Parameters
    ----------
    nodes
        names of nodes by the topics that they publish, causes before effects.

    Returns
    -------
    Topics with a difference in order of their first one, causes before effects, then the others by
    name.
    """
    rank = {topic: number for number, topic in enumerate(nodes)}

    def key(row: TracedTopic) -> tuple[bool, int, int, int, str]:
        found = row.difference
        place = (found.tick, found.turn, rank.get(row.topic, -1)) if found else (0, 0, 0)
        return found is None, *place, row.topic

    rows = (
        _compared(topic, nodes.get(topic), first.get(topic, ()), second.get(topic, ()))
        for topic in {*first, *second}
    )
    return sorted(rows, key=key)


def _compared(
    topic: str, node: str | None, first: Sequence[TracedMessage], second: Sequence[TracedMessage]
) -> TracedTopic:
    equal, difference = 0, None
    for one, other in zip_longest(first, second):
        if difference := _difference(one, other, equal + 1):
            break
        equal += 1
    return TracedTopic(topic, node, len(first), len(second), equal, difference)


def _difference(
    first: TracedMessage | None, second: TracedMessage | None, number: int
) -> TraceDifference | None:
    either = first or second
    assert either
    if first is None or second is None:
        run = "first" if second is None else "second"
        words = f"a message in the {run} run only"
    elif (first.tick, first.stamp_nanos) != (second.tick, second.stamp_nanos):
        words = f"{_place(first)} in the first run, {_place(second)} in the second"
        either = min(first, second, key=lambda message: (message.tick, message.turn))
    elif found := _values(first, second):
        place = f"{found.field}: " if found.field else ""
        words = f"{place}{found.recorded} in the first run, {found.repeated} in the second"
    else:
        return None
    return TraceDifference(either.tick, either.turn, either.stamp_nanos, number, words)


def _values(first: TracedMessage, second: TracedMessage) -> Difference | None:
    if first.sha256 == second.sha256:
        return None
    if first.type != second.type:
        return Difference("type", first.type, second.type)
    if not first.body:
        return Difference("body", first.sha256[:8], second.sha256[:8])
    bodies = [base64.b64decode(message.body) for message in (first, second)]
    return value_difference(first.type, *bodies)


def _place(message: TracedMessage) -> str:
    stamp = message.stamp_nanos
    known = "" if stamp is None else f", stamp {stamp // NANOS}.{stamp % NANOS:09d}"
    return f"tick {message.tick}{known}"
