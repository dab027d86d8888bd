# SPDX-License-Identifier: Apache-2.0
"""Bodies of lockstep in Control (type 64), to the byte: Barrier and its answer, BarrierReply.

A run stands still between the two: the simulator's side has said what it sent up to a tick, and
waits until ROS has been given all of that and has sent what it says to it. Each packs itself and
parses itself. Nothing here waits: what came is compared with what was sent in `barrier_buffer`.
"""

from __future__ import annotations

from struct import Struct
from typing import Iterable, List, NamedTuple, Sequence, Tuple

from .header import BadMessage, Buffer, Refused
from .types import ROS_TYPES

_BARRIER = Struct("<BBBxIQq")
_WORD = Struct("<BBBxIQq")
_SENT = Struct("<BBHI")
_ANSWER = Struct("<BBBx")
TOPICS_TOLD = 255
"""Topics in one Barrier or BarrierReply, and answers in a Barrier."""

DONE, WAITING, INCOMPLETE, RESTARTED = range(4)
"""States of a BarrierReply: all was published and answered; an answer is awaited; messages are
missing; the ROS side was restarted since they were sent and needs them again."""
_STATES = (DONE, WAITING, INCOMPLETE, RESTARTED)


class SentMessages(NamedTuple):
    """What was sent of one topic since the last Barrier or BarrierReply."""

    msg_type: int
    topic: str
    first: int
    """The seq_number of the first message."""
    messages: int
    """How many from that one on, 1..65 535."""


class ExpectedResponse(NamedTuple):
    """A topic of ROS on which a message is due for each message of another topic."""

    topic: str
    of: str
    """The topic that is answered, one that goes to ROS."""
    msg_type: int = 0
    """Of the answers; 0 is any, of which nothing is sent back."""


class Barrier(NamedTuple):
    """Kind 4: all was sent up to this tick, and nothing more is until a BarrierReply says `DONE`.

    The header carries the run's time at the tick; topic and link are empty.
    """

    episode: int
    """Tells apart the lives of a run; each begins at its tick 0."""
    tick: int
    """-1 for before the first: nothing was sent, and the question is whether ROS is there."""
    limit_ms: int
    """For so long after the Barrier came are messages awaited that are missing."""
    sent: Tuple[SentMessages, ...] = ()
    """Of each topic with messages since the last Barrier."""
    answers: Tuple[ExpectedResponse, ...] = ()
    """What ROS has to say before it is done."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes, and those of topics and answers.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if self.tick < -1 or len(self.answers) > TOPICS_TOLD:
            raise BadMessage(f"no peer would take {self}")
        fixed = _BARRIER.pack(
            4, _counted(self.sent), len(self.answers), self.limit_ms, self.episode, self.tick
        )
        answers = [
            _ANSWER.pack(answer.msg_type, _size(answer.topic), _size(answer.of))
            + (answer.topic + answer.of).encode()
            for answer in self.answers
        ]
        return b"".join([fixed, _packed(self.sent), *answers])

    @classmethod
    def parse(cls, body: Buffer) -> Barrier:
        """Return what the body says, or raise `Refused`."""
        rest = _Rest(body)
        _, topics, answers, limit_ms, episode, tick = rest.take(_BARRIER)
        sent = _parse_sent(rest, topics)
        told: List[ExpectedResponse] = []
        for _ in range(answers):
            msg_type, topic_size, of_size = rest.take(_ANSWER)
            told.append(ExpectedResponse(rest.name(topic_size), rest.name(of_size), msg_type))
            if msg_type and msg_type not in ROS_TYPES:
                raise Refused("body_value")
        rest.end()
        if tick < -1:
            raise Refused("body_value")
        return cls(episode, tick, limit_ms, sent, tuple(told))


class BarrierReply(NamedTuple):
    """Kind 5: how far ROS is with a Barrier. It is the answer to each copy of that Barrier.

    The header carries, of a BarrierReply that says `WAITING`, the topic that is waited for.
    """

    episode: int
    tick: int
    """Both are the Barrier's."""
    state: int = DONE
    lost: int = 0
    """Messages that the Barrier spoke of and that did not come within its limit."""
    sent: Tuple[SentMessages, ...] = ()
    """Of each topic with messages to the simulator since the last BarrierReply that said `DONE`."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes, and those of topics.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if self.tick < -1 or self.state not in _STATES:
            raise BadMessage(f"no peer would take {self}")
        fixed = _WORD.pack(5, _counted(self.sent), self.state, self.lost, self.episode, self.tick)
        return fixed + _packed(self.sent)

    @classmethod
    def parse(cls, body: Buffer) -> BarrierReply:
        """Return what the body says, or raise `Refused`."""
        rest = _Rest(body)
        _, topics, state, lost, episode, tick = rest.take(_WORD)
        sent = _parse_sent(rest, topics)
        rest.end()
        if tick < -1 or state not in _STATES:
            raise Refused("body_value")
        return cls(episode, tick, state, lost, sent)


class _Rest:
    """A body that is read from the front."""

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


def _parse_sent(rest: _Rest, topics: int) -> Tuple[SentMessages, ...]:
    told: List[SentMessages] = []
    for _ in range(topics):
        msg_type, size, messages, first = rest.take(_SENT)
        told.append(SentMessages(msg_type, rest.name(size), first, messages))
        if not messages or msg_type not in ROS_TYPES:
            raise Refused("body_value")
    if _repeats(told):
        raise Refused("body_value")
    return tuple(told)


def _packed(sent: Iterable[SentMessages]) -> bytes:
    return b"".join(
        _SENT.pack(row.msg_type, _size(row.topic), row.messages, row.first) + row.topic.encode()
        for row in sent
    )


def _counted(sent: Tuple[SentMessages, ...]) -> int:
    if (
        len(sent) > TOPICS_TOLD
        or _repeats(sent)
        or any(not 1 <= row.messages <= 0xFFFF for row in sent)
    ):
        raise BadMessage(f"no peer would take {sent}")
    return len(sent)


def _repeats(sent: Sequence[SentMessages]) -> bool:
    """Return whether a topic is told of twice."""
    return len({(row.msg_type, row.topic) for row in sent}) != len(sent)


def _size(name: str) -> int:
    size = len(name.encode())
    if not 1 <= size <= 0xFF:
        raise BadMessage(f"{name!r} is no topic: it has {size} bytes")
    return size
