# SPDX-License-Identifier: Apache-2.0
"""Sealed datagrams (type 68): only holders of the shared key can send, each datagram once, one way.

No socket, no clock: the wall clock comes in as nanoseconds. Contents are authenticated, not
encrypted. A refused datagram leaves no state, so only holders of the key can use memory here.
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
"""Remembered counters of a sender: a datagram may arrive behind so many later ones."""
STALE_NANOS = 10 * NANOS
"""Greatest age of the first datagram of a sender, by our wall clock."""
SENDERS = 64
"""Remembered senders."""

TO_ROS = 0
"""The simulator's side sealed it."""
FROM_ROS = 1
"""The ROS side sealed it."""

_SENDER_OFFSET = 2
_KEY_PERSON = b"udp-bridge key"


class _Window:
    """The newest counters seen of one sender; older ones are refused."""

    def __init__(self, first: int) -> None:
        self._seen = {first}
        self._by_age = [first]
        self._oldest = first

    def take(self, counter: int) -> bool:
        """Return whether a counter is new; a known or too old counter is not."""
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
    """Seals the datagrams of one end, and opens those of the other end.

    Parameters
    ----------
    secret
        The secret of both ends, 16 bytes or more.
    sends
        `TO_ROS` or `FROM_ROS`: the direction that this end seals. It opens the other one alone.
    sender
        A random number of 32 bits, constant for the lifetime of this end.
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
        """Return the buffers of a sealed datagram; they include those of the plain one."""
        head = _HEAD.pack(SEALED, 20, self._sender, 0, 1, self._sends, 0, 0, 0, 0, counter)
        tag = self._keyed.copy()
        tag.update(head)
        for buffer in buffers:
            tag.update(buffer)
        return [head, *buffers, tag.digest()]

    def opened(self, datagram: memoryview, wall_nanos: int) -> memoryview:
        """Return the datagram inside, as a view into the sealed one.

        Raises
        ------
        Refused
            When the datagram is not sealed, or with another key or direction, or is a replay.
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
