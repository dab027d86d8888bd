# SPDX-License-Identifier: Apache-2.0
"""When a message is published by the thread that received it, and when it waits for its turn."""

import pytest

from udp_bridge.node.publish_queue import QUICK_SECONDS, _Channel
from udp_bridge.wire.message import Message
from udp_bridge.wire.types import MSG_TYPES

PEER = ("127.0.0.1", 7510)


@pytest.fixture
def channel() -> _Channel:
    made = _Channel(MSG_TYPES[1], "/points", PEER)
    made.took_s = QUICK_SECONDS
    return made


def test_after_a_quick_message_with_nothing_before_it_the_next_goes_at_once(
    channel: _Channel,
) -> None:
    assert channel.is_quick()


def test_after_a_slow_message_or_none_the_next_waits(channel: _Channel) -> None:
    channel.took_s = QUICK_SECONDS * 1.01
    assert not channel.is_quick()
    assert not _Channel(MSG_TYPES[1], "/points", PEER).is_quick()


def test_a_message_does_not_overtake_one_that_waits(channel: _Channel) -> None:
    channel.waiting.append((Message(1, "/points", "", 0, 0, b""), PEER))
    assert not channel.is_quick()


def test_a_message_does_not_overtake_one_that_is_being_published(channel: _Channel) -> None:
    channel.is_publishing = True
    assert not channel.is_quick()


def test_a_latched_message_waits_as_all_of_its_topic_are_compared(channel: _Channel) -> None:
    channel.qos = channel.qos._replace(is_repeated=True)
    assert not channel.is_quick()
