# SPDX-License-Identifier: Apache-2.0
"""The socket itself: its options, and what the kernel tells about losses. No threads, no messages.

IPv4 on POSIX systems. Linux also tells of datagrams that it dropped for want of buffer and of
peers that are not there; elsewhere these counts stay 0.
"""

from __future__ import annotations

import errno
import socket
import struct
import sys
from typing import Optional, Protocol, Sequence, Tuple, Union

from udp_bridge.receiver.receive_slots import CreditState, PartBatch, ReceiveSlots
from udp_bridge.sender.outgoing import Run as Leaving
from udp_bridge.wire.header import Buffer
from udp_bridge.wire.message import Address

from . import batch_io as runs

_IS_LINUX = sys.platform == "linux"
_SO_RCVBUFFORCE = 33  # Linux numbers that the socket module does not name in every version
_SO_RXQ_OVFL = 40
_IP_RECVERR = 11
_DROP_COUNT = struct.Struct("=I")
ENOUGH_BUFFER = 8 << 20
"""What links ask for; in half of it 60 datagrams of 64 KB may be under way."""
_ANCILLARY_BYTES = 64
"""Room for the drop count beside a datagram."""


class DatagramSocket(Protocol):
    """What a link needs of its socket; also of what stands around one, such as `seal`.

    `UdpSocket` says what each member means. `receive_into` returns within about 0.1 s, with None
    when nothing came, and raises `Refused` when something came that must not be taken.
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


class UdpSocket:
    """A bound, connectionless socket; one thread may receive while another one sends.

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
        self.unreachable = 0
        """Datagrams that the peer's host or the network turned away."""
        self._runs: Union[runs.ManyAtOnce, runs.OneByOne] = runs.OneByOne()
        if runs.IS_BUILT:
            self._runs = runs.ManyAtOnce()
            self.park_credits = self._runs.park
            """Keep credits of a peer that look like one from now on; return what was kept."""
            self.parked_credits = self._runs.parked
            """Return the credits that were kept; while one is awaited, none is without an order."""
            self.order_run = self._runs.order
            """Send the rest of a message from `receive_run` as credits come that can be kept."""
            self.order_taken_back = self._runs.taken_back
            """Send no more; return how many parts were sent since the order was given."""
        self._sending: Union[runs.SendingMany, runs.SendingOne] = (
            runs.SendingMany() if runs.IS_BUILT else runs.SendingOne()
        )
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._set_up(receive_buffer, wait_s)
            self._socket.bind(bind)
        except OSError as error:
            self._socket.close()
            why = error.strerror or error
            raise OSError(error.errno, f"can't bind to {bind[0]}:{bind[1]}: {why}") from None
        self.address: Address = self._socket.getsockname()
        self.receive_buffer: int = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        """Bytes of the receive buffer that the kernel granted, as it accounts them."""

    def receive_into(self, buffer: bytearray) -> Optional[Tuple[int, Address]]:
        """Wait for a datagram; return its size and sender, or None when there was none."""
        try:
            size, ancillary, _, sender = self._socket.recvmsg_into([buffer], _ANCILLARY_BYTES)
        except OSError:  # time is over, an absent peer's host answered, or the socket was shut
            self._drain_errors()
            return None
        for level, kind, data in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL:
                (self.kernel_drops,) = _DROP_COUNT.unpack(data)
        if sender is None:  # so does the kernel tell that the socket was shut
            return None
        return size, sender

    def receive_run(self, place: ReceiveSlots, credits: CreditState) -> Optional[PartBatch]:
        """Wait for what is expected, or for anything else; return None when nothing came.

        Parts are put into their places, and may be acknowledged.
        """
        run, error = self._runs.receive(self._socket, place, credits)
        self.kernel_drops = self._runs.drops or self.kernel_drops
        if run is None or error not in (0, errno.EAGAIN):
            self._drain_errors()
        return run

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Send one datagram gathered from `buffers`; return whether the kernel took it."""
        for _ in range(2):
            try:
                self._socket.sendmsg(buffers, [], 0, to)
                return True
            except ConnectionRefusedError:
                # This tells of an earlier datagram, perhaps to another peer; ours was not sent.
                self._drain_errors()
            except OSError:
                break
        self.unreachable += 1
        return False

    def send_run(self, run: Leaving, to: Address) -> int:
        """Send parts of a message; return how many the kernel took."""
        sent = self._sending.send(self._socket, run, to, self._may_try_again)
        self.unreachable += run.parts_count - sent
        return sent

    def _may_try_again(self, error_number: int) -> bool:
        if error_number != errno.ECONNREFUSED:
            return False
        self._drain_errors()  # it tells of an earlier datagram; this one was not sent
        return True

    def shut(self) -> None:
        """Wake the thread that receives."""
        try:
            self._socket.shutdown(socket.SHUT_RD)  # last reports are yet to be sent
        except OSError:
            pass  # an unconnected socket has nothing to shut down, but waiting threads do wake

    def close(self) -> None:
        """Give the socket back."""
        self._socket.close()

    def _set_up(self, receive_buffer: int, wait_s: float) -> None:
        set_option = self._socket.setsockopt
        # Linux grants twice what is asked for, and counts its own overhead in what it granted.
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
                pass  # the system's limit holds; `receive_buffer` tells

    def _drain_errors(self) -> None:
        """Count and forget what hosts answered; kept, it would take room in the buffer."""
        if not _IS_LINUX:
            return
        try:
            while True:
                self._socket.recvmsg(0, 0, socket.MSG_ERRQUEUE | socket.MSG_DONTWAIT)
                self.unreachable += 1
        except OSError:
            pass


def buffer_hint(granted: int, wanted: int = ENOUGH_BUFFER) -> str:
    """Return a line that says how to raise a receive buffer; empty when it is large enough."""
    if granted >= wanted or not _IS_LINUX:
        return ""
    return (
        f"the receive buffer is {granted} bytes instead of {wanted}; large messages will be slower;"
        f" raise it by: sysctl -w net.core.rmem_max={wanted // 2}"
    )


def resolve(address: Address) -> Address:
    """Return the numeric IPv4 address of a host, which is what senders are known by.

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
