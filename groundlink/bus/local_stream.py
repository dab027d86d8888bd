# SPDX-License-Identifier: Apache-2.0
"""Local streams: messages between processes of one machine, without the router.

A publisher offers its messages at a Unix socket and announces the socket on the bus. A subscriber
that can connect takes its messages there. One that cannot, on another machine or in another
container, gets the same messages by the router. On the way of a message are one thread and one
context switch instead of five and eight. Large messages are in shared memory (`shared_slots`); the
socket says where.
"""

import os
import queue
import secrets
import select
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

from groundlink.messages.base import LARGE_BYTES

from .channel import WAKE_SECONDS, Payload, PayloadSource
from .shared_slots import Pieces, SlotPool, SlotReader, SocketFrame, is_frame
from .zenoh_config import ROUTER_WAIT_SECONDS

QUEUED = 4096
"""Messages that wait for a receiver that is too slow for its socket; then the oldest is dropped."""

RETRY_MILLIS = 1
"""Time between two looks for a free slot."""

_FILE = struct.Struct("i")
_BESIDE_BYTES = socket.CMSG_SPACE(_FILE.size)
"""Room for a file descriptor beside a message of a socket."""

_TIMEOUT = struct.pack("ll", 0, round(WAKE_SECONDS * 1e6))


def _address(name: str) -> str:
    """Return an address in the abstract namespace, which containers do not share."""
    return f"\0groundlink-{name}"


def _is_own(peer: socket.socket) -> bool:
    """Return whether the process at the other end belongs to the same user."""
    credentials = peer.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize("3i"))
    _, uid, _ = struct.unpack("3i", credentials)
    return bool(uid == os.getuid())


def _files_in(beside: Sequence[tuple[int, int, bytes]]) -> list[int]:
    """Return the file descriptors that came beside a message."""
    return [
        file
        for level, kind, data in beside
        if (level, kind) == (socket.SOL_SOCKET, socket.SCM_RIGHTS)
        for (file,) in _FILE.iter_unpack(data)
    ]


class _Receiver:
    """The connection to one subscriber.

    Sending waits only for a free slot for a large message, as long as a router would wait for the
    receiver; then the connection is closed.
    """

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._pool = SlotPool()
        self._queue: deque[SocketFrame] = deque()
        self._lock = threading.Lock()
        self._is_draining = False
        self.is_gone = False

    def send(self, pieces: Pieces) -> None:
        if sum(map(len, pieces)) <= LARGE_BYTES:
            self._send(SocketFrame(b"".join(pieces)))
        elif (frame := self._written(pieces)) is not None:
            self._send(frame)
        else:
            self.close()

    def _written(self, pieces: Pieces) -> SocketFrame | None:
        """Write a message into a slot; return its frame, or None if that is not possible."""
        deadline, end_of_it = 0.0, select.poll()
        try:
            while (frame := self._pool.write(pieces)) is None:
                if not deadline:
                    deadline = time.monotonic() + ROUTER_WAIT_SECONDS
                    end_of_it.register(self._connection, 0)
                if end_of_it.poll(RETRY_MILLIS) or time.monotonic() > deadline:
                    return None
        except OSError:  # no memory, or no file descriptors
            return None
        return frame

    def _send(self, frame: SocketFrame) -> None:
        with self._lock:
            if self._is_draining:
                if len(self._queue) == QUEUED:
                    self._pool.withdraw(self._queue.popleft())
                self._queue.append(frame)
                return
            try:
                self._pass(frame, socket.MSG_DONTWAIT)
            except BlockingIOError:
                self._queue.append(frame)
                self._is_draining = True
                threading.Thread(target=self._drain, daemon=True).start()
            except OSError:
                self.close()

    def _pass(self, frame: SocketFrame, flags: int = 0) -> None:
        payload, file = frame
        if file is None:
            self._connection.send(payload, flags)
        else:
            # `send_fds` of Python 3.11 ignores flags, as does `recv_fds`.
            files = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, _FILE.pack(file))]
            self._connection.sendmsg([payload], files, flags)

    def _drain(self) -> None:
        """Send what waits, as fast as the receiver takes it."""
        while True:
            with self._lock:
                if not self._queue:
                    self._is_draining = False
                    return
                frame = self._queue.popleft()
            try:
                self._pass(frame)
            except OSError:
                self.close()
                return

    def close(self) -> None:
        self.is_gone = True
        self._connection.close()

    def free(self) -> None:
        """Close the slots of a connection that is closed."""
        self._pool.close()


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
        self._offers = select.poll()
        self._offers.register(self._listener, select.POLLIN)
        self._receivers: list[_Receiver] = []

    def send(self, *pieces: Payload) -> None:
        """Send a message, in pieces, to all that have connected."""
        if self._offers.poll(0):
            connection, _ = self._listener.accept()
            if _is_own(connection):
                self._receivers.append(_Receiver(connection))
            else:
                connection.close()
        for receiver in self._receivers:
            receiver.send(pieces)
        for receiver in [each for each in self._receivers if each.is_gone]:
            receiver.free()
            self._receivers.remove(receiver)

    def undeclare(self) -> None:
        """Close all connections."""
        self._offers = select.poll()
        self._listener.close()
        for receiver in self._receivers:
            receiver.close()
            receiver.free()
        self._receivers.clear()


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
        self._slots = SlotReader()
        self._ahead: deque[Payload] = deque(maxlen=QUEUED)
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

    @property
    def connection(self) -> socket.socket | None:
        """The socket by which messages come; None if by the router."""
        return self._local if self._routed is None and not self._ahead else None

    def cut_off(self) -> None:
        """Leave the publisher: the router is lost, and with it the rest of the run."""
        self._is_cut_off = True

    def receive(self) -> Payload:
        """Return the next payload; an empty one if none has come for `WAKE_SECONDS` or less."""
        return self._next(0) or b""

    def poll(self) -> Payload | None:
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

    def _next(self, flags: int) -> Payload | None:
        if self._routed is not None:
            self._is_cut_off = False
            payload = self._routed.poll() if flags else self._routed.receive()
            if payload:
                self._join(self._routed, payload)
            return payload
        return self._ahead.popleft() if self._ahead else self._taken(flags)

    def _taken(self, flags: int) -> Payload | None:
        """Return the next payload of the socket; at its end, go back to the router.

        So it does at a message whose slot it cannot read.
        """
        assert self._local is not None
        payload: Payload = b""
        if not self._is_cut_off:
            try:
                payload, beside, _, _ = self._local.recvmsg(LARGE_BYTES, _BESIDE_BYTES, flags)
            except BlockingIOError:
                return None
            except OSError:
                pass  # the publisher was killed
            else:
                if is_frame(payload):
                    payload = self._slots.payload(payload, _files_in(beside)) or b""
        if not payload:
            self._local.close()
            self._local, self._slots = None, SlotReader()
            if self._routed is None:
                self._routed = self._declare()
        return payload or None

    def _join(self, routed: PayloadSource, payload: Payload) -> None:
        """Change to the socket if it has had this payload of the router, too."""
        while not self._offered.empty():
            if self._local is not None:
                self._local.close()
            self._local = self._offered.get()
            self._slots = SlotReader()
            self._ahead.clear()
        while self._local is not None and (taken := self._taken(socket.MSG_DONTWAIT)):
            self._ahead.append(taken)
        if self._local is not None and payload in self._ahead:
            while self._ahead.popleft() != payload:
                pass  # the router has delivered it
            self._routed = None
            routed.undeclare()
