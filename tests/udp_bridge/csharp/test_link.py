# SPDX-License-Identifier: Apache-2.0
"""The link in C#, with its socket and threads, against the link in Python."""

import subprocess
from pathlib import Path

from udp_bridge import Link, Message

from .programs import of_readme

RANGE, TWIST = 6, 9


def test_readme_program_sends_and_receives_by_a_link(library: Path) -> None:
    """A node that answers each range with a command; the program counts what arrived."""
    program = of_readme("Program", library)
    ranges: list[Message] = []

    def answer(message: Message, sender: tuple[str, int]) -> None:
        if message.msg_type == RANGE:
            ranges.append(message)
            node.send(TWIST, "/cmd_vel", "", message.stamp_nanos, b"\0\1\0\0" + bytes(48), sender)

    node = Link(("127.0.0.1", 0), on_message=answer, report=True)
    command = ["mono", str(program), str(node.address[1])]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    node.close()
    assert done.returncode == 0, done.stderr
    *commands, (topic, *counts) = [line.split() for line in done.stdout.splitlines()]
    assert commands
    assert all(line == ["forward", "0"] for line in commands)
    assert (topic, counts[:2]) == ("/range", ["sent", "30"])
    assert len(ranges) == 30
    assert int(counts[3]) > 0
