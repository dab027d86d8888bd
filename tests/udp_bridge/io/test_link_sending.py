# SPDX-License-Identifier: Apache-2.0
"""Who sends when: nothing that waits is forgotten, whichever thread was sending."""

import threading
import time
from collections.abc import Iterator, Sequence

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import Link, parse
from udp_bridge.sender import flow_control
from udp_bridge.sender.repair import Resend
from udp_bridge.sender.send_queue import OutgoingBatch
from udp_bridge.wire.fragments import datagram_of
from udp_bridge.wire.header import Buffer, Header
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.types import RESEND

TO = ("127.0.0.1", 9)
TIMEOUT_S = 10.0


class Wire:
    """A socket that notes what is sent; nobody ever answers."""

    address: Address = ("127.0.0.1", 1)
    receive_buffer = 8 << 20
    overhead = 0
    kernel_drops = 0
    unreachable = 0

    def __init__(self) -> None:
        self.headers: list[Header] = []
        self.threads: list[str] = []
        self.may_send = threading.Event()
        self.is_sending = threading.Event()
        self.may_send.set()
        self.error: Exception | None = None
        self._is_shut = threading.Event()

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        self.is_sending.set()
        assert self.may_send.wait(TIMEOUT_S)
        if self.error is not None:
            error, self.error = self.error, None
            raise error
        self.headers.append(parse(b"".join(buffers))[0])
        self.threads.append(threading.current_thread().name)
        return True

    def send_batch(self, run: OutgoingBatch, to: Address) -> int:
        for number in range(run.first, run.first + run.parts_count):
            self.send(datagram_of(run.parts.packed, run.parts.body, run.parts.cut, number), to)
        return run.parts_count

    def receive_into(self, buffer: bytearray) -> tuple[int, Address] | None:
        self._is_shut.wait(0.05)
        return None

    def shut(self) -> None:
        self._is_shut.set()

    def close(self) -> None:
        pass


@pytest.fixture
def wire() -> Iterator[Wire]:
    wire = Wire()
    yield wire
    wire.may_send.set()


def clock(link: Link, number: int) -> None:
    link.send(8, "/clock", "", 10**18 + number, bytes([number]))


def make_thread_look(link: Link) -> None:
    """Make the link's own thread look around, and wait until it has lain down again."""
    with link._wake:
        link._sleeps_until_nanos = 0.0
        link._wake.notify_all()
    wait_until(lambda: link._sleeps_until_nanos > 0, "the thread sleeps")


class KeepingWire(Wire):
    """Has a Credit for all that was sent, which comes when it may be kept no longer."""

    def __init__(self) -> None:
        super().__init__()
        self.is_awaited = False
        self.credit_store = self

    def keep(self, to: Address, like: bytes) -> list[tuple[int, int, int]]:
        return []

    def collect(self, is_awaited: bool) -> list[tuple[int, int, int]]:
        came_last = is_awaited and not self.is_awaited
        self.is_awaited = is_awaited
        newest = next(header for header in reversed(self.headers) if header.msg_type == 33)
        return [(newest.seq_number, newest.part_number, self.receive_buffer)] if came_last else []


def test_a_credit_that_is_kept_while_the_sender_gives_up_is_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(
        flow_control, "REQUEST_NANOS", int(2 * TIMEOUT_S * 1e9)
    )  # nobody asks for one
    wire = KeepingWire()
    with Link(("", 0), TO, socket=wire) as link:
        for number in range(3):
            link.send(33, "/image", "", 10**18 + number, bytes(12_000_000))
            wait_until(link._is_idle, "all parts leave")
        parts = [(h.seq_number, h.part_number) for h in wire.headers if h.msg_type == 33]
        assert parts == [(number, part) for number in range(3) for part in range(184)]
        assert link.counters()["stalls"] == 0


class PlainWire(Wire):
    """Takes datagrams one by one alone, as sealed sockets do."""

    send_batch = None  # type: ignore[assignment]


def test_all_parts_of_messages_that_are_alike_leave_one_by_one() -> None:
    wire = PlainWire()
    with Link(("", 0), TO, socket=wire) as link:
        link._queue_for(TO).flow.acknowledged(DatagramKey(33, "", 0, 0), 8 << 20, 0)
        for number in range(3):
            link.send(33, "/image", "", 10**18 + number, bytes(300_000))
            assert link.flush(TIMEOUT_S)
            assert {h.part_number for h in wire.headers[-5:]} == set(range(5))
        assert len(wire.headers) == 15
        assert set(wire.threads) == {threading.current_thread().name}


