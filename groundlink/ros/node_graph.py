# SPDX-License-Identifier: Apache-2.0
"""Graph of ROS nodes that a run in lockstep waits for: which message answers which.

A node answers each message that it consumes, so a message of a sensor or of `/clock` causes a
known set of messages: its closure. The run publishes such a message only after the closure of the
one before is complete. All nodes then get their messages in one order, unless one message reaches a
node on two paths. Such a graph is refused, except where the node joins its inputs by their stamps.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from groundlink.scenario.ros_side import RosNode


class Answer(NamedTuple):
    """Messages on one topic that answer those on another."""

    topic: str
    of: str
    every: int
    """An answer to every n-th message."""

    is_joined: bool
    """An answer for each stamp; `every` is 1."""


def answers(nodes: Sequence[RosNode]) -> tuple[Answer, ...]:
    """Return what the nodes answer, without repetitions."""
    return tuple(
        dict.fromkeys(
            Answer(topic, of, node.every, node.joins)
            for node in nodes
            for topic in node.publishes
            for of in node.consumes
        )
    )


def graph_mistake(nodes: Sequence[RosNode], sources: Collection[str]) -> str:
    """Return the first mistake in a graph; empty for none.

    Parameters
    ----------
    sources
        topics that the gateway sends to ROS without a subscription.
    """
    return next(_mistakes(nodes, sources), "")


def origins(nodes: Sequence[RosNode], sources: Collection[str]) -> Mapping[str, frozenset[str]]:
    """Return the sources that cause each topic of a graph without loops, in order of causes."""
    known = {topic: frozenset({topic}) for topic in sources}
    left = [(topic, node.consumes) for node in nodes for topic in node.publishes]
    while ready := [(topic, of) for topic, of in left if known.keys() >= set(of)]:
        known |= {topic: frozenset().union(*(known[each] for each in of)) for topic, of in ready}
        left = [row for row in left if row not in ready]
    return known


def publishers(nodes: Sequence[RosNode]) -> Mapping[str, str]:
    """Return the name of the node that publishes each topic, in order of causes."""
    names = {topic: node.name for node in nodes for topic in node.publishes}
    sources = {topic for node in nodes for topic in node.consumes} - names.keys()
    return {topic: names[topic] for topic in origins(nodes, sources) if topic in names}


def _mistakes(nodes: Sequence[RosNode], sources: Collection[str]) -> Iterator[str]:
    published = Counter(topic for node in nodes for topic in node.publishes)
    for node in nodes:
        for topic in node.publishes:
            if topic in sources:
                yield f"node `{node.name}` publishes {topic}, which the gateway sends to ROS"
            if published[topic] > 1:
                yield f"{topic} is published by several nodes or rules; expected one"
        for topic in node.consumes:
            if topic not in sources and topic not in published:
                yield (
                    f"node `{node.name}` consumes {topic}, which no node publishes and which does "
                    f"not go to ROS unasked; expected one of {', '.join(sorted(sources))}"
                )
    known = origins(nodes, sources)
    if loop := sorted(published.keys() - known.keys()):
        yield (
            f"{', '.join(loop)} form a loop that no message of a sensor or of /clock ends. Fix: "
            "leave out of `consumes` what a node only stores"
        )
        return
    for name in dict.fromkeys(node.name for node in nodes):
        rules = [node for node in nodes if node.name == name]
        if len(rules) == 1 and rules[0].joins:
            continue
        inputs = list(dict.fromkeys(topic for rule in rules for topic in rule.consumes))
        for number, first in enumerate(inputs):
            for second in inputs[number + 1 :]:
                if common := sorted(known[first] & known[second]):
                    yield (
                        f"node `{name}` consumes {first} and {second}, both caused by {common[0]}, "
                        "in either order. Fix: `joins: true` if the node joins them by their "
                        "stamps, or leave out of `consumes` what the node only stores"
                    )
