# SPDX-License-Identifier: Apache-2.0
"""Local streams: frequent small messages between processes of one machine, without the router.

A publisher offers its messages at a Unix socket and announces the socket on the bus. A subscriber
that can connect takes its messages there. One that cannot, on another machine or in another
container, gets the same messages by the router. On the way of a message are one thread and one
context switch instead of five and eight.
"""

import os
import queue
import secrets
import socket
import struct
import threading
from collections import deque
from collections.abc import Callable

from .channel import WAKE_SECONDS, PayloadSource

QUEUED = 4096
"""Messages that wait for a receiver that is too slow for its socket; then the oldest is dropped."""

LARGEST_BYTES = 1 << 17
"""Largest message, for which a socket's default buffer has room. A stream ends with a larger one,
and the router takes over."""


_TIMEOUT = struct.pack("ll", 0, round(WAKE_SECONDS * 1e6))


def _address(name: str) -> str:
    """Return an address in the abstract namespace, which containers do not share."""
    return f"\0groundlink-{name}"


def _is_own(peer: socket.socket) -> bool:
    """Return whether the process at the other end belongs to the same user."""
    credentials = peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    _, uid, _ = struct.unpack("3i", credentials)
    return bool(uid == os.getuid())


class _Receiver:
    """The connection to one subscriber. Sending never waits."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._queue: deque[bytes] = deque(maxlen=QUEUED)
        self._lock = threading.Lock()
        self._is_draining = False
        self.is_gone = False

    def send(self, payload: bytes) -> None:
        with self._lock:
            if self._is_draining:
                self._queue.append(payload)
                return
            try:
                self._connection.send(payload, socket.MSG_DONTWAIT)
            except BlockingIOError:
                self._queue.append(payload)
                self._is_draining = True
                threading.Thread(target=self._drain, daemon=True).start()
            except OSError:
                self.close()

    def _drain(self) -> None:
        """Send what waits, as fast as the receiver takes it."""
        while True:
            with self._lock:
                if not self._queue:
                    self._is_draining = False
                    return
                payload = self._queue.popleft()
            try:
                self._connection.send(payload)
            except OSError:
                self.close()
                return

    def close(self) -> None:
        self.is_gone = True
        self._connection.close()


class LocalStream:
    """The sending end: all subscribers on this machine.

    Attributes
    ----------
    name
        of the socket, to be announced.
    """

    def __init__(self) -> None:
        self.name = secrets.token_hex(16)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._listener.bind(_address(self.name))
        self._listener.listen()
        self._listener.setblocking(False)
        self._receivers: list[_Receiver] = []

    def send(self, payload: bytes) -> None:
        """Send a message to all that have connected."""
        if len(payload) > LARGEST_BYTES:
            self.undeclare()
        try:
            connection, _ = self._listener.accept()
        except OSError:
            pass  # nobody has connected, or the stream has ended
        else:
            connection.setblocking(True)
            if _is_own(connection):
                self._receivers.append(_Receiver(connection))
            else:
                connection.close()
        for receiver in self._receivers:
            receiver.send(payload)
        if any(receiver.is_gone for receiver in self._receivers):
            self._receivers = [each for each in self._receivers if not each.is_gone]

    def undeclare(self) -> None:
        """Close all connections."""
        self._listener.close()
        for receiver in self._receivers:
            receiver.close()


class LocalSource:
    """The receiving end (a `PayloadSource`): messages of the router until a publisher is local.

    No message is lost or repeated by the change. The publisher sends each message to its socket
    first, so what comes by the router has come by the socket or is from before the connection.

    Parameters
    ----------
    declare
        subscribes by the router.
    """

    def __init__(self, declare: Callable[[], PayloadSource]) -> None:
        self._declare = declare
        self._routed: PayloadSource | None = declare()
        self._offered: queue.SimpleQueue[socket.socket] = queue.SimpleQueue()
        self._local: socket.socket | None = None
        self._ahead: deque[bytes] = deque(maxlen=QUEUED)
        """Messages of the socket that the router has still to deliver, or that are next."""

        self._is_cut_off = False

    def found(self, name: str) -> None:
        """Connect to a publisher that has announced itself, if it is on this machine."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        # A timeout of Python's would wait even with MSG_DONTWAIT.
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _TIMEOUT)
        try:
            connection.connect(_address(name))
        except OSError:
            connection.close()
            return
        if _is_own(connection):
            self._offered.put(connection)
        else:
            connection.close()

    def cut_off(self) -> None:
        """Leave the publisher: the router is lost, and with it the rest of the run."""
        self._is_cut_off = True

    def receive(self) -> bytes:
        """Return the next payload; an empty one if none has come for `WAKE_SECONDS` or less."""
        return self._next(0) or b""

    def poll(self) -> bytes | None:
        """Return the next payload that has come; None if there is none."""
        return self._next(socket.MSG_DONTWAIT)

    def undeclare(self) -> None:
        """Receive no more."""
        while not self._offered.empty():
            self._offered.get().close()
        for source in (self._routed, self._local):
            if isinstance(source, socket.socket):
                source.close()
            elif source is not None:
                source.undeclare()

    def _next(self, flags: int) -> bytes | None:
        if self._routed is not None:
            self._is_cut_off = False
            payload = self._routed.poll() if flags else self._routed.receive()
            if payload:
                self._join(self._routed, payload)
            return payload
        return self._ahead.popleft() if self._ahead else self._taken(flags)

    def _taken(self, flags: int) -> bytes | None:
        """Return the next payload of the socket; at its end, go back to the router."""
        assert self._local is not None
        payload = b""
        if not self._is_cut_off:
            try:
                payload = self._local.recv(LARGEST_BYTES, flags)
            except BlockingIOError:
                return None
            except OSError:
                pass  # the publisher was killed
        if not payload:
            self._local.close()
            self._local = None
            if self._routed is None:
                self._routed = self._declare()
        return payload or None

    def _join(self, routed: PayloadSource, payload: bytes) -> None:
        """Change to the socket if it has had this payload of the router, too."""
        while not self._offered.empty():
            if self._local is not None:
                self._local.close()
            self._local = self._offered.get()
            self._ahead.clear()
        while self._local is not None and (taken := self._taken(socket.MSG_DONTWAIT)):
            self._ahead.append(taken)
        if self._local is not None and payload in self._ahead:
            while self._ahead.popleft() != payload:
                pass  # the router has delivered it
            self._routed = None
            routed.undeclare()
