# SPDX-License-Identifier: Apache-2.0
"""A socket that loses a share of what comes to it, in the kernel, so that it costs no time.

Linux runs a filter of four instructions for each datagram (a classic BPF program; nobody needs a
privilege for that). It counts what it drops as if the receive buffer had been full.
"""

from __future__ import annotations

import ctypes
import os
import socket
import struct

from udp_bridge.io.udp_socket import UdpSocket

_SO_ATTACH_FILTER = 26
_INSTRUCTION = struct.Struct("=HBBI")
_PROGRAM = struct.Struct("@HP")
_LOAD, _JUMP_IF_AT_LEAST, _RETURN = 0x20, 0x35, 0x06
_RANDOM = 0xFFFFF000 + 56  # SKF_AD_OFF + SKF_AD_RANDOM: 32 random bits
_ALL = 0xFFFFFFFF


def lossy_socket(share: float, *, receive_buffer: int) -> UdpSocket:
    """Return a bound socket that loses `share` of the datagrams that come to it."""
    bound = UdpSocket(("127.0.0.1", 0), receive_buffer=receive_buffer, wait_s=0.1)
    program = [
        (_LOAD, 0, 0, _RANDOM),
        (_JUMP_IF_AT_LEAST, 1, 0, round(share * 2**32)),
        (_RETURN, 0, 0, 0),
        (_RETURN, 0, 0, _ALL),
    ]
    code = ctypes.create_string_buffer(b"".join(_INSTRUCTION.pack(*row) for row in program))
    same = socket.socket(fileno=os.dup(bound._socket.fileno()))
    with same:
        option = _PROGRAM.pack(len(program), ctypes.addressof(code))
        same.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, option)
    return bound
