# SPDX-License-Identifier: Apache-2.0
"""Sealed datagrams (type 68): who has the shared key may send, each datagram once, one way only.

No socket, no clock: the wall clock comes in as nanoseconds. Contents are authenticated, not
hidden. Nothing is kept of what was refused, so that only holders of the key can use memory here.
"""

from __future__ import annotations

import hashlib
import heapq
import hmac
from collections import OrderedDict
from struct import Struct
from typing import List, Sequence

from .header import NANOS, Buffer, Refused
from .types import SEALED

_HEAD = Struct("<BBIBBiiBBHQ")
HEAD_SIZE = _HEAD.size
"""Bytes before the datagram within: a header of 20, then the counter."""
TAG_SIZE = 16
OVERHEAD = HEAD_SIZE + TAG_SIZE
"""Bytes that sealing adds to a datagram."""
WINDOW = 1024
"""Counters that are remembered of a sender: a datagram may come behind so many later ones."""
STALE_NANOS = 10 * NANOS
"""The first datagram of a sender must not be sealed longer ago than this by our wall clock."""
SENDERS = 64
"""Senders that are remembered."""

TO_ROS = 0
"""The simulator's side sealed it."""
FROM_ROS = 1
"""The ROS side sealed it."""

_SENDER_OFFSET = 2
_KEY_PERSON = b"udp-bridge key"


class _Window:
    """The newest counters of one sender that were seen; what is older than all is refused."""

    def __init__(self, first: int) -> None:
        self._seen = {first}
        self._by_age = [first]
        self._oldest = first

    def take(self, counter: int) -> bool:
        """Return whether a counter is new; a known one, or one that is too old, is not."""
        if counter <= self._oldest or counter in self._seen:
            return False
        self._seen.add(counter)
        if len(self._by_age) < WINDOW:
            heapq.heappush(self._by_age, counter)
        else:
            self._seen.discard(heapq.heappushpop(self._by_age, counter))
            self._oldest = self._by_age[0]
        return True


class Seal:
    """Seals what one end sends, and opens what the other end has sealed.

    Parameters
    ----------
    secret
        What both ends share, 16 bytes or more.
    sends
        `TO_ROS` or `FROM_ROS`: the direction of what this end seals. It opens the other only.
    sender
        A random number of 32 bits that this end has for as long as it lives.
    """

    def __init__(self, secret: bytes, *, sends: int, sender: int) -> None:
        key = hashlib.blake2b(secret, digest_size=32, person=_KEY_PERSON).digest()
        self._keyed = hashlib.blake2b(key=key, digest_size=TAG_SIZE)
        self._sends = sends
        self._sender = sender
        self._counter = 0
        self._windows: OrderedDict[int, _Window] = OrderedDict()

    def next_counter(self, wall_nanos: int) -> int:
        """Return the counter of the next datagram: the time, or one more than the last."""
        self._counter = max(self._counter + 1, wall_nanos)
        return self._counter

    def sealed(self, buffers: Sequence[Buffer], counter: int) -> List[Buffer]:
        """Return the buffers of a sealed datagram, with those of the plain one among them."""
        head = _HEAD.pack(SEALED, 20, self._sender, 0, 1, self._sends, 0, 0, 0, 0, counter)
        tag = self._keyed.copy()
        tag.update(head)
        for buffer in buffers:
            tag.update(buffer)
        return [head, *buffers, tag.digest()]

    def opened(self, datagram: memoryview, wall_nanos: int) -> memoryview:
        """Return the datagram that was sealed, as a view into what came.

        Raises
        ------
        Refused
            When it is not sealed, or not with our key, or not for us, or was here before.
        """
        if not datagram or datagram[0] != SEALED:
            raise Refused("unsealed")
        end = len(datagram) - TAG_SIZE
        if end < HEAD_SIZE:
            raise Refused("bad_tag")
        tag = self._keyed.copy()
        tag.update(datagram[:end])
        if not hmac.compare_digest(tag.digest(), datagram[end:]):
            raise Refused("bad_tag")
        _, _, sender, _, _, direction, _, _, _, _, counter = _HEAD.unpack_from(datagram)
        if direction == self._sends:
            raise Refused("reflected")
        self._admit(sender, counter, wall_nanos)
        return datagram[HEAD_SIZE:end]

    def _admit(self, sender: int, counter: int, wall_nanos: int) -> None:
        window = self._windows.get(sender)
        if window is not None:
            if not window.take(counter):
                raise Refused("replayed")
            self._windows.move_to_end(sender)
            return
        if counter < wall_nanos - STALE_NANOS:
            raise Refused("stale")
        if len(self._windows) >= SENDERS:
            self._windows.popitem(last=False)
        self._windows[sender] = _Window(counter)
