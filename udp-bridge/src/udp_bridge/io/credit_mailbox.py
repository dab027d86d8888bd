# SPDX-License-Identifier: Apache-2.0
"""Credit mailbox: Credits are kept where they arrive until the sender looks for them.

Waking the receiving thread for a Credit costs more than sending a part of the message. So the C
extension keeps the Credits of the message that is being sent, and the sender collects them before
it sends more. A sender whose window is full either is woken by the next Credit, or delegates the
rest of its message: then the extension sends parts as soon as Credits make room.

Between two processes the throughput of 10 MB messages is about 11 % higher with it, measured with
`benchmarks.bridge`'s library receiver; at 1 MB it makes no difference.
"""

from __future__ import annotations

from typing import Any, Container, Dict, List, Optional, Tuple, Union

from udp_bridge.sender.send_queue import DelegatedSend, SendQueue
from udp_bridge.wire.control import Credit
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import Address, DatagramKey
from udp_bridge.wire.types import CONTROL

from .native import batch_io

MAX_RANGES = 16
"""Most ranges of parts in flight with a delegated message; as in `batch_io.h`."""
KeptCredit = Tuple[int, int, int]
"""seq_number, part_number and receive_buffer of a Credit."""


class CreditStore:
    """Memory shared by the sending thread and the extension's `receive`."""

    def __init__(self) -> None:
        self.memory: bytearray = batch_io.mailbox()
        self.peers: Optional[Container[Address]] = None
        """Credits of other addresses are not kept; None: no limit."""

    def keep(self, to: Address, pattern: bytes) -> List[KeptCredit]:
        """Keep Credits from `to` that match `pattern` from now on; return those kept so far."""
        if self.peers is not None and to not in self.peers:
            return []
        kept: List[KeptCredit] = batch_io.keep(self.memory, to, pattern)
        return kept

    def collect(self, is_awaited: bool) -> List[KeptCredit]:
        """Return the kept Credits; while one is awaited only a delegated send keeps any."""
        kept: List[KeptCredit] = batch_io.collect(self.memory, is_awaited)
        return kept

    def delegate(self, send: DelegatedSend) -> None:
        """Send the rest of a message within `receive_batch` as matching Credits arrive."""
        parts = send.parts
        batch_io.delegate(
            self.memory, send.to, parts.packed, parts.body, parts.cut.part_size, *send[2:]
        )

    def reclaim(self) -> int:
        """End the delegated send; return how many parts were sent."""
        sent: int = batch_io.reclaim(self.memory)
        return sent


class CreditMailbox:
    """The sender's side: Credits of the topic and peer of the newest large message.

    Parameters
    ----------
    store
        The `CreditStore` of the socket.
    sent
        The link's counters of what was sent; delegated parts are added.
    """

    def __init__(self, store: Any, sent: Dict[str, int]) -> None:
        self._store = store
        self._sent = sent
        self._followed: Optional[Tuple[Address, int, str]] = None  # to, msg_type, topic
        self._queue: Optional[SendQueue] = None
        self._delegated: Optional[DelegatedSend] = None  # keeps the memory that is sent

    def follow(self, queue: SendQueue, now_nanos: int) -> None:
        """Keep the Credits of the topic that `queue` is sending."""
        followed = (queue.to, *queue.current_topic)
        if followed == self._followed:
            return
        to, msg_type, topic = followed
        pattern = Header(CONTROL, 0, 0, 1, 0, 0, topic).pack() + Credit(msg_type, 0, 0, 0).pack()
        self._apply(self._store.keep(to, pattern), now_nanos)  # of the previous topic
        self._followed, self._queue = followed, queue

    def collect(self, now_nanos: int, *, is_awaited: bool) -> bool:
        """Apply the kept Credits to the flow control; return whether there were any.

        With `is_awaited`, the next Credit is not kept but goes to the receiving thread at once.
        """
        if self._queue is None:
            return False
        self._reclaim(now_nanos)
        kept = self._store.collect(is_awaited and not self._queue.is_idle)
        self._apply(kept, now_nanos)
        return bool(kept)

    def delegate(self) -> None:
        """Delegate the rest of the current message if it waits for Credits only."""
        if self._queue is None:
            return
        send = self._queue.delegate()
        if send is not None and len(send.in_flight) <= MAX_RANGES:
            self._delegated = send
            self._store.delegate(send)

    def _reclaim(self, now_nanos: int) -> None:
        if self._delegated is None:
            return
        count, self._delegated = self._store.reclaim(), None
        if count and self._queue is not None:
            datagram = self._queue.delegated_sent(count, now_nanos)
            assert datagram.batch is not None
            self._sent["sent_datagrams"] += count
            self._sent["sent_bytes"] += datagram.batch.size
            self._sent["sent_messages"] += datagram.is_last

    def _apply(self, kept: List[KeptCredit], now_nanos: int) -> None:
        if self._followed is None or self._queue is None:
            return
        _, msg_type, topic = self._followed
        for seq_number, part_number, receive_buffer in kept:
            key = DatagramKey(msg_type, topic, seq_number, part_number)
            self._queue.flow.credited(key, receive_buffer, now_nanos)


class NoCreditMailbox:
    """Stands in where the socket hands over every Credit at once."""

    def follow(self, queue: SendQueue, now_nanos: int) -> None:
        """Do nothing."""

    def collect(self, now_nanos: int, *, is_awaited: bool) -> bool:
        """Return False."""
        return False

    def delegate(self) -> None:
        """Do nothing."""


def mailbox_for(
    store: Optional[CreditStore], sent: Dict[str, int]
) -> Union[CreditMailbox, NoCreditMailbox]:
    """Return the mailbox for a socket's store, if it has one."""
    return NoCreditMailbox() if store is None else CreditMailbox(store, sent)
