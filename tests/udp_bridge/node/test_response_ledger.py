# SPDX-License-Identifier: Apache-2.0
"""The ledger of responses against graphs of nodes that are drawn at random."""

import random
from collections import deque
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from udp_bridge.node.response_ledger import STAMPS_MAX, ResponseLedger
from udp_bridge.wire.lockstep import JOINED, ExpectedResponse

SOURCES = 2


@st.composite
def graphs(draw: st.DrawFn) -> list[ExpectedResponse]:
    """Topics /0, /1... of which the first are sources, and each later one responds to earlier."""
    responses = []
    for number in range(SOURCES, draw(st.integers(SOURCES + 1, 7))):
        is_joined = draw(st.booleans())
        # As in a graph that is accepted, a joined node gets one message of a stamp from each cause.
        before = st.integers(0, (SOURCES if is_joined else number) - 1)
        for cause in draw(st.sets(before, min_size=1, max_size=3)):
            every = JOINED if is_joined else draw(st.integers(0, 3))
            responses.append(ExpectedResponse(f"/{number}", f"/{cause}", 0, every))
    return responses


class Nodes:
    """What a graph of nodes publishes, by the rules of users rather than by a ledger."""

    def __init__(self, responses: Sequence[ExpectedResponse]) -> None:
        self._responses = responses
        self._inputs: dict[ExpectedResponse, int] = {}
        self._stamps: dict[str, dict[int, set[str]]] = {}

    def outputs(self, topic: str, stamp: int) -> list[tuple[str, int]]:
        """Return messages that follow directly from one."""
        return [
            (each.topic, stamp)
            for each in self._responses
            if each.of == topic and self._responds(each, stamp)
        ]

    def _responds(self, response: ExpectedResponse, stamp: int) -> bool:
        if response.every == JOINED:
            seen = self._stamps.setdefault(response.topic, {}).setdefault(stamp, set())
            is_new = response.of not in seen
            seen.add(response.of)
            needed = {each.of for each in self._responses if each.topic == response.topic}
            return is_new and seen == needed
        self._inputs[response] = self._inputs.get(response, 0) + 1
        return self._inputs[response] % max(response.every, 1) == 0


@given(
    graphs(),
    st.lists(st.tuples(st.sampled_from(["/0", "/1"]), st.integers(0, 5)), unique=True),
    st.randoms(),
)
def test_nothing_is_owed_exactly_when_all_has_come_in_any_order(
    graph: list[ExpectedResponse], published: list[tuple[str, int]], order: random.Random
) -> None:
    ledger, nodes = ResponseLedger(graph), Nodes(graph)
    for message in published:
        ledger.published(*message)
        outputs, causes = [], deque([message])
        while causes:
            found = nodes.outputs(*causes.popleft())
            outputs += found
            causes += found
        order.shuffle(outputs)
        for output in outputs:
            assert ledger.owing()
            ledger.received(*output)
        assert not ledger.owing()
        assert not ledger.settle()


@given(
    graphs(),
    st.lists(st.tuples(st.integers(0, 6), st.integers(0, 5)), max_size=12, unique=True),
    st.randoms(),
)
def test_nothing_is_owed_for_good_whatever_a_timer_publishes(
    graph: list[ExpectedResponse], roots: list[tuple[int, int]], order: random.Random
) -> None:
    """Any delay between processes: an answer may come many barriers before its cause."""
    ledger, nodes = ResponseLedger(graph), Nodes(graph)
    on_the_way: list[tuple[str, int]] = []

    def publish(topic: str, stamp: int) -> None:
        for output in nodes.outputs(topic, stamp):
            on_the_way.append(output)
            publish(*output)

    def receive() -> None:
        ledger.received(*on_the_way.pop(order.randrange(len(on_the_way))))

    topics = {response.topic for response in graph}
    for number, stamp in roots:
        if (topic := f"/{number}") in topics:  # of a timer
            on_the_way.append((topic, stamp))
        else:
            while ledger.owing():
                receive()
            ledger.settle()
            ledger.published(topic, stamp)
        publish(topic, stamp)
        for _ in range(order.randint(0, len(on_the_way))):
            receive()
            if not ledger.owing() and order.random() < 0.5:
                ledger.settle()
    while on_the_way:
        receive()
    assert not ledger.owing()


def test_every_nth_message_and_stamps_of_several_causes() -> None:
    ledger = ResponseLedger(
        [
            ExpectedResponse("/map", "/scan", 0, 2),
            ExpectedResponse("/pose", "/map", 0, JOINED),
            ExpectedResponse("/pose", "/odom", 0, JOINED),
        ]
    )
    owed, is_worked_on = [], []
    for topic, stamp in [("/odom", 1), ("/scan", 1), ("/odom", 2), ("/scan", 2)]:
        is_worked_on.append(ledger.published(topic, stamp))
        owed.append(ledger.owing())
    assert owed == ["", "", "", "/map"]
    assert is_worked_on == [False, True, False, True], "a scan that is counted may change /map"
    ledger.received("/map", 2)
    assert ledger.owing() == "/pose"
    ledger.received("/pose", 2)
    assert not ledger.owing()


def test_messages_without_a_stamp_are_joined_by_their_number() -> None:
    ledger = ResponseLedger(
        [ExpectedResponse("/c", "/a", 0, JOINED), ExpectedResponse("/c", "/b", 0, JOINED)]
    )
    for topic, owing in [("/a", ""), ("/a", ""), ("/b", "/c"), ("/b", "/c")]:
        assert ledger.published(topic) == bool(owing)
        assert ledger.owing() == owing
    for owing in ("/c", ""):
        ledger.received("/c")
        assert ledger.owing() == owing


def test_a_surplus_is_told_and_a_publisher_that_left_owes_nothing() -> None:
    ledger = ResponseLedger([ExpectedResponse("/b", "/a", 0, 2), ExpectedResponse("/c", "/b")])
    ledger.received("/b")
    assert not ledger.owing(), "nothing was published yet"
    ledger.published("/elsewhere")
    ledger.received("/b")
    assert (ledger.owing(), ledger.caused({"/a"})) == ("/c", {"/a", "/b", "/c"})
    ledger.received("/c")
    ledger.received("/not/of/the/graph")
    assert ledger.settle() == [("/b", 2)]
    assert ledger.settle() == []
    ledger.published("/a")
    ledger.forgive("/b")
    ledger.published("/a")
    assert not ledger.owing(), "its successor counts anew"


def test_a_publisher_that_had_counted_before_is_followed() -> None:
    ledger = ResponseLedger([ExpectedResponse("/b", "/a", 0, 3)])
    ledger.published("/a")
    ledger.received("/b")
    assert ledger.settle() == [("/b", 1)]
    for owing in ("", "", "/b"):
        ledger.published("/a")
        assert ledger.owing() == owing


def test_stamps_that_one_cause_never_gets_are_forgotten() -> None:
    ledger = ResponseLedger(
        [ExpectedResponse("/c", "/a", 0, JOINED), ExpectedResponse("/c", "/b", 0, JOINED)]
    )
    for stamp in range(STAMPS_MAX + 1):
        ledger.published("/a", stamp)
    ledger.published("/b", 0)
    assert not ledger.owing()
    ledger.published("/b", STAMPS_MAX)
    assert ledger.owing() == "/c"
