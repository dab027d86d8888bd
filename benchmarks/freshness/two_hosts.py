# SPDX-License-Identifier: Apache-2.0
"""Two emulated hosts on one machine, joined by the project's emulated link.

Each host is a network namespace with one TUN interface and uses the kernel's TCP. Every IP packet
between them passes `groundlink.emulation`, as datagrams do in the relay. The network ends with the
processes. It needs Linux and root, or user namespaces.
"""

import ctypes
import fcntl
import os
import select
import signal
import socket
import struct
import sys
import time
import traceback
from collections.abc import Callable

from groundlink.emulation.model import LinkDirection
from groundlink.emulation.settings import Impairment

HOSTS = ("10.77.0.1", "10.77.0.2")
_NEWUSER, _NEWNET = 0x10000000, 0x40000000
_TUNSETIFF = 0x400454CA
_TUN_WITHOUT_PREFIX = 0x1001
_SIOCSIFADDR, _SIOCSIFDSTADDR, _SIOCSIFMTU, _SIOCSIFFLAGS = 0x8916, 0x8918, 0x8922, 0x8914
_UP_AND_RUNNING = 0x41
_INTERFACE, _LOOPBACK = b"tun0", b"lo"
_MOST_PACKET = 1 << 16
_QUEUE_PACKETS = 1000
_SIOCSIFTXQLEN = 0x8943


class NotAllowed(OSError):
    """The system lets this process make no network of its own; the text says what it said."""


def run(
    programs: tuple[Callable[[], None], Callable[[], None]],
    impairment: Impairment,
    *,
    mtu: int,
    seconds: float,
    seed: int = 1,
) -> tuple[LinkDirection[None], LinkDirection[None]]:
    """Run a program on each host and return what the link did, each way.

    It ends after some seconds, or when the second host's program does.

    Parameters
    ----------
    programs
        What to run on `HOSTS[0]` and `HOSTS[1]`, in processes of their own that are ended.
    mtu
        Largest IP packet in bytes.

    Raises
    ------
    NotAllowed
        When no network can be made.
    """
    children, files = [], []
    try:
        for index, program in enumerate(programs):
            here, there = socket.socketpair()
            child = os.fork()
            if not child:
                _be_host(index, program, mtu, there)
            there.close()
            children.append(child)
            said, descriptors, _, _ = socket.recv_fds(here, 1000, 1)
            here.close()
            if not descriptors:
                raise NotAllowed(said.decode() or "the process of a host ended")
            files += descriptors
        files.append(os.pidfd_open(children[1]))
        return _join(files, impairment, seconds=seconds, seed=seed)
    finally:
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
        for file in files:
            os.close(file)


def _join(
    files: list[int], impairment: Impairment, *, seconds: float, seed: int
) -> tuple[LinkDirection[None], LinkDirection[None]]:
    """Carry packets both ways until the time is over, or the second host's process."""
    first, second, end_of_second = files
    there: LinkDirection[None] = LinkDirection(impairment, seed=seed, direction="there")
    back: LinkDirection[None] = LinkDirection(impairment, seed=seed, direction="back")
    ways = ((first, second, there), (second, first, back))
    end = time.monotonic_ns() + round(seconds * 1e9)
    while (now := time.monotonic_ns()) < end:
        due = min((way.next_due() or end for _, _, way in ways), default=end)
        wait = max(0, min(due, end) - now) / 1e9
        readable, _, _ = select.select(files, [], [], wait)
        if end_of_second in readable:
            break
        for source, to, way in ways:
            if source in readable:
                way.put(os.read(source, _MOST_PACKET), None, time.monotonic_ns())
            while (arrived := way.take(time.monotonic_ns())) is not None:
                os.write(to, arrived[1])
    return there, back


def _be_host(index: int, program: Callable[[], None], mtu: int, parent: socket.socket) -> None:
    """Make this forked process a host and run the program on it; never returns."""
    try:
        try:
            tunnel = _network(HOSTS[index], HOSTS[1 - index], mtu)
        except OSError as error:
            parent.send(f"no network of its own: {error}".encode())
            os._exit(1)
        socket.send_fds(parent, [b"ready"], [tunnel])
        program()
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    os._exit(0)


def _network(address: str, peer: str, mtu: int) -> int:
    """Leave the network of the machine and return the TUN interface of a new one."""
    libc = ctypes.CDLL(None, use_errno=True)
    flags = _NEWNET if os.geteuid() == 0 else _NEWNET | _NEWUSER
    if libc.unshare(flags):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    tunnel = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(tunnel, _TUNSETIFF, struct.pack("16sH22x", _INTERFACE, _TUN_WITHOUT_PREFIX))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        up = struct.pack("h", _UP_AND_RUNNING)
        for interface, request, value in (
            (_INTERFACE, _SIOCSIFADDR, _address(address)),
            (_INTERFACE, _SIOCSIFDSTADDR, _address(peer)),
            (_INTERFACE, _SIOCSIFMTU, struct.pack("i", mtu)),
            (_INTERFACE, _SIOCSIFTXQLEN, struct.pack("i", _QUEUE_PACKETS)),
            (_INTERFACE, _SIOCSIFFLAGS, up),
            (_LOOPBACK, _SIOCSIFFLAGS, up),
        ):
            fcntl.ioctl(control, request, struct.pack("16s24s", interface, value))
    return tunnel


def _address(host: str) -> bytes:
    return struct.pack("HH4s", socket.AF_INET, 0, socket.inet_aton(host))
