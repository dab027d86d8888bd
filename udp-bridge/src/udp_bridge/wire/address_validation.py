# SPDX-License-Identifier: Apache-2.0
"""Address validation: a sender proves that it receives what is sent to its address.

The source address of a datagram can be forged. An address is validated once it has returned a
cookie that was sent there, as with the Retry packet of QUIC (RFC 9000, section 8.1). Until then an
address is sent no more bytes than came from it. Sizes and times are arguments; there is no socket
and no clock here.
"""

from __future__ import annotations

import hashlib
import hmac
from collections import OrderedDict
from struct import Struct
from typing import Dict, NamedTuple, Type, TypeVar

from .header import NANOS, BadMessage, Buffer, Refused
from .message import Address

COOKIE_SIZE = 12
COOKIE_NANOS = 10 * NANOS
"""A cookie is accepted for this long after it was made."""
VALIDATION_NANOS = 60 * NANOS
"""An address stays validated for this long after its newest response."""
RENEWAL_NANOS = 20 * NANOS
"""A validated address is challenged again when its newest response is older than this."""
REPEAT_NANOS = NANOS
"""Shortest time between two challenges that renew a validation."""
VALIDATED_MAX = 64
"""Validated addresses at a time. When all are taken, further ones stay unvalidated."""
VALIDATED_PER_HOST = 8
UNVALIDATED_MAX = 1024
"""Unvalidated addresses whose bytes are counted. The one that was silent longest is forgotten."""

_COOKIE_BODY = Struct("<B3x12s")
CHALLENGE_SIZE = _COOKIE_BODY.size
_ISSUED = Struct("<I")
_TAGGED = Struct("<4BHI")
_TAG_SIZE = 8
_PERSON = b"udp-bridge addr"
_NANOS_PER_MS = 1_000_000
_ISSUED_RANGE = 1 << 32

_Body = TypeVar("_Body", "AddressChallenge", "AddressResponse")


class AddressChallenge(NamedTuple):
    """Control kind 8: a cookie, sent to an address that is to prove that it receives it."""

    cookie: bytes
    """12 bytes, which mean nothing to the receiver."""

    def pack(self) -> bytes:
        """Return the 16 bytes of the body."""
        return _packed(8, self.cookie)

    @classmethod
    def parse(cls, body: Buffer) -> AddressChallenge:
        """Return the parsed body, or raise `Refused`."""
        return _parsed(cls, body)


class AddressResponse(NamedTuple):
    """Control kind 9: the cookie of an AddressChallenge, returned from where that was sent."""

    cookie: bytes

    def pack(self) -> bytes:
        """Return the 16 bytes of the body."""
        return _packed(9, self.cookie)

    @classmethod
    def parse(cls, body: Buffer) -> AddressResponse:
        """Return the parsed body, or raise `Refused`."""
        return _parsed(cls, body)


def _packed(kind: int, cookie: bytes) -> bytes:
    if len(cookie) != COOKIE_SIZE:
        raise BadMessage(f"the cookie has {len(cookie)} bytes, expected {COOKIE_SIZE}")
    return _COOKIE_BODY.pack(kind, cookie)


def _parsed(of: Type[_Body], body: Buffer) -> _Body:
    if len(body) != _COOKIE_BODY.size:
        raise Refused("body_size")
    return of(_COOKIE_BODY.unpack(body)[1])


def is_local(address: Address) -> bool:
    """Return whether an address is a loopback one, which kernels take from their own host alone."""
    return address[0].startswith("127.")


class AddressValidator:
    """The validated addresses of one receiver, and what others may still be sent.

    Parameters
    ----------
    key
        Random bytes, 1 to 64, that only this receiver knows.
    """

    def __init__(self, key: bytes) -> None:
        self._keyed = hashlib.blake2b(key=key, digest_size=_TAG_SIZE, person=_PERSON)
        self._unsent: OrderedDict[Address, int] = OrderedDict()  # received less sent, in bytes
        self._validated: Dict[Address, int] = {}  # time of the newest response
        self._challenged: Dict[Address, int] = {}  # validated ones, time of the newest challenge

    def is_validated(self, address: Address, now_nanos: int) -> bool:
        """Return whether an address has returned a cookie within `VALIDATION_NANOS`."""
        if is_local(address):
            return True
        validated_nanos = self._validated.get(address)
        return validated_nanos is not None and now_nanos - validated_nanos < VALIDATION_NANOS

    def received(self, sender: Address, size: int) -> None:
        """Count bytes that came from an unvalidated address."""
        self._unsent[sender] = self._unsent.pop(sender, 0) + size
        if len(self._unsent) > UNVALIDATED_MAX:
            self._unsent.popitem(last=False)

    def unsent(self, address: Address) -> int:
        """Return how many bytes an unvalidated address may still be sent."""
        return self._unsent.get(address, 0)

    def spend(self, to: Address, size: int) -> bool:
        """Return whether an unvalidated address may be sent so many bytes, and count them."""
        unsent = self._unsent.get(to, 0)
        if size > unsent:
            return False
        self._unsent[to] = unsent - size
        return True

    def is_renewal_due(self, address: Address, now_nanos: int) -> bool:
        """Return whether to challenge a validated address again, and take note that it is done."""
        validated_nanos = self._validated.get(address)
        if validated_nanos is None or now_nanos - validated_nanos < RENEWAL_NANOS:
            return False
        if now_nanos - self._challenged.get(address, validated_nanos) < REPEAT_NANOS:
            return False
        self._challenged[address] = now_nanos
        return True

    def cookie(self, address: Address, now_nanos: int) -> bytes:
        """Return a cookie for an address, made of its bytes and the time; nothing is kept."""
        issued = now_nanos // _NANOS_PER_MS % _ISSUED_RANGE
        return _ISSUED.pack(issued) + self._tag(address, issued)

    def respond(self, sender: Address, cookie: bytes, now_nanos: int) -> bool:
        """Validate an address that returned a cookie; return whether it is validated now."""
        (issued,) = _ISSUED.unpack_from(cookie)
        age_ms = (now_nanos // _NANOS_PER_MS - issued) % _ISSUED_RANGE
        tag = self._tag(sender, issued)
        if not hmac.compare_digest(tag, cookie[_ISSUED.size :]):
            return False
        if age_ms * _NANOS_PER_MS > COOKIE_NANOS or not self._has_room(sender, now_nanos):
            return False
        self._validated[sender] = now_nanos
        self._challenged.pop(sender, None)
        self._unsent.pop(sender, None)
        return True

    def _has_room(self, sender: Address, now_nanos: int) -> bool:
        for address in list(self._validated):
            if not self.is_validated(address, now_nanos):
                del self._validated[address]
                self._challenged.pop(address, None)
        if sender in self._validated:
            return True
        of_host = sum(host == sender[0] for host, _ in self._validated)
        return len(self._validated) < VALIDATED_MAX and of_host < VALIDATED_PER_HOST

    def _tag(self, address: Address, issued: int) -> bytes:
        keyed = self._keyed.copy()
        keyed.update(_TAGGED.pack(*map(int, address[0].split(".")), address[1], issued))
        return keyed.digest()
