# SPDX-License-Identifier: Apache-2.0
"""Bodies of Barrier and BarrierReply in Control (type 64), to the byte.

A run waits between the two: the simulator's side has listed what it sent up to a tick, and waits
until ROS has all of it and has responded. Each class packs and parses itself.
"""

from __future__ import annotations

from struct import Struct
from typing import Iterable, List, NamedTuple, Sequence, Tuple

from .header import BadMessage, Buffer, Refused
from .types import ROS_TYPES

_BARRIER = Struct("<BBBBIQq")
_REPLY = Struct("<BBBxIQq")
_SENT = Struct("<BBHI")
_RESPONSE = Struct("<BBBB")
TOPICS_MAX = 255
"""Topics in a Barrier or BarrierReply, and expected responses in a Barrier, at most."""

DONE, WAITING, INCOMPLETE, RESTARTED = range(4)
"""States of a BarrierReply: all was published and responded to; a response is awaited; messages are
missing; the ROS side was restarted since they were sent and needs them again."""
_STATES = (DONE, WAITING, INCOMPLETE, RESTARTED)

EVERY_MAX = 254
JOINED = 255
"""Value of `ExpectedResponse.every`: all responses of one topic with this value together mean one
response for each stamp that every topic which causes them has."""


class SentMessages(NamedTuple):
    """Messages of one topic that were sent since the last Barrier or BarrierReply."""

    msg_type: int
    topic: str
    first: int
    """The seq_number of the first message."""
    messages: int
    """Number of messages from the first on, 1..65 535."""


class ExpectedResponse(NamedTuple):
    """A ROS topic on which a message is due for messages of another topic."""

    topic: str
    of: str
    """The topic that causes the responses: one that goes to ROS, or one of responses."""
    msg_type: int = 0
    """Type of the responses; 0 is any type, of which nothing is sent back."""
    every: int = 0
    """0 or 1: a response is due for each message; n up to `EVERY_MAX`: for every n-th message;
    `JOINED`: for each stamp."""


class Barrier(NamedTuple):
    """Kind 4: all up to this tick was sent, and nothing more until a BarrierReply with `DONE`.

    The header carries the run's time at the tick; topic and link are empty.
    """

    episode: int
    """Identifies the episode of the run; each begins at its tick 0."""
    tick: int
    """-1 before the first tick: nothing was sent, and the Barrier asks whether ROS is there."""
    limit_ms: int
    """Time after the arrival of the Barrier to wait for missing messages."""
    sent: Tuple[SentMessages, ...] = ()
    """Every topic with messages since the last Barrier."""
    responses: Tuple[ExpectedResponse, ...] = ()
    """Responses that ROS must send before it is done."""
    in_turn: bool = False
    """Whether ROS publishes a message that causes responses only after all responses to the one
    before."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes, and those of topics and responses.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if self.tick < -1 or len(self.responses) > TOPICS_MAX:
            raise BadMessage(f"a field is out of its range: {self}")
        counts = _counted(self.sent), len(self.responses)
        fixed = _BARRIER.pack(4, *counts, self.in_turn, self.limit_ms, self.episode, self.tick)
        responses = [
            _RESPONSE.pack(
                *(response.msg_type, _size(response.topic), _size(response.of), response.every)
            )
            + (response.topic + response.of).encode()
            for response in self.responses
        ]
        return b"".join([fixed, _packed(self.sent), *responses])

    @classmethod
    def parse(cls, body: Buffer) -> Barrier:
        """Return the parsed body, or raise `Refused`."""
        reader = _Reader(body)
        _, topics, responses, in_turn, limit_ms, episode, tick = reader.take(_BARRIER)
        sent = _parse_sent(reader, topics)
        listed: List[ExpectedResponse] = []
        for _ in range(responses):
            msg_type, topic_size, of_size, every = reader.take(_RESPONSE)
            topic, of = reader.name(topic_size), reader.name(of_size)
            listed.append(ExpectedResponse(topic, of, msg_type, every))
            if msg_type and msg_type not in ROS_TYPES:
                raise Refused("body_value")
        reader.end()
        if tick < -1:
            raise Refused("body_value")
        return cls(episode, tick, limit_ms, sent, tuple(listed), bool(in_turn))


class BarrierReply(NamedTuple):
    """Kind 5: the progress of ROS with a Barrier, sent in reply to each copy of it.

    With `WAITING`, the header carries the topic that is waited for.
    """

    episode: int
    tick: int
    """Episode and tick of the Barrier."""
    state: int = DONE
    lost: int = 0
    """Messages that the Barrier listed and that did not arrive within its limit."""
    sent: Tuple[SentMessages, ...] = ()
    """Every topic with messages to the simulator since the last BarrierReply with `DONE`."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes, and those of topics.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if self.tick < -1 or self.state not in _STATES:
            raise BadMessage(f"a field is out of its range: {self}")
        fixed = _REPLY.pack(5, _counted(self.sent), self.state, self.lost, self.episode, self.tick)
        return fixed + _packed(self.sent)

    @classmethod
    def parse(cls, body: Buffer) -> BarrierReply:
        """Return the parsed body, or raise `Refused`."""
        reader = _Reader(body)
        _, topics, state, lost, episode, tick = reader.take(_REPLY)
        sent = _parse_sent(reader, topics)
        reader.end()
        if tick < -1 or state not in _STATES:
            raise Refused("body_value")
        return cls(episode, tick, state, lost, sent)


class _Reader:
    """Reads a body from the front."""

    def __init__(self, body: Buffer) -> None:
        self._body = bytes(body)
        self._at = 0

    def take(self, layout: Struct) -> tuple:  # type: ignore[type-arg]
        return layout.unpack(self._next(layout.size))

    def name(self, size: int) -> str:
        try:
            name = self._next(size).decode()
        except UnicodeDecodeError:
            raise Refused("body_value") from None
        if not name or "\0" in name:
            raise Refused("body_value")
        return name

    def end(self) -> None:
        if self._at != len(self._body):
            raise Refused("body_size")

    def _next(self, size: int) -> bytes:
        taken = self._body[self._at : self._at + size]
        if len(taken) != size:
            raise Refused("body_size")
        self._at += size
        return taken


def _parse_sent(reader: _Reader, topics: int) -> Tuple[SentMessages, ...]:
    listed: List[SentMessages] = []
    for _ in range(topics):
        msg_type, size, messages, first = reader.take(_SENT)
        listed.append(SentMessages(msg_type, reader.name(size), first, messages))
        if not messages or msg_type not in ROS_TYPES:
            raise Refused("body_value")
    if _repeats(listed):
        raise Refused("body_value")
    return tuple(listed)


def _packed(sent: Iterable[SentMessages]) -> bytes:
    return b"".join(
        _SENT.pack(row.msg_type, _size(row.topic), row.messages, row.first) + row.topic.encode()
        for row in sent
    )


def _counted(sent: Tuple[SentMessages, ...]) -> int:
    if (
        len(sent) > TOPICS_MAX
        or _repeats(sent)
        or any(not 1 <= row.messages <= 0xFFFF for row in sent)
    ):
        raise BadMessage(f"a field is out of its range: {sent}")
    return len(sent)


def _repeats(sent: Sequence[SentMessages]) -> bool:
    """Return whether a topic is listed twice."""
    return len({(row.msg_type, row.topic) for row in sent}) != len(sent)


def _size(name: str) -> int:
    size = len(name.encode())
    if not 1 <= size <= 0xFF:
        raise BadMessage(f"{name!r} is no topic: it has {size} bytes")
    return size
