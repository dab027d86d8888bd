# SPDX-License-Identifier: Apache-2.0
"""Small topics; `fuzz.batches` compares them with an inbox that follows none."""

import pytest

from udp_bridge import Header, Message, fragments
from udp_bridge.receiver.inbox import UNLOGGED, Inbox
from udp_bridge.wire.control import Subscribe

SENDER = ("192.0.2.7", 5000)


@pytest.fixture
def inbox() -> Inbox:
    return Inbox(receive_buffer=1 << 20, on_credit=lambda *_: None)


def receive(inbox: Inbox, seq: int, *, stamp: int | None = None, size: int = 9) -> list[Message]:
    """Return what is delivered of a message of type Imu."""
    whole = Message(2, "/imu", "imu", seq if stamp is None else stamp, seq, bytes(size))
    datagrams = [head + bytes(part) for head, part in fragments(whole, 1472)]
    taken = [inbox.receive(memoryview(raw), SENDER, 0)[0] for raw in datagrams]
    return [message for message in taken if message is not None]


def followed(inbox: Inbox) -> int:
    return len(inbox.small_topics.table)


def test_a_topic_is_followed_while_its_messages_are_small_and_in_order(inbox: Inbox) -> None:
    for seq in range(3):
        (message,) = receive(inbox, seq)
        assert (message.seq_number, message.topic, message.link) == (seq, "/imu", "imu")
        assert bytes(message.body) == bytes(9)
    assert len(inbox.small_topics.delivered) == 2  # the first one took the ordinary path
    assert followed(inbox) == 1
    receive(inbox, 3, size=4000)
    assert followed(inbox) == 0
    assert inbox.small_topics.delivered == []
    assert inbox.reassembler.counters.messages == 4


@pytest.mark.parametrize(
    ("seq", "stamp", "delivered"), [(5, 5, 1), (2, 2, 0), (3, 1, 0)], ids=["gap", "copy", "old"]
)
def test_any_other_message_takes_the_ordinary_path(
    inbox: Inbox, seq: int, stamp: int, delivered: int
) -> None:
    for number in range(3):
        receive(inbox, number)
    assert len(receive(inbox, seq, stamp=stamp)) == delivered
    assert inbox.small_topics.delivered == []


def test_messages_of_no_ros_type_are_not_followed(inbox: Inbox) -> None:
    for seq in range(3):
        datagram = Header(7, seq, 0, 1, 0, 0, "/imu").pack() + Subscribe(2).pack()
        assert inbox.receive(memoryview(datagram), SENDER, 0)[0] is not None
    assert followed(inbox) == 0


def test_delivered_messages_are_recorded_when_many_wait_or_some_time_has_passed(
    inbox: Inbox,
) -> None:
    inbox.update_logs_if_due(10**9)
    for seq in range(UNLOGGED):
        receive(inbox, seq)
        inbox.update_logs_if_due(10**9 + 1)
    assert len(inbox.small_topics.delivered) == UNLOGGED - 1
    receive(inbox, UNLOGGED)
    inbox.update_logs_if_due(10**9 + 1)
    assert inbox.small_topics.delivered == []
    receive(inbox, UNLOGGED + 1)
    inbox.update_logs_if_due(2 * 10**9)
    assert inbox.small_topics.delivered == []
    assert inbox.reassembler.counters.messages == UNLOGGED + 2


def test_a_closed_inbox_has_recorded_all_and_follows_nothing(inbox: Inbox) -> None:
    for seq in range(3):
        receive(inbox, seq)
    inbox.close()
    assert inbox.reassembler.counters.messages == 3
    assert followed(inbox) == 0
