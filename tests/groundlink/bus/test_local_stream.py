# SPDX-License-Identifier: Apache-2.0
"""Local streams: nothing is lost or repeated when messages change their way."""

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from groundlink.bus.channel import WAKE_SECONDS
from groundlink.bus.local_stream import ROUTER_WAIT_SECONDS, LocalSource, LocalStream
from groundlink.bus.shared_slots import MOST_SLOTS
from groundlink.messages.base import LARGE_BYTES


class Routed:
    """Messages that the router delivers when the test says so."""

    def __init__(self) -> None:
        self.come: deque[bytes] = deque()
        self.is_declared = True

    def receive(self) -> bytes:
        return self.poll() or b""

    def poll(self) -> bytes | None:
        return self.come.popleft() if self.come else None

    def undeclare(self) -> None:
        self.is_declared = False


class Subscriber:
    """A source with all that it has subscribed to by the router."""

    def __init__(self) -> None:
        self.routed: list[Routed] = []
        self.source = LocalSource(self._declare)

    def _declare(self) -> Routed:
        self.routed.append(Routed())
        return self.routed[-1]

    def undeclare(self) -> None:
        self.source.undeclare()

    def take(self) -> list[bytes]:
        """Return what has come."""
        found = []
        while (payload := self.source.poll()) is not None:
            found.append(payload)
        return found


Make = Callable[[type], Any]


@pytest.fixture
def make() -> Iterator[Make]:
    """Return a factory of streams and subscribers, which are closed after the test."""
    made: list[Any] = []

    def one(kind: type) -> Any:
        made.append(kind())
        return made[-1]

    yield one
    for each in made:
        each.undeclare()


def numbers(first: int, last: int) -> list[bytes]:
    return [b"%d" % number for number in range(first, last + 1)]


def join(stream: LocalStream, subscriber: Subscriber) -> None:
    """Send 0 both ways, so that the subscriber changes to the socket."""
    subscriber.source.found(stream.name)
    stream.send(b"0")
    subscriber.routed[-1].come.append(b"0")
    assert subscriber.take() == [b"0"]
    assert not subscriber.routed[-1].is_declared


@pytest.mark.parametrize("late", [0, 1, 5])
def test_the_change_to_the_socket_loses_and_repeats_nothing(make: Make, late: int) -> None:
    """The router is some messages late; the first three are from before the connection."""
    stream, subscriber = make(LocalStream), make(Subscriber)
    sent, taken = numbers(0, 19), []
    for number, payload in enumerate(sent):
        if number == 3:
            subscriber.source.found(stream.name)
        stream.send(payload)
        if number >= late and subscriber.routed[0].is_declared:
            subscriber.routed[0].come.append(sent[number - late])
        taken += subscriber.take()
    assert taken == sent
    assert not subscriber.routed[0].is_declared
    assert len(subscriber.routed) == 1


def test_without_a_local_publisher_all_comes_by_the_router(make: Make) -> None:
    subscriber = make(Subscriber)
    subscriber.source.found("nobody")
    subscriber.routed[0].come.extend(numbers(0, 9))
    assert subscriber.take() == numbers(0, 9)
    assert subscriber.routed[0].is_declared


def test_when_a_publisher_ends_the_router_takes_over_until_the_next_one(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    stream.send(b"1")
    stream.undeclare()
    assert subscriber.take() == [b"1"]
    assert [routed.is_declared for routed in subscriber.routed] == [False, True]
    subscriber.routed[-1].come.append(b"2")
    assert subscriber.take() == [b"2"]
    join(make(LocalStream), subscriber)


def test_a_publisher_that_ends_before_the_change_is_forgotten(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    subscriber.source.found(stream.name)
    stream.send(b"1")
    stream.undeclare()
    subscriber.routed[0].come.extend([b"1", b"2"])
    assert subscriber.take() == [b"1", b"2"]


def test_a_slow_receiver_gets_all_and_the_sender_does_not_wait(make: Make) -> None:
    stream, slow, quick = make(LocalStream), make(Subscriber), make(Subscriber)
    join(stream, slow)
    quick.source.found(stream.name)
    stream.send(b"1")
    quick.routed[0].come.append(b"1")
    assert quick.take() == [b"1"]
    sent = [payload.rjust(1000) for payload in numbers(2, 1000)]
    for payload in sent:  # more than fits into a socket
        stream.send(payload)
        assert quick.take() == [payload]
    found: list[bytes] = []
    deadline = time.monotonic() + 20
    while len(found) < 1 + len(sent) and time.monotonic() < deadline:
        found += filter(None, [slow.source.receive()])
    assert found == [b"1", *sent]


def test_waiting_ends_without_messages(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    begun = time.monotonic()
    assert subscriber.source.receive() == b""
    assert time.monotonic() - begun > 0.5 * WAKE_SECONDS


def test_a_receiver_that_has_gone_is_forgotten(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    subscriber.source.undeclare()
    for payload in numbers(1, 3):
        stream.send(payload)
    assert not stream._receivers


def large(number: int) -> bytes:
    return bytes([number]) * (LARGE_BYTES + 1)


def test_large_and_small_messages_keep_their_order(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    sent = [large(1), b"2", large(3), large(4), b"5"]
    for payload in sent:
        stream.send(payload[:1], memoryview(payload)[1:])
    assert subscriber.take() == sent


def test_the_change_to_the_socket_finds_large_messages(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    subscriber.source.found(stream.name)
    for number in range(10):
        stream.send(large(number))
    subscriber.routed[0].come.extend([large(0), large(1)])
    assert subscriber.take() == [large(number) for number in range(10)]
    assert not subscriber.routed[0].is_declared


def test_a_receiver_that_is_stopped_is_left_to_the_router(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("groundlink.bus.local_stream.ROUTER_WAIT_SECONDS", 0.01)
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    for number in range(MOST_SLOTS + 2):
        stream.send(large(number))
    assert not stream._receivers
    assert subscriber.take() == [large(number) for number in range(MOST_SLOTS)]
    assert subscriber.routed[-1].is_declared


def test_the_end_of_a_receiver_ends_the_wait_for_its_slots(make: Make) -> None:
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    ending = threading.Timer(0.05, subscriber.source.undeclare)
    ending.start()
    begun = time.monotonic()
    for number in range(MOST_SLOTS + 1):
        stream.send(large(number))
    ending.join()
    assert not stream._receivers
    assert time.monotonic() - begun < ROUTER_WAIT_SECONDS


def test_without_memory_for_slots_the_router_takes_over(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> int:
        raise OSError

    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    monkeypatch.setattr(os, "memfd_create", fail)
    stream.send(large(1))
    assert subscriber.take() == []
    assert subscriber.routed[-1].is_declared


def test_who_is_cut_off_from_the_router_gets_nothing_until_both_are_back(make: Make) -> None:
    """Otherwise a sensor would publish readings that nobody receives and none reports missing."""
    stream, subscriber = make(LocalStream), make(Subscriber)
    join(stream, subscriber)
    subscriber.source.cut_off()
    for payload in numbers(1, 3):
        stream.send(payload)
    assert subscriber.take() == []
    assert [routed.is_declared for routed in subscriber.routed] == [False, True]
    subscriber.routed[-1].come.append(b"4")
    assert subscriber.take() == [b"4"]
    join(stream, subscriber)
    stream.send(b"5")
    assert subscriber.take() == [b"5"]
