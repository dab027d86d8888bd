# SPDX-License-Identifier: Apache-2.0
"""The socket itself: its options, and what the kernel tells about losses. No threads, no messages.

IPv4 on POSIX systems. Linux also tells of datagrams that it dropped for want of buffer and of
peers that are not there; elsewhere these counts stay 0.
"""

from __future__ import annotations

import socket
import struct
import sys
from typing import Optional, Sequence, Tuple

from .header import Buffer
from .sending import Address

_IS_LINUX = sys.platform == "linux"
_SO_RCVBUFFORCE = 33  # Linux numbers that the socket module does not name in every version
_SO_RXQ_OVFL = 40
_IP_RECVERR = 11
_DROP_COUNT = struct.Struct("=I")
_ANCILLARY_BYTES = 64
"""Room for the drop count beside a datagram."""


class UdpSocket:
    """A bound, connectionless socket; one thread may receive while another one sends.

    Raises
    ------
    OSError
        When the address can't be resolved or bound.
    """

    def __init__(self, bind: Address, *, receive_buffer: int, wait_s: float) -> None:
        self.kernel_drops = 0
        """Datagrams that the kernel dropped because the receive buffer was full."""
        self.unreachable = 0
        """Datagrams that the peer's host or the network turned away."""
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
        return size, sender

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

    def shut(self) -> None:
        """Wake the thread that receives."""
        try:
            self._socket.shutdown(socket.SHUT_RDWR)
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