def test_a_large_message_does_not_overtake_the_rest_of_another_one(wire: Wire) -> None:
    with Link(("", 0), TO, socket=wire) as link:
        pacer = link._queue_for(TO).flow
        pacer.acknowledged(DatagramKey(33, "", 0, 0), 8 << 20, 0)
        for number in range(2):
            link.send(33, "/image", "", 10**18 + number, bytes(46 * 65280))
        newest = wire.headers[-1]
        assert (newest.seq_number, newest.part_number) == (1, 16)  # the rest does not fit
        with link._lock:
            pacer.acknowledged(DatagramKey(33, "/image", 1, 16), 8 << 20, time.monotonic_ns())
            link.send(33, "/image", "", 10**18 + 2, bytes(46 * 65280))
        parts = [(h.seq_number, h.part_number) for h in wire.headers if h.msg_type == 33]
        assert parts[:92] == [(number, part) for number in range(2) for part in range(46)]
        assert parts[92] == (2, 0)


def test_small_messages_are_sent_by_the_callers_thread(wire: Wire) -> None:
    with Link(("", 0), TO, socket=wire) as link:
        for number in range(5):
            clock(link, number)
        assert [header.seq_number for header in wire.headers] == [0, 1, 2, 3, 4]
        assert [header.stamp_nanos - 10**18 for header in wire.headers] == [0, 1, 2, 3, 4]
        assert set(wire.threads) == {threading.current_thread().name}
        assert link.counters()["sent_messages"] == 5
        (counts,) = link.delivery_counts()
        assert (counts.sent, counts.sent_bytes) == (5, 5)


def test_an_offer_is_repeated_though_nothing_else_happens(wire: Wire) -> None:
    repair = {(8, "/clock"): Resend(500_000_000)}
    with Link(("", 0), TO, socket=wire, repair=repair) as link:
        make_thread_look(link)
        clock(link, 0)
        offers = lambda: [h for h in list(wire.headers) if h.msg_type == RESEND]  # noqa: E731
        wait_until(lambda: len(offers()) >= 3, "the offer of a message that nobody asks for")


def test_messages_queued_during_a_send_are_sent_by_that_thread(wire: Wire) -> None:
    with Link(("", 0), TO, socket=wire) as link:
        clock(link, 0)
        wire.may_send.clear()
        wire.is_sending.clear()
        sender = threading.Thread(target=clock, args=(link, 1), name="first")
        sender.start()
        assert wire.is_sending.wait(TIMEOUT_S)
        for number in range(2, 6):
            clock(link, number)  # returns at once
        make_thread_look(link)
        wire.may_send.set()
        sender.join(TIMEOUT_S)
        assert link.flush(TIMEOUT_S)
        assert [header.seq_number for header in wire.headers] == list(range(6))


def test_what_waits_for_credit_wakes_a_thread_that_had_nothing_to_wait_until(wire: Wire) -> None:
    body = bytes(65280 * 20)
    with Link(("", 0), TO, socket=wire) as link:
        wire.may_send.clear()
        sender = threading.Thread(target=link.send, args=(1, "/points", "", 10**18, body))
        sender.start()
        assert wire.is_sending.wait(TIMEOUT_S)
        make_thread_look(link)
        wire.may_send.set()
        sender.join(TIMEOUT_S)
        parts = lambda: [h.part_number for h in wire.headers if h.msg_type == 1]  # noqa: E731
        wait_until(lambda: parts() == list(range(20)), "parts that no credit came for")


def test_an_error_in_a_socket_leaves_nothing_behind(wire: Wire) -> None:
    with Link(("", 0), TO, socket=wire) as link:
        clock(link, 0)
        wire.may_send.clear()
        wire.is_sending.clear()
        errors: list[BaseException] = []

        def fail() -> None:
            try:
                clock(link, 1)
            except ZeroDivisionError as error:
                errors.append(error)

        wire.error = ZeroDivisionError()
        sender = threading.Thread(target=fail)
        sender.start()
        assert wire.is_sending.wait(TIMEOUT_S)
        clock(link, 2)  # left to the one who is sending
        make_thread_look(link)
        wire.may_send.set()
        sender.join(TIMEOUT_S)
        assert errors
        assert link.flush(TIMEOUT_S)
        wait_until(lambda: [h.seq_number for h in wire.headers] == [0, 2], "what was left to it")


def test_closing_does_not_wait_for_queued_messages(wire: Wire) -> None:
    link = Link(("", 0), TO, socket=wire)
    link.send(1, "/points", "", 10**18, bytes(65280 * 20))
    link.close()
    assert not link._is_sending
    assert len(wire.headers) < 20
    assert link.flush(0.0)
