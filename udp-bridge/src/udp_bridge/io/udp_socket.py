# SPDX-License-Identifier: Apache-2.0
"""UDP socket: its options, its losses, and batches of datagrams. No threads, no messages.

IPv4 on POSIX systems. Batches use the C extension; without it every datagram is a system call of
its own, with the same result. Only Linux reports datagrams dropped for lack of buffer and
unreachable peers; elsewhere these counts stay 0.
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
from functools import partial
from typing import Any, Callable, Dict, List, Optional, Protocol, Sequence, Tuple, Union

from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.receiver.small_topics import (
    DeliveredMessage,
    SmallMessage,
    SmallTopics,
    WholeMessage,
)
from udp_bridge.sender.direct_senders import SendLarge, SendSmall
from udp_bridge.sender.send_queue import OutgoingBatch
from udp_bridge.wire.fragments import datagram_of, flat
from udp_bridge.wire.header import PART_NUMBER_OFFSET, Buffer, is_stamp, restamped
from udp_bridge.wire.message import Address, Message

from .credit_mailbox import CreditStore
from .native import batch_io

_IS_LINUX = sys.platform == "linux"
_SO_RCVBUFFORCE = 33  # Linux numbers that the socket module does not name in every version
_SO_RXQ_OVFL = 40
_IP_RECVERR = 11
_DROP_COUNT = struct.Struct("=I")
RECOMMENDED_BUFFER = 8 << 20
"""Receive buffer that links ask for. Half of it holds 60 datagrams of 64 KB."""
_ANCILLARY_BYTES = 64
"""Room for the drop count beside a datagram."""
_REST_BYTES = 1 << 16

RetryPolicy = Callable[[int], bool]
"""Called with the errno of a datagram that was not sent; returns whether to try again."""
Received = Union[PartBatch, SmallMessage, WholeMessage, None]
ReceiveResult = Tuple[Received, int]
"""The received datagrams, and the errno that ended the batch or 0."""


_TYPES: Dict[int, Any] = {
    len(made._fields): made for made in (PartBatch, SmallMessage, WholeMessage)
}


class DatagramSocket(Protocol):
    """Interface of `UdpSocket` and of the wrappers around it.

    `receive_into` returns within about 0.1 s, with None if nothing was received, and raises
    `Refused` for a datagram that must not be used. A socket may also have `send_batch`,
    `receive_batch` and `credit_store`.
    """

    address: Address
    receive_buffer: int
    overhead: int

    @property
    def kernel_drops(self) -> int: ...  # noqa: D102

    @property
    def unreachable(self) -> int: ...  # noqa: D102

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]: ...  # noqa: D102

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool: ...  # noqa: D102

    def shut(self) -> None: ...  # noqa: D102

    def close(self) -> None: ...  # noqa: D102


class NativeBatches:
    """Batches by the C extension."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for lack of buffer, as last reported."""
        self.credit_store: Optional[CreditStore] = CreditStore()
        self._mailbox = self.credit_store.memory
        self._rest = bytearray(_REST_BYTES)
        self._is_flowing = False
        self._small: Tuple[Any, ...] = ()
        self.use_small_topics(SmallTopics())

    def use_small_topics(self, small: SmallTopics) -> None:
        """Return messages of these topics as such."""
        self._small = small.table, small.delivered, Message, DeliveredMessage

    def receive(
        self, source: socket.socket, slots: ReceiveSlots, credits: CreditState
    ) -> ReceiveResult:
        """Return at least one datagram, or None if nothing was received."""
        found = batch_io.receive(
            source.fileno(),
            self._rest,
            *slots,
            *credits,
            self._is_flowing,
            self._mailbox,
            *self._small,
        )
        self._is_flowing = found is not None
        if found is None:
            return None, -1
        fields, error, drops = found
        if drops >= 0:
            self.drops = drops
        return tuple.__new__(_TYPES[len(fields)], fields), error  # faster than `_make`

    def small_sender(self, source: socket.socket) -> SendSmall:
        """Return a function that sends messages of one part."""
        return partial(batch_io.send_small, source.fileno())

    def large_sender(
        self, source: socket.socket, count_unsent: Callable[[int], None]
    ) -> Optional[SendLarge]:
        """Return a function that sends messages of several parts."""
        fd, send_large = source.fileno(), batch_io.send_large

        def send(
            to: Address,
            packed: bytes,
            body_size: int,
            part_size: int,
            parts: int,
            number: int,
            stamp_nanos: int,
            body: Buffer,
        ) -> int:
            sent: int = send_large(
                fd, to, packed, body_size, part_size, parts, number, stamp_nanos, body
            )
            if 0 <= sent < parts:
                count_unsent(parts - sent)
            return sent

        return send

    def send(
        self, source: socket.socket, batch: OutgoingBatch, to: Address, retry: RetryPolicy
    ) -> int:
        """Send a batch; return how many datagrams the kernel took."""
        fd, parts = source.fileno(), batch.parts
        number, end, sent, is_retry = batch.first, batch.first + batch.parts_count, 0, False
        while number < end:
            count, error = batch_io.send(
                fd, to, parts.packed, parts.body, parts.cut.part_size, number, end - number
            )
            number, sent = number + count, sent + count
            if count:
                is_retry = False
            if error:
                is_retry = retry(error) and not is_retry
                number += not is_retry  # skip this one
        return sent


