# SPDX-License-Identifier: Apache-2.0
"""A socket that drops a share of the received datagrams in the kernel, at no cost of time.

Linux runs a classic BPF program of four instructions for each datagram, which needs no privilege.
Its drops are counted as if the receive buffer had been full.
"""

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
    """Return a bound socket that drops `share` of the received datagrams."""
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
