# SPDX-License-Identifier: Apache-2.0
"""System tests of a ROS 2 node with a wrong or missing key: no data, and logs at both ends."""

import struct
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.bus.core_topics import COMMAND
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.messages.base import Command
from udp_bridge import Link
from udp_bridge.io.address_guard import open_socket
from udp_bridge.wire.seal import FROM_ROS
from udp_bridge.wire.types import type_number

from .rig import Rig, rig, wait_for

pytestmark = pytest.mark.system

KEYS = {"right": "11" * 32, "wrong": "22" * 32, "no": ""}
REFUSED = {
    "wrong": ("bad_tag: the other end has another key", "bad_tag: the other end has another key"),
    "no": (
        "sealed: the other end has a key and this one has none",
        "unsealed: this end has a key and the other one has none",
    ),
}
"""What the node says of the gateway's datagrams, and the gateway of the node's."""

TWIST = b"\0\1\0\0" + struct.pack("<6d", 0.5, 0, 0, 0, 0, 0)


@pytest.fixture
def sealed(tmp_path: Path) -> Iterator[Rig]:
    """A run of physics and a gateway that has a key."""
    for name, key in KEYS.items():
        (tmp_path / name).write_text(key)
        (tmp_path / name).chmod(0o600)
    with rig(tmp_path) as it:
        words = (str(it.scenario), "--run", it.run, "--listen", it.endpoint)
        it.start("-m", "services.physics", *words, log="physics.log")
        wait_for(it.is_answered, 30, "physics listens")
        key = ("--key-file", str(tmp_path / "right"))
        it.start("-m", "services.gateway", "--connect", it.endpoint, *key, log="gateway.log")
        yield it


def key_words(it: Rig, whose: str) -> tuple[str, ...]:
    return ("--key-file", str(it.folder / whose)) if KEYS[whose] else ()


def write(it: Rig, whose: str) -> None:
    """Send the gateway what a node with this key sends of a Twist."""
    key, here = bytes.fromhex(KEYS[whose]), ("127.0.0.1", 0)
    socket = open_socket(here, secret=key, sends=FROM_ROS) if key else None
    with Link(here, it.bind, socket=socket) as link:
        link.send(type_number("Twist"), "/cmd_vel", "", time.time_ns(), TWIST)
        assert link.flush(5)


def says(it: Rig, log: str, why: str) -> None:
    """Wait until a process has said once why it refuses datagrams."""
    wait_for(lambda: why in it.log(log), 20, f"{log}: {why}")
    assert it.log(log).count("refuses datagrams as " + why.partition(":")[0]) == 1


def test_without_the_key_a_node_neither_reads_nor_writes_and_both_ends_say_why(
    sealed: Rig,
) -> None:
    commands = BusInbox[Command](depth=8)
    with Bus(connect=sealed.endpoint) as bus:
        bus.subscribe(COMMAND.key_in(sealed.run), Command, commands)
        for whose, (by_node, by_gateway) in REFUSED.items():
            words = ("--bind", sealed.address(sealed.peer), *key_words(sealed, whose))
            node = sealed.start("-m", "udp_bridge_ros2", *words, log=f"{whose}.log")
            says(sealed, f"{whose}.log", by_node)
            write(sealed, whose)
            says(sealed, "gateway.log", by_gateway)
            node.terminate()
            node.wait(10)
            assert " 0 messages published on 0 topics, 0 sent back" in sealed.log(f"{whose}.log")
        assert not len(commands)
        write(sealed, "right")
        assert commands.get(seconds=10) is not None