class PortableBatches:
    """Batches by one system call a datagram."""

    def __init__(self) -> None:
        self.drops = 0
        """Datagrams that the kernel dropped for lack of buffer, as last reported."""
        self.credit_store: Optional[CreditStore] = None
        self._rest = bytearray(_REST_BYTES)

    def use_small_topics(self, small: SmallTopics) -> None:
        """Do nothing: all datagrams are returned as such."""

    def receive(
        self, source: socket.socket, slots: ReceiveSlots, credits: CreditState
    ) -> ReceiveResult:
        """Return a single datagram; None if nothing was received."""
        room = slots.part_size if slots.arrived else 0
        head = bytearray(len(slots.header) if slots.arrived else 0)
        start = slots.next_part * slots.part_size
        with memoryview(slots.block)[start : start + room] as slot:
            buffers: List[Union[bytearray, memoryview]] = [head, slot, self._rest]
            try:
                size, ancillary, _, sender = source.recvmsg_into(buffers, _ANCILLARY_BYTES)
            except OSError as error:
                return None, error.errno or -1
            if sender is None:  # the socket was shut
                return None, -1
            self.drops = _drops_in(ancillary, self.drops)
            if size > len(head) and slots.matches(bytes(head), size, sender):
                number, body_size = head[PART_NUMBER_OFFSET], size - len(head)
                if number != slots.next_part:
                    start = number * slots.part_size
                    with memoryview(slots.block)[start : start + body_size] as right_slot:
                        right_slot[:] = slot[:body_size]
                is_last = number == len(slots.arrived) - 1
                last_size = body_size if is_last else slots.part_size
                uncredited = credits.uncredited_bytes + size
                ranges = ((number, 1),)
                return PartBatch(bytes(head), ranges, last_size, 0, uncredited, None, None), 0
            beyond = max(0, size - len(head) - room)
            unmatched = b"".join((head, slot, memoryview(self._rest)[:beyond]))[:size]
        return PartBatch(b"", (), 0, 0, credits.uncredited_bytes, unmatched, sender), 0

    def small_sender(self, source: socket.socket) -> SendSmall:
        """Return a function that sends messages of one part."""

        def send(
            to: Address, packed: bytes, most: int, number: int, stamp_nanos: int, body: Buffer
        ) -> int:
            view = flat(body)
            if view.nbytes > most or not is_stamp(stamp_nanos):
                return -1
            try:
                datagram = restamped(packed, number, stamp_nanos), view
                source.sendmsg(datagram, [], socket.MSG_DONTWAIT, to)
            except OSError:
                return -1
            return view.nbytes

        return send

    def large_sender(self, *_: Any) -> Optional[SendLarge]:
        """Return None: such messages are sent in batches."""
        return None

    def send(
        self, source: socket.socket, batch: OutgoingBatch, to: Address, retry: RetryPolicy
    ) -> int:
        """Send a batch; return how many datagrams the kernel took."""
        parts, sent = batch.parts, 0
        for number in range(batch.first, batch.first + batch.parts_count):
            buffers = datagram_of(parts.packed, parts.body, parts.cut, number)
            for _ in range(2):
                try:
                    source.sendmsg(buffers, [], 0, to)
                    sent += 1
                    break
                except OSError as error:
                    if not retry(error.errno or 0):
                        break
        return sent


