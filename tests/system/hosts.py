# SPDX-License-Identifier: Apache-2.0
"""Emulated hosts with separate networks on this machine, connected by a switch.

Cables can be disconnected. Each host is a network namespace of the kernel with its own `/dev/shm`;
otherwise Zenoh would use shared memory for large messages and bypass the cable. The switch is a
network namespace, too. The machine's own network stays unchanged. All namespaces end with the
processes that hold them.
"""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from groundlink.monitor.supervisor import end_with_parent

_ANCHOR = (
    *("unshare", "--net", "--mount", "sh", "-c"),
    "mount -t tmpfs none /dev/shm && echo && exec sleep infinity",
)


class Hosts:
    """Some hosts by name; the first has the address 10.88.0.1, and so on."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._anchors = {name: _anchor() for name in ("switch", *names)}
        self.addresses = {name: f"10.88.0.{number}" for number, name in enumerate(names, 1)}
        self._in("switch", "ip link add name backbone type bridge")
        self._in("switch", "ip link set dev backbone up")
        for name, address in self.addresses.items():
            there = self._anchors[name].pid
            self._in("switch", f"ip link add name {name} type veth peer name eth0 netns {there}")
            self._in("switch", f"ip link set dev {name} master backbone up")
            self._in(name, f"ip address add {address}/24 dev eth0")
            self._in(name, "ip link set dev eth0 up")
            self._in(name, "ip link set dev lo up")

    def inside(self, name: str) -> tuple[str, ...]:
        """Return the words by which a command is run on a host."""
        host = f"--target={self._anchors[name].pid}"
        return ("nsenter", host, "--net", "--mount", f"--wd={os.getcwd()}", "--")

    def cut(self, name: str) -> None:
        """Pull a host's cable out of the switch; the host does not see it."""
        self._in("switch", f"ip link set dev {name} nomaster")

    def restore(self, name: str) -> None:
        """Put it in again."""
        self._in("switch", f"ip link set dev {name} master backbone")

    def close(self) -> None:
        """End what holds the namespaces."""
        for anchor in self._anchors.values():
            anchor.kill()
            anchor.wait()

    def _in(self, name: str, command: str) -> None:
        subprocess.run([*self.inside(name), *command.split()], check=True, timeout=10)


def _anchor() -> subprocess.Popen[str]:
    """Return a process that holds a network and a memory of its own, which are there already."""
    anchor = subprocess.Popen(
        _ANCHOR,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=end_with_parent,
    )
    assert anchor.stdout is not None
    with anchor.stdout as said:
        said.readline()
    return anchor


@contextmanager
def hosts(*names: str) -> Iterator[Hosts]:
    """Make hosts; without root and the tools for it the test is skipped."""
    lacking = [tool for tool in ("ip", "nsenter", "unshare") if shutil.which(tool) is None]
    if os.geteuid() or lacking:
        said = f"networks of their own need {' and '.join(lacking) or 'root'}"
        pytest.skip(said)
    made = Hosts(names)
    try:
        yield made
    finally:
        made.close()
