# SPDX-License-Identifier: Apache-2.0
"""Many datagrams in one call, by Linux's recvmmsg and sendmmsg; no rule of the wire is known here.

A Python thread that asks for each datagram has to get the interpreter each time, up to 5 ms if
another thread computes; one call for a run of datagrams asks once. Where the C library has no such
calls, or this is not CPython, `AVAILABLE` is false and `udp_socket` does without.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct
import sys
from array import array
from typing import Any, Dict, Tuple

Address = Tuple[str, int]

ENTRIES = 256
"""Datagrams that a table holds: one for each part that a message may have."""
MSG_WAITFORONE = 0x10000
HEADER_ROOM = 256
_NAME_ROOM = 16  # sockaddr_in
_CONTROL_ROOM = 32
_REST_ROOM = 65536
_ENTRY = struct.Struct("@PI4xPNPNi4xI4x")  # mmsghdr: name, its size, iovec, count, control, size,
_ENTRY_BYTES = 64  # flags; bytes received
_NAME = struct.Struct("!2xH4s8x")
_CACHED_NAMES = 256


def address_of(buffer: Any) -> int:
    """Return where a writable buffer lies; it must be kept, and at its size."""
    return ctypes.addressof((ctypes.c_char * len(buffer)).from_buffer(buffer))


def _load() -> Tuple[Any, Any]:
    if sys.platform != "linux" or sys.implementation.name != "cpython":
        return None, None
    if _ENTRY.size != _ENTRY_BYTES or sys.maxsize < 1 << 32:
        return None, None
    try:
        waiting, holding = ctypes.CDLL(None, use_errno=True), ctypes.PyDLL(None, use_errno=True)
        for library in (waiting, holding):
            common = (ctypes.c_int, ctypes.c_void_p, ctypes.c_uint, ctypes.c_int)
            library.recvmmsg.argtypes = (*common, ctypes.c_void_p)
            library.sendmmsg.argtypes = common
        return waiting, holding
    except (OSError, AttributeError):
        return None, None


_waiting, _holding = _load()
AVAILABLE = _waiting is not None and os.environ.get("UDP_BRIDGE_PLAIN") is None
"""Whether runs can be sent and received at once; UDP_BRIDGE_PLAIN=1 says no."""


class Table:
    """Message headers for the kernel, one for each of 256 datagrams, `vectors` buffers each."""

    def __init__(self, vectors: int) -> None:
        self.columns = 2 * vectors
        self.io = array("Q", bytes(8 * ENTRIES * self.columns))
        """Address and size of each buffer, row after row."""
        self._io_view = memoryview(self.io)
        self._entries = bytearray(_ENTRY_BYTES * ENTRIES)
        self.address = address_of(self._entries)
        self.sizes = memoryview(self._entries).cast("I")[14::16]
        """Bytes of each datagram that was received."""
        self.names = bytearray(_NAME_ROOM * ENTRIES)
        self.control = bytearray(_CONTROL_ROOM * ENTRIES)
        self._control_sizes = memoryview(self._entries).cast("Q")[5::8]
        io, names, control = (
            self.io.buffer_info()[0],
            address_of(self.names),
            address_of(self.control),
        )
        for entry in range(ENTRIES):
            _ENTRY.pack_into(
                self._entries,
                entry * _ENTRY_BYTES,
                names + entry * _NAME_ROOM,
                _NAME_ROOM,
                io + entry * self.columns * 8,
                vectors,
                control + entry * _CONTROL_ROOM,
                _CONTROL_ROOM,
                0,
                0,
            )
        self._template = bytes(self._entries)
        self._senders: Dict[bytes, Address] = {}

    def fill(self, column: int, first: int, start: int, count: int, step: int) -> None:
        """Write `start`, `start + step`, ... into a column of `count` rows from `first` on."""
        values = (
            array("Q", range(start, start + step * count, step))
            if step
            else array("Q", [start]) * count
        )
        columns = self.columns
        begin = first * columns + column
        self._io_view[begin : (first + count - 1) * columns + column + 1 : columns] = values

    def reset(self, first: int, count: int) -> None:
        """Make rows ready to be received into again."""
        begin, end = first * _ENTRY_BYTES, (first + count) * _ENTRY_BYTES
        self._entries[begin:end] = self._template[begin:end]

    def set_receiver(self, to: Address) -> None:
        """Write where all rows are sent to, and that they carry no ancillary data."""
        name = struct.pack("=H", socket.AF_INET) + _NAME.pack(to[1], socket.inet_aton(to[0]))[2:]
        self.names[:] = name * ENTRIES
        self._control_sizes[:] = memoryview(bytes(8 * ENTRIES)).cast("Q")

    def sender(self, row: int) -> Address:
        """Return where a row's datagram came from."""
        raw = bytes(self.names[row * _NAME_ROOM : (row + 1) * _NAME_ROOM])
        found = self._senders.get(raw)
        if found is None:
            port, host = _NAME.unpack(raw)
            if len(self._senders) >= _CACHED_NAMES:
                self._senders.clear()
            found = self._senders[raw] = (socket.inet_ntoa(host), port)
        return found

    def has_one_sender(self, first: int, end: int) -> bool:
        """Tell whether all datagrams of some rows came from the same address."""
        names = self.names[first * _NAME_ROOM : end * _NAME_ROOM]
        return names == names[:_NAME_ROOM] * (end - first)

    def control_of(self, row: int) -> bytes:
        """Return the ancillary data beside a row's datagram."""
        size = min(self._control_sizes[row], _CONTROL_ROOM)
        return bytes(self.control[row * _CONTROL_ROOM : row * _CONTROL_ROOM + size])


def receive(fd: int, table: Table, first: int, count: int, *, waits: bool) -> int:
    """Receive into rows; return how many, or a negative errno.

    Waiting for the first one lets other threads run. Without waiting the interpreter is kept:
    to give it away for microseconds may cost milliseconds until it is given back.
    """
    table.reset(first, count)
    rows = table.address + first * _ENTRY_BYTES
    if waits:
        taken: int = _waiting.recvmmsg(fd, rows, count, MSG_WAITFORONE, None)
    else:
        taken = _holding.recvmmsg(fd, rows, count, socket.MSG_DONTWAIT, None)
    return taken if taken >= 0 else -ctypes.get_errno()


def send(fd: int, table: Table, first: int, count: int) -> int:
    """Send rows; return how many the kernel took, or a negative errno."""
    taken: int = _waiting.sendmmsg(fd, table.address + first * _ENTRY_BYTES, count, 0)
    return taken if taken >= 0 else -ctypes.get_errno()


class _PyBuffer(ctypes.Structure):
    _fields_ = (
        ("buf", ctypes.c_void_p),
        ("obj", ctypes.py_object),
        ("len", ctypes.c_ssize_t),
        ("rest", ctypes.c_byte * 256),
    )


class Pinned:
    """The address of a bytes-like object, which holds while this lives."""

    def __init__(self, data: Any) -> None:
        self._buffer = _PyBuffer()
        ctypes.pythonapi.PyObject_GetBuffer(
            ctypes.py_object(data), ctypes.byref(self._buffer), ctypes.c_int(0)
        )
        self._is_held = True
        self.address: int = self._buffer.buf or 0

    def __del__(self) -> None:
        if getattr(self, "_is_held", False):
            self._is_held = False
            ctypes.pythonapi.PyBuffer_Release(ctypes.byref(self._buffer))
