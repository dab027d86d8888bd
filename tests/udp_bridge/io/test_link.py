# SPDX-License-Identifier: Apache-2.0
"""Real sockets on loopback. Waiting is always for a condition, never for a time."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import BadMessage, Link, Message, TooLarge, fragments
from udp_bridge.io.receive_thread import BLOCKED_NANOS
from udp_bridge.io.udp_socket import UdpSocket, buffer_hint
from udp_bridge.wire import control
from udp_bridge.wire.control import LinkReport, TopicReport
from udp_bridge.wire.header import Buffer
from udp_bridge.wire.message import Address

LOCAL = ("127.0.0.1", 0)
DEFAULT_BUFFER = 212_992
TIMEOUT_S = 20.0


class Endpoint:
    """A link and what it received."""

    def __init__(self, *, bind: tuple[str, int] = LOCAL, **options: Any) -> None:
        self.received: list[Message] = []
        self.senders: set[tuple[str, int]] = set()
        self.link = Link(bind, on_message=self._on_message, **options)

    def _on_message(self, message: Message, sender: tuple[str, int]) -> None:
        self.received.append(message)
        self.senders.add(sender)

    @property
    def data(self) -> list[Message]:
        return [message for message in self.received if message.msg_type != 64]


Make = Callable[..., Endpoint]


@pytest.fixture
def make() -> Iterator[Make]:
    endpoints: list[Endpoint] = []

    def make_endpoint(**options: Any) -> Endpoint:
        endpoints.append(Endpoint(**options))
        return endpoints[-1]

    yield make_endpoint
    for endpoint in endpoints:
        endpoint.link.close()


def test_a_message_arrives_as_it_was_sent(make: Make) -> None:
    receiver = make()
    sender = make(peer=receiver.link.address)
    sender.link.send(9, "/cmd_vel", "base", 1_500_000_001, bytearray(b"body"))
    wait_until(lambda: len(receiver.received) == 1)
    (message,) = receiver.received
    assert message == Message(9, "/cmd_vel", "base", 1_500_000_001, 0, b"body", 1)
    assert receiver.senders == {sender.link.address}


def test_an_answer_goes_back_to_the_sender(make: Make) -> None:
    ros, gateway = make(), make()
    gateway.link.send(8, "", "", 1, b"clock", to=ros.link.address)
    wait_until(lambda: len(ros.senders) == 1)
    ros.link.send(9, "/cmd_vel", "", 2, b"twist", to=next(iter(ros.senders)))
    wait_until(lambda: len(gateway.received) == 1)
    assert gateway.received[0].body == b"twist"


@pytest.mark.parametrize("datagram", ["loopback", 9000])
def test_clouds_do_not_overrun_a_default_receive_buffer(make: Make, datagram: int | str) -> None:
    receiver = make(receive_buffer=DEFAULT_BUFFER)
    assert receiver.link.receive_buffer == DEFAULT_BUFFER
    sender = make(peer=receiver.link.address, datagram=datagram)
    body = os.urandom(1_200_000)
    for count in range(1, 51):
        sender.link.send(1, "/points", "lidar", count, body)
        wait_until(lambda count=count: len(receiver.received) >= count)  # type: ignore[misc]
    assert [message.seq_number for message in receiver.received] == list(range(50))
    assert all(message.body == body for message in receiver.received)
    received = receiver.link.counters()
    assert {name: received[name] for name in ("kernel_drops", "incomplete", "missing")} == {
        "kernel_drops": 0,
        "incomplete": 0,
        "missing": 0,
    }
    wait_until(lambda: sender.link.counters()["sent_messages"] == 50)
    sent = sender.link.counters()
    assert sent["superseded"] == 0
    assert sent["sent_datagrams"] == received["received_datagrams"]
    assert sent["sent_bytes"] == received["received_bytes"]


def test_a_small_receive_buffer_comes_with_a_hint() -> None:
    assert buffer_hint(8 << 20) == ""
    hint = buffer_hint(DEFAULT_BUFFER)
    assert hint.endswith("sysctl -w net.core.rmem_max=4194304")
    assert "212992 bytes instead of 8388608" in hint


def test_the_largest_message_arrives(make: Make) -> None:
    receiver = make()
    sender = make(peer=receiver.link.address)
    body = bytes(16_000_000)
    sender.link.send(33, "/image", "camera", 0, body)
    wait_until(lambda: len(receiver.received) == 1)
    assert receiver.received[0].body == body
    assert receiver.received[0].parts == 246


def test_small_messages_arrive_in_order_beside_large_ones(make: Make) -> None:
    receiver = make(receive_buffer=1 << 20)  # holds all that is not paced here
    sender = make(peer=receiver.link.address)
    sender.link.send(1, "/points", "lidar", 0, bytes(3_000_000))
    for tick in range(100):
        sender.link.send(8, "/clock", "", tick, tick.to_bytes(4, "little"))
    wait_until(lambda: len(receiver.received) == 101)
    clock = [message.stamp_nanos for message in receiver.received if message.msg_type == 8]
    assert clock == list(range(100))


def test_any_thread_may_send(make: Make) -> None:
    receiver = make()
    sender = make(peer=receiver.link.address)

    def send_many(topic: str) -> None:
        for index in range(100):
            sender.link.send(2, topic, "imu", index, b"x")

    threads = [threading.Thread(target=send_many, args=(f"/imu{n}",)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    wait_until(lambda: len(receiver.received) == 400)
    assert receiver.link.counters()["missing"] == 0


def test_a_peer_that_is_not_there_is_no_error(make: Make) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reserved:
        reserved.bind(LOCAL)
        absent = reserved.getsockname()
    sender = make(peer=absent)
    present = make()
    for index in range(20):
        sender.link.send(8, "/clock", "", index, b"t")
        sender.link.send(8, "/clock", "", index, b"t", to=present.link.address)
    sender.link.send(1, "/points", "", 1, bytes(300_000))
    wait_until(lambda: len(present.received) == 20)
    assert sender.link.flush(TIMEOUT_S)
    wait_until(lambda: sender.link.counters()["unreachable"] > 0)
    # It comes, and what is sent from then on arrives.
    late = make(bind=absent)
    sender.link.send(8, "/clock", "", 100, b"t")
    wait_until(lambda: len(late.received) == 1)


def test_newer_large_messages_supersede_those_that_wait(
    make: Make, stranger: socket.socket
) -> None:
    sender = make(peer=stranger.getsockname())
    for index in range(20):
        sender.link.send(1, "/points", "", index, bytes(1_000_000))
    wait_until(lambda: sender.link.counters()["superseded"] >= 17)
    counts = sender.link.counters()
    assert counts["sent_messages"] + counts["superseded"] <= 20


def test_oversized_messages_are_refused_and_counted(make: Make) -> None:
    sender = make(peer=("127.0.0.1", 9))
    with pytest.raises(TooLarge, match="Image on topic '/image': a body of 17000000 bytes"):
        sender.link.send(33, "/image", "", 0, bytes(17_000_000))
    assert sender.link.counters()["too_large"] == 1
    assert sender.link.counters()["sent_datagrams"] == 0


def test_bad_messages_raise_in_the_caller(make: Make) -> None:
    sender = make()
    with pytest.raises(BadMessage, match="nowhere to send to"):
        sender.link.send(8, "/clock", "", 0, b"")
    with pytest.raises(BadMessage, match="NUL"):
        sender.link.send(8, "/clo\0ck", "", 0, b"", to=("127.0.0.1", 9))
    with pytest.raises(BadMessage, match="datagram size"):
        make(datagram=7)
    with pytest.raises(OSError, match=r"no IPv4 address for nowhere.invalid:9"):
        make(peer=("nowhere.invalid", 9))


def test_a_port_in_use_is_named(make: Make) -> None:
    endpoint = make()
    where = f"127.0.0.1:{endpoint.link.address[1]}"
    with pytest.raises(OSError, match=f"can't bind to {where}: Address already in use"):
        make(bind=endpoint.link.address)


def test_host_names_are_known_by_their_address(make: Make) -> None:
    receiver = make(receive_buffer=DEFAULT_BUFFER)
    sender = make(peer=("localhost", receiver.link.address[1]))
    sender.link.send(1, "/points", "", 0, bytes(2_000_000))
    wait_until(lambda: len(receiver.received) == 1)
    assert sender.link.received.messages > 0  # credits


def test_reports_list_arrived_messages(make: Make) -> None:
    receiver = make(report=True)
    sender = make(peer=receiver.link.address)
    stamp = time.time_ns()
    for index in (0, 1):
        sender.link.send(2, "/imu", "imu", stamp + index, b"x")
    wait_until(lambda: len(sender.received) >= 2)
    bodies = [control.parse(message.body) for message in sender.received]
    report = next(body for body in bodies if isinstance(body, TopicReport))
    assert (report.msg_type, report.numbers, report.published, report.pending) == (2, 2, 2, 0)
    assert (report.first_stamp_nanos, report.last_stamp_nanos) == (stamp, stamp + 1)
    assert 0 < report.age_p50_nanos <= report.age_p99_nanos < 60 * 10**9
    total = next(body for body in bodies if isinstance(body, LinkReport))
    assert total[1:5] == (2, receiver.link.counters()["received_bytes"], 0, 0)
    assert [message.topic for message in sender.received[:2]] == ["/imu", ""]


def test_a_closing_receiver_reports_so_that_its_successor_continues(make: Make) -> None:
    receiver = make(report=True)
    address = receiver.link.address
    sender = make(peer=address)
    for index in range(5):
        sender.link.send(2, "/imu", "imu", 1 + index, b"x")
    wait_until(lambda: len(receiver.received) == 5)
    receiver.link.close()
    wait_until(lambda: sender.link.delivery_counts()[0].delivered == 5)
    again = make(bind=address, report=True)
    sender.link.send(2, "/imu", "imu", 6, b"x")
    wait_until(lambda: len(again.received) == 1)
    again.link.close()
    wait_until(lambda: sender.link.delivery_counts()[0].delivered == 6)
    (counts,) = sender.link.delivery_counts()
    assert (counts.sent, counts.missing, counts.in_flight) == (6, 0, 0)


def test_confirmed_messages_count_when_reported(make: Make) -> None:
    receiver = make(report=True, confirmed=True)
    sender = make(peer=receiver.link.address)
    for index in range(3):
        sender.link.send(2, "/imu", "imu", 1 + index, b"x")
    wait_until(lambda: len(receiver.received) == 3)
    receiver.link.published(receiver.received[0], sender.link.address)
    receiver.link.dropped(receiver.received[1], sender.link.address)
    receiver.link.close()
    wait_until(lambda: sender.link.delivery_counts()[0].delivered == 1)
    (counts,) = sender.link.delivery_counts()
    assert (counts.dropped, counts.in_flight) == (1, 1)


def test_without_report_nothing_goes_back_for_small_messages(make: Make) -> None:
    receiver = make()
    sender = make(peer=receiver.link.address)
    sender.link.send(2, "/imu", "imu", 0, b"x")
    wait_until(lambda: len(receiver.received) == 1)
    assert receiver.link.counters()["sent_datagrams"] == 0


def test_drops_of_the_kernel_are_counted(stranger: socket.socket) -> None:
    is_busy = threading.Event()
    received: list[Message] = []

    def on_message(message: Message, _: object) -> None:
        received.append(message)
        is_busy.wait(TIMEOUT_S)

    with Link(LOCAL, on_message=on_message, receive_buffer=DEFAULT_BUFFER) as link:
        message = Message(2, "/imu", "", 0, 0, bytes(1000))
        sent = 400
        for seq in range(sent):
            ((head, part),) = fragments(message._replace(seq_number=seq))
            stranger.sendmsg([head, part], [], 0, link.address)
        is_busy.set()
        wait_until(lambda: received[-1:] != [] and link.counters()["received_datagrams"] > 0)
        # The count comes with the next datagram behind the drops.
        seq = sent
        while not link.counters()["kernel_drops"]:
            ((head, part),) = fragments(message._replace(seq_number=seq))
            stranger.sendmsg([head, part], [], 0, link.address)
            seq += 1
            time.sleep(0.001)
        wait_until(
            lambda: link.counters()["received_datagrams"] + link.counters()["kernel_drops"] == seq
        )
        assert link.counters()["missing"] == link.counters()["kernel_drops"]


def test_garbage_is_counted_and_changes_nothing(make: Make, stranger: socket.socket) -> None:
    receiver = make()
    for garbage in (b"", b"x" * 10, bytes(1000), b"\xff" * 65507):
        stranger.sendto(garbage, receiver.link.address)
    wait_until(lambda: receiver.link.counters()["received_datagrams"] == 4)
    assert receiver.link.counters()["refused"] == {
        "empty": 1,
        "short": 1,
        "header_size_small": 1,
        "header_size_unaligned": 1,
    }
    sender = make(peer=receiver.link.address)
    sender.link.send(8, "/clock", "", 0, b"t")
    wait_until(lambda: len(receiver.received) == 1)


def test_an_exception_in_on_message_is_logged_and_ends_nothing(
    make: Make, caplog: pytest.LogCaptureFixture
) -> None:
    received: list[Message] = []

    def on_message(message: Message, _: object) -> None:
        received.append(message)
        raise RuntimeError("broken")

    with Link(LOCAL, on_message=on_message) as link:
        sender = make(peer=link.address)
        for index in range(2):
            sender.link.send(8, "/clock", "", index, b"t")
        wait_until(lambda: link.counters()["errors"] == 2)
        assert [message.stamp_nanos for message in received] == [0, 1]
    (record,) = caplog.records  # one traceback in ten seconds
    assert record.getMessage().startswith("on_message of Clock #0 '/clock'")


def test_a_turn_that_raises_is_counted_and_the_next_one_receives(make: Make) -> None:
    receiver = make()
    accept = receiver.link._inbox.reassembler.accept
    failures = [RuntimeError("broken"), RuntimeError("again")]

    def failing(*arguments: Any) -> Message | None:
        if failures:
            raise failures.pop()
        return accept(*arguments)

    receiver.link._inbox.reassembler.accept = failing  # type: ignore[method-assign]
    sender = make(peer=receiver.link.address)
    for index in range(3):
        sender.link.send(8, "/clock", "", index, b"t")
    wait_until(lambda: len(receiver.received) == 1)
    assert receiver.link.counters()["errors"] == 2
    assert receiver.link.counters()["deaf"] == 0


def test_a_blocked_receiving_thread_is_counted_as_deaf(make: Make) -> None:
    held, is_held = threading.Event(), threading.Event()

    def hold(*_: object) -> None:
        is_held.set()
        held.wait(TIMEOUT_S)

    with Link(LOCAL, on_message=hold) as link:
        make(peer=link.address).link.send(8, "/clock", "", 0, b"t")
        assert is_held.wait(TIMEOUT_S)
        assert link.counters()["deaf"] == 0
        link._receiving._turn_nanos -= BLOCKED_NANOS
        wait_until(lambda: link.counters()["deaf"] == 1)
        held.set()
        wait_until(lambda: link.counters()["deaf"] == 0)


def test_a_silent_peer_gets_everything_at_the_rate_of_the_bucket(
    make: Make, stranger: socket.socket
) -> None:
    stranger.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    stranger.settimeout(TIMEOUT_S)
    sender = make(peer=stranger.getsockname())
    began = time.monotonic()
    sender.link.send(1, "/points", "", 0, bytes(3_000_000))
    taken_bytes = 0
    while taken_bytes < 3_000_000:
        taken_bytes += len(stranger.recv(65536))
    assert time.monotonic() - began > (3_000_000 - 133_120) / 50e6


def test_a_closed_link_sends_and_receives_no_more(make: Make) -> None:
    receiver = make()
    sender = make(peer=receiver.link.address)
    sender.link.send(8, "/clock", "", 0, b"t")
    assert sender.link.flush(TIMEOUT_S)
    wait_until(lambda: len(receiver.received) == 1)
    names = {thread.name for thread in threading.enumerate()}
    assert names >= {"udp_bridge receive", "udp_bridge send"}
    for endpoint in (sender, receiver):
        endpoint.link.close()
        endpoint.link.close()
    assert not any(thread.name.startswith("udp_bridge") for thread in threading.enumerate())
    sender.link.send(8, "/clock", "", 1, b"t")
    assert sender.link.flush(0)
    assert sender.link.counters()["sent_messages"] == 1


def test_closing_waits_for_no_timeout(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("udp_bridge.io.link._WAIT_S", 3600.0)
    endpoint = make()
    endpoint.link.close()  # far beyond a test's time if it waited
    assert not any(thread.is_alive() for thread in endpoint.link._threads)


def test_closing_counts_open_messages(make: Make, stranger: socket.socket) -> None:
    receiver = make()
    head, part = next(fragments(Message(1, "/points", "", 0, 0, bytes(5000)), "mtu"))
    stranger.sendmsg([head, part], [], 0, receiver.link.address)
    wait_until(lambda: receiver.link.counters()["received_datagrams"] == 1)
    receiver.link.close()
    assert receiver.link.counters()["incomplete"] == 1


def test_on_message_may_close_the_link(make: Make) -> None:
    links: list[Link] = []
    links.append(Link(LOCAL, on_message=lambda *_: links[0].close()))
    sender = make(peer=links[0].address)
    sender.link.send(8, "/clock", "", 0, b"t")
    wait_until(lambda: not any(thread.is_alive() for thread in links[0]._threads))


def test_a_link_uses_and_closes_the_socket_that_it_is_given(make: Make) -> None:
    class Loud(UdpSocket):
        def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
            sent.append(sum(map(len, buffers)))
            return super().send(buffers, to)

        def close(self) -> None:
            closed.append(self)
            super().close()

    sent: list[int] = []
    closed: list[UdpSocket] = []
    receiver = make()
    own = Loud(LOCAL, receive_buffer=DEFAULT_BUFFER, wait_s=0.05)
    sender = make(peer=receiver.link.address, socket=own)
    assert sender.link.address == own.address
    assert sender.link.receive_buffer == own.receive_buffer
    sender.link.send(8, "/clock", "", 0, b"t")
    wait_until(lambda: len(receiver.received) == 1)
    assert sent == [24 + 1]
    sender.link.close()
    assert closed == [own]
