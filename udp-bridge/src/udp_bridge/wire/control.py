# SPDX-License-Identifier: Apache-2.0
"""Bodies of the bridge's own messages, to the byte: Subscribe (type 7) and Control (type 64).

Each class packs and parses itself; `parse` reads any kind of Control, whose other bodies are in
`reports`, `lockstep`, `run_commands`, `address_validation` and `world_queries`. An invalid body
raises `Refused` (`body_size` or `body_value`).
"""

from __future__ import annotations

import math
from struct import Struct
from typing import Dict, NamedTuple, Type, Union

from .address_validation import AddressChallenge, AddressResponse
from .header import BadMessage, Buffer, Refused
from .lockstep import Barrier, BarrierReply
from .reports import NO_AGE, LinkReport, TopicReport
from .run_commands import RunCommand, RunCommandReply
from .types import MSG_TYPES, ROS_TYPES
from .world_queries import WorldQuery, WorldReply

__all__ = [
    "NO_AGE",
    "AddressChallenge",
    "AddressResponse",
    "Barrier",
    "BarrierReply",
    "Control",
    "Credit",
    "CreditRequest",
    "LinkReport",
    "RunCommand",
    "RunCommandReply",
    "Subscribe",
    "TopicReport",
    "WorldQuery",
    "WorldReply",
    "parse",
]

_SUBSCRIBE = Struct("<BBHf")
_CREDIT = Struct("<BBBxII")
_CREDIT_REQUEST = Struct("<B3x")


class Subscribe(NamedTuple):
    """Type 7: requests the topic that the header names, or ends the request."""

    wanted_type: int
    """The msg_type of the requested messages, one with a ROS type."""
    action: int = 1
    """1 subscribe, 0 unsubscribe."""
    lease_s: int = 0
    """Seconds until the request expires unless it is repeated; 0 = until unsubscribed."""
    max_rate_hz: float = 0.0
    """Highest rate; 0 = all messages."""

    def pack(self) -> bytes:
        """Return the 8 bytes of the body.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if not _is_valid(self):
            raise BadMessage(f"a field is out of its range: {self}")
        if not 0 <= self.lease_s <= 0xFFFF:
            raise BadMessage(f"lease_s is {self.lease_s}; 0..65535 is possible")
        return _SUBSCRIBE.pack(*self)

    @classmethod
    def parse(cls, body: Buffer) -> Subscribe:
        """Return the parsed body, or raise `Refused`."""
        subscribe = cls(*_unpack(_SUBSCRIBE, body))
        if not _is_valid(subscribe):
            raise Refused("body_value")
        return subscribe


class Credit(NamedTuple):
    """Kind 0: a datagram, and all sent before it on this path, left the buffer or was lost.

    The header carries the topic and the time of the acknowledged datagram.
    """

    msg_type: int
    part_number: int
    seq_number: int
    receive_buffer: int
    """Bytes of the receive buffer as the kernel accounts them: SO_RCVBUF read back."""

    def pack(self) -> bytes:
        """Return the 12 bytes of the body."""
        return _CREDIT.pack(0, *self)

    @classmethod
    def parse(cls, body: Buffer) -> Credit:
        """Return the parsed body, or raise `Refused`."""
        _, *fields = _unpack(_CREDIT, body)
        return cls(*fields)


class CreditRequest(NamedTuple):
    """Kind 3: requests a Credit for this very datagram, at once."""

    def pack(self) -> bytes:
        """Return the 4 bytes of the body."""
        return _CREDIT_REQUEST.pack(3)

    @classmethod
    def parse(cls, body: Buffer) -> CreditRequest:
        """Return the parsed body, or raise `Refused`."""
        _unpack(_CREDIT_REQUEST, body)
        return cls()


Control = Union[
    Credit,
    TopicReport,
    LinkReport,
    CreditRequest,
    Barrier,
    BarrierReply,
    RunCommand,
    RunCommandReply,
    AddressChallenge,
    AddressResponse,
    WorldQuery,
    WorldReply,
]
_KINDS: Dict[int, Type[Control]] = {
    0: Credit,
    1: TopicReport,
    2: LinkReport,
    3: CreditRequest,
    4: Barrier,
    5: BarrierReply,
    6: RunCommand,
    7: RunCommandReply,
    8: AddressChallenge,
    9: AddressResponse,
    10: WorldQuery,
    11: WorldReply,
}


def parse(body: Buffer) -> Control:
    """Return the body of a Control message (type 64), whichever kind it is.

    Raises
    ------
    Refused
        When the kind is unknown, or the size or a value is not what the kind has.
    """
    if not len(body):
        raise Refused("body_size")
    kind = _KINDS.get(body[0])
    if kind is None:
        raise Refused("body_value")
    control = kind.parse(body)
    if isinstance(control, (Credit, TopicReport)) and control.msg_type not in MSG_TYPES:
        raise Refused("body_value")
    return control


def _unpack(layout: Struct, body: Buffer) -> tuple:  # type: ignore[type-arg]
    if len(body) != layout.size:
        raise Refused("body_size")
    return layout.unpack(body)


def _is_valid(subscribe: Subscribe) -> bool:
    rate = subscribe.max_rate_hz
    return (
        subscribe.wanted_type in ROS_TYPES
        and subscribe.action in (0, 1)
        and math.isfinite(rate)
        and rate >= 0
    )