class UdpSocket:
    """A bound, connectionless socket. One thread may receive while another one sends.

    Raises
    ------
    OSError
        When the address can't be resolved or bound.
    """

    def __init__(self, bind: Address, *, receive_buffer: int, wait_s: float) -> None:
        self.overhead = 0
        """Bytes that are added to each datagram that is sent."""
        self.kernel_drops = 0
        """Datagrams that the kernel dropped because the receive buffer was full."""
        self._unreachable = 0
        self._unsent = unsent = [0]  # by `send_large`, which must not refer to this socket
        self._batches: Union[NativeBatches, PortableBatches] = (
            NativeBatches() if batch_io is not None else PortableBatches()
        )
        self.use_small_topics = self._batches.use_small_topics
        self.credit_store = self._batches.credit_store
        """Keeps Credits for the sender; None without the C extension."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._set_up(receive_buffer, wait_s)
            self._socket.bind(bind)
        except OSError as error:
            self._socket.close()
            why = error.strerror or error
            raise OSError(error.errno, f"can't bind to {bind[0]}:{bind[1]}: {why}") from None
        self.send_small = self._batches.small_sender(self._socket)
        """See `sender.direct_senders.SendSmall`."""
        self.send_large = self._batches.large_sender(self._socket, partial(_add, unsent))
        """See `sender.direct_senders.SendLarge`; None without the C extension."""
        self.address: Address = self._socket.getsockname()
        self.receive_buffer: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        """Bytes of the receive buffer that the kernel granted, in kernel bytes."""

    @property
    def unreachable(self) -> int:
        """Datagrams that the peer's host or the network rejected."""
        return self._unreachable + self._unsent[0]

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None if nothing was received."""
        try:
            size, ancillary, _, sender = self._socket.recvmsg_into([buffer], _ANCILLARY_BYTES)
        except OSError:  # timeout, an ICMP error, or the socket was shut
            self._drain_errors()
            return None
        self.kernel_drops = _drops_in(ancillary, self.kernel_drops)
        if sender is None:  # the socket was shut
            return None
        return size, sender

    def receive_batch(self, slots: ReceiveSlots, credits: CreditState) -> Received:
        """Wait for the predicted parts or any other datagram; return None if nothing came.

        Parts are received into their slots and may be acknowledged. After `use_small_topics`, the
        datagram may be returned as its message.
        """
        batch, error = self._batches.receive(self._socket, slots, credits)
        self.kernel_drops = self._batches.drops or self.kernel_drops
        if batch is None or error not in (0, errno.EAGAIN):
            self._drain_errors()
        return batch

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram gathered from `buffers`; return whether the kernel took it."""
        for _ in range(2):
            try:
                self._socket.sendmsg(buffers, [], 0, to)
                return True
            except ConnectionRefusedError:
                # It reports an earlier datagram, perhaps to another peer; this one was not sent.
                self._drain_errors()
            except OSError:
                break
        self._unreachable += 1
        return False

    def send_batch(self, batch: OutgoingBatch, to: Address) -> int:
        """Send parts of a message; return how many the kernel took."""
        sent = self._batches.send(self._socket, batch, to, self._may_retry)
        self._unreachable += batch.parts_count - sent
        return sent

    def _may_retry(self, error_number: int) -> bool:
        if error_number != errno.ECONNREFUSED:
            return False
        self._drain_errors()  # it reports an earlier datagram; this one was not sent
        return True

    def shut(self) -> None:
        """Wake the receiving thread; sending still works."""
        try:
            self._socket.shutdown(socket.SHUT_RD)
        except OSError:
            pass  # expected of an unconnected socket; waiting threads wake anyway

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _set_up(self, receive_buffer: int, wait_s: float) -> None:
        set_option = self._socket.setsockopt
        # Linux grants twice what is requested and counts its own overhead in it.
        wanted = receive_buffer // 2 if _IS_LINUX else receive_buffer
        set_option(socket.SOL_SOCKET, socket.SO_RCVBUF, wanted)
        seconds, fraction = divmod(wait_s, 1)
        timeval = struct.pack("@ll", int(seconds), int(fraction * 1e6))
        set_option(socket.SOL_SOCKET, socket.SO_RCVTIMEO, timeval)
        if _IS_LINUX:
            set_option(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            set_option(socket.IPPROTO_IP, _IP_RECVERR, 1)
            try:
                set_option(socket.SOL_SOCKET, _SO_RCVBUFFORCE, wanted)
            except PermissionError:
                pass  # the system's limit applies; see `receive_buffer`

    def _drain_errors(self) -> None:
        """Count and remove queued ICMP errors, which would take room in the receive buffer."""
        if not _IS_LINUX:
            return
        try:
            while True:
                self._socket.recvmsg(0, 0, socket.MSG_ERRQUEUE | socket.MSG_DONTWAIT)
                self._unreachable += 1
        except OSError:
            pass


def _add(total: List[int], count: int) -> None:
    total[0] += count


def _drops_in(ancillary: Sequence[Tuple[int, int, bytes]], drops: int) -> int:
    """Return the kernel's drop count beside a datagram, or else `drops`."""
    for level, kind, data in ancillary:
        if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
            (drops,) = _DROP_COUNT.unpack(data)
    return drops


def buffer_hint(granted: int, wanted: int = RECOMMENDED_BUFFER) -> str:
    """Return a line that tells how to raise the receive buffer; empty if it is large enough."""
    if granted >= wanted or not _IS_LINUX:
        return ""
    return (
        f"the receive buffer is {granted} bytes instead of {wanted}; large messages will be slower."
        f" Fix: sysctl -w net.core.rmem_max={wanted // 2}"
    )


def resolve(address: Address) -> Address:
    """Return the numeric IPv4 address of a host, as senders are identified.

    Raises
    ------
    OSError
        When the host is unknown.
    """
    try:
        found = socket.getaddrinfo(address[0], address[1], socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise OSError(f"no IPv4 address for {address[0]}:{address[1]}: {why}") from None
    host, port = found[0][4][:2]
    return str(host), int(port)
