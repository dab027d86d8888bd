# SPDX-License-Identifier: Apache-2.0
"""The example in C++ reads an IMU and sends a Twist back."""

import socket
import struct
import subprocess
from pathlib import Path

from tests.udp_bridge.cpp.test_cpp import STRICT, compiler
from udp_bridge import Message, fragments, parse

SOURCE = Path(__file__).parents[3] / "examples/cpp_program/turn.cpp"
IMU, TWIST = 2, 9
HEADER_BYTES = 8 + 4 + len(b"imu_link\0")


def imu(turn_radps: float) -> bytes:
    """Return a sensor_msgs/Imu as CDR."""
    header = struct.pack("<iII", 1, 0, 9) + b"imu_link\0"
    numbers = [0.0, 0.0, 0.0, 1.0, *[0.0] * 9, 0.0, 0.0, turn_radps, *[0.0] * 21]
    return b"\0\1\0\0" + header.ljust(24, b"\0") + struct.pack(f"<{len(numbers)}d", *numbers)


def test_it_reads_the_imu_and_commands_the_vehicle(tmp_path: Path) -> None:
    program = tmp_path / "turn"
    command = [compiler(), *STRICT, str(SOURCE), "-o", str(program)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        ours.settimeout(0.1)  # the program may not be there yet
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            to = free.getsockname()
        with subprocess.Popen(
            [str(program), str(to[1]), "0.4"], stdout=subprocess.PIPE, text=True
        ) as theirs:
            assert theirs.stdout is not None
            try:
                twist, lines = None, []
                for number in range(1, 200):
                    message = Message(IMU, "/imu", "imu_link", number * 10**9, number, imu(-0.25))
                    for head, part in fragments(message):
                        ours.sendto(head + part, to)
                    try:
                        header, at = parse(data := ours.recv(65536))
                    except TimeoutError:
                        continue
                    if header.msg_type == TWIST:
                        twist = header, struct.unpack("<4x6d", data[at:])
                        break
                lines.append(theirs.stdout.readline())
            finally:
                theirs.kill()
    assert twist is not None
    assert (twist[0].topic, twist[1]) == ("/cmd_vel", (0.2, 0.0, 0.0, 0.0, 0.0, 0.4))
    assert lines == ["commanded 0.40 rad/s, measured -0.25 rad/s\n"]
