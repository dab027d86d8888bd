# SPDX-License-Identifier: Apache-2.0
"""The command, as a process of its own."""

import hashlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.ros.waiting import wait_until
from udp_bridge import Link

from .vectors import FOLDER, VECTORS

COMMAND = [sys.executable, "-m", "udp_bridge"]
TIMEOUT_S = 60


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT_S)


def rows(out: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in out.splitlines()]


class Listener:
    """A running `udp-bridge listen`."""

    def __init__(self, *arguments: str) -> None:
        command = [*COMMAND, "listen", "--bind", "127.0.0.1:0", *arguments]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stderr is not None
        line = self.process.stderr.readline()
        assert line.startswith("udp-bridge: listening at 127.0.0.1:")
        self.address = ("127.0.0.1", int(line.rpartition(":")[2]))

    def line(self) -> str:
        assert self.process.stdout is not None
        return self.process.stdout.readline()

    def end(self, number: int) -> tuple[str, str]:
        self.process.send_signal(number)
        return self.process.communicate(timeout=TIMEOUT_S)


@pytest.fixture
def listener(request: pytest.FixtureRequest) -> Iterator[Listener]:
    running = Listener(*getattr(request, "param", ["--json"]))
    yield running
    running.process.kill()
    running.process.communicate(timeout=TIMEOUT_S)


def test_decode_prints_the_vectors_fields() -> None:
    """Once as a process; `test_vectors.py` decodes all vectors with the same function."""
    done = run("decode", FOLDER / "parts-disagree.bin", "--json")
    assert (done.returncode, done.stderr) == (0, "")
    assert rows(done.stdout)[-1]["refused"] == {"parts_max": 2}


def test_decode_for_people() -> None:
    done = run("decode", FOLDER / "two-interleaved.bin")
    assert done.stdout.splitlines() == [
        "PointCloud2 #8 '/a' link 'lidar_link' at 2015627261.565643791: 11345 bytes in 8 parts",
        "PointCloud2 #9 '/b' link 'lidar_link' at 2015627261.565643792: 11345 bytes in 8 parts",
        "messages 2, incomplete 0, duplicates 0, late 0, missing 0, refused 0",
    ]
    done = run("decode", FOLDER / "parts-disagree.bin")
    assert done.stdout.endswith("missing 0, refused 2 (parts_max 2)\n")


def test_decode_of_a_file_cut_short(tmp_path: Path) -> None:
    whole = (FOLDER / "two-interleaved.bin").read_bytes()
    cut = tmp_path / "cut.bin"
    for end, text in (
        (len(whole) - 1, "truncated datagram at offset"),
        (2, "truncated length prefix at offset 0: 2 of 4 bytes"),
    ):
        cut.write_bytes(whole[:end])
        done = run("decode", cut, "--json")
        assert done.returncode == 2
        assert done.stderr.startswith(f"udp-bridge: {cut}: {text}")
        assert done.stderr.count("\n") == 1


def test_decode_into_a_pipe_that_closes(tmp_path: Path) -> None:
    many = tmp_path / "many.bin"
    many.write_bytes((FOLDER / "malformed.bin").read_bytes())
    imu = (FOLDER / "imu.bin").read_bytes()
    # The same message with 3000 numbers: the seq_number follows the length and two bytes.
    many.write_bytes(
        b"".join(imu[:6] + seq.to_bytes(4, "little") + imu[10:] for seq in range(3000))
    )
    with subprocess.Popen(
        [*COMMAND, "decode", str(many)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(TIMEOUT_S) == 0


@pytest.mark.parametrize("datagram", ["mtu", "loopback", "9000"])
def test_listen_shows_sent_message(listener: Listener, tmp_path: Path, datagram: str) -> None:
    body = os.urandom(100_000)
    file = tmp_path / "cloud.cdr"
    file.write_bytes(body)
    to = f"127.0.0.1:{listener.address[1]}"
    before = time.time()
    done = run(
        *("send", "--to", to, "--type", "PointCloud2", "--topic", "/points", "--link", "lidar"),
        *("--body", file, "--datagram", datagram),
    )
    parts = {"mtu": 70, "loopback": 2, "9000": 12}[datagram]
    assert done.returncode == 0
    assert done.stderr == (
        f"udp-bridge: sent PointCloud2 of 100000 bytes in {parts} parts to {to}\n"
    )
    message = json.loads(listener.line())
    assert before - 1 < message.pop("time_sec") < time.time() + 1
    assert 0 <= message.pop("time_nsec") < 10**9
    assert message == {
        "msg_type": 1,
        "seq_number": 0,
        "topic": "/points",
        "link": "lidar",
        "parts": parts,
        "body_size": 100_000,
        "body_sha256": hashlib.sha256(body).hexdigest(),
    }
    out, errors = listener.end(signal.SIGINT)
    assert (listener.process.returncode, errors) == (0, "")
    (counters,) = rows(out)
    assert counters["messages"] == 1


def test_sigterm_ends_listen_with_the_counters(listener: Listener) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"", listener.address)
        for datagram in VECTORS[3].datagrams[:5]:
            stranger.sendto(datagram, listener.address)
        stranger.sendto(
            (FOLDER / "imu.bin").read_bytes()[4:], listener.address
        )  # in the end, so that the rest has been taken
        assert json.loads(listener.line())["topic"] == "/rover/imu"
    out, errors = listener.end(signal.SIGTERM)
    assert (listener.process.returncode, errors) == (0, "")
    assert rows(out) == [
        {
            "messages": 1,
            "incomplete": 1,
            "duplicates": 0,
            "late": 0,
            "missing": 0,
            "refused": {"empty": 1},
        }
    ]


def test_listen_ends_by_itself() -> None:
    done = run("listen", "--bind", "127.0.0.1:0", "--duration", "0.05")
    assert done.returncode == 0
    assert done.stdout == "messages 0, incomplete 0, duplicates 0, late 0, missing 0, refused 0\n"


@pytest.mark.parametrize("listener", [["--quiet", "--report", "--json"]], indirect=True)
def test_quiet_listener_prints_counters_only(listener: Listener) -> None:
    reports: list[object] = []
    with Link(
        ("127.0.0.1", 0), listener.address, on_message=lambda *got: reports.append(got)
    ) as link:
        link.send(1, "/points", "lidar", 0, bytes(200_000))
        wait_until(lambda: reports, "a report")
    out, _ = listener.end(signal.SIGTERM)
    assert [row["messages"] for row in rows(out)] == [1]


@pytest.mark.parametrize(
    ("listener", "is_reported"), [(["--report"], True), ([], False)], indirect=["listener"]
)
def test_listen_gives_credit_and_reports_on_request(listener: Listener, is_reported: bool) -> None:
    reports: list[object] = []
    with Link(
        ("127.0.0.1", 0), listener.address, on_message=lambda *got: reports.append(got)
    ) as link:
        link.send(1, "/points", "lidar", 0, bytes(200_000))
        listener.line()
        wait_until(lambda: link.counters()["messages"] and (reports or not is_reported), "both")
    assert bool(reports) == is_reported


def test_send_to_a_closed_port(tmp_path: Path) -> None:
    file = tmp_path / "twist.cdr"
    file.write_bytes(bytes(52))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as reserved:
        reserved.bind(("127.0.0.1", 0))
        to = f"127.0.0.1:{reserved.getsockname()[1]}"
    done = run("send", "--to", to, "--type", "9", "--body", file)
    assert done.returncode == 0
    assert done.stderr.endswith(f"udp-bridge: no process listens at {to}\n")


SEND = ("send", "--to", "127.0.0.1:9", "--type", "9", "--body")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((), "the following arguments are required: COMMAND"),
        (("play",), "invalid choice: 'play'"),
        (("decode", "no/such.bin"), "no/such.bin: No such file or directory"),
        (("decode", "."), ".: Is a directory"),
        (("listen",), "required: --bind"),
        (("listen", "--bind", "0.0.0.0:0"), "Fix: --peer HOST:PORT, --key-file FILE, or --allow-"),
        (("listen", "--bind", "4000"), "'4000' is not HOST:PORT"),
        (("listen", "--bind", "127.0.0.1:65536"), "with a port of 0..65535"),
        (("listen", "--bind", "nowhere.invalid:0"), "can't bind to nowhere.invalid:0: "),
        (("listen", "--bind", "127.0.0.1:0", "--duration", "nan"), "'nan' is no number of seconds"),
        (("listen", "--bind", "127.0.0.1:0", "--duration", "-1"), "'-1' is no number of seconds"),
        ((*SEND, "no/such.cdr"), "no/such.cdr: No such file or directory"),
        ((*SEND, os.devnull, "--datagram", "jumbo"), "'jumbo' is neither mtu, loopback nor"),
        ((*SEND, os.devnull, "--datagram", "255"), "255 is neither mtu, loopback nor 256..65507"),
        ((*SEND, os.devnull, "--type", "31"), "unknown message type 31; known are 1, 2"),
        ((*SEND, os.devnull, "--type", "Pose"), "message type 'Pose'; expected one of PointCloud2"),
        ((*SEND, os.devnull, "--topic", "x" * 235), "take 235 bytes together; at most 234 fit"),
        ((*SEND, os.devnull, "--to", "nowhere.invalid:9"), "no IPv4 address for nowhere.invalid:9"),
    ],
)
def test_mistakes_give_one_line(arguments: tuple[str, ...], text: str) -> None:
    done = run(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    assert text in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("udp-bridge")


def test_port_in_use_gives_one_line(listener: Listener) -> None:
    done = run("listen", "--bind", f"127.0.0.1:{listener.address[1]}")
    assert done.returncode == 2
    assert done.stderr == (
        f"udp-bridge: can't bind to 127.0.0.1:{listener.address[1]}: Address already in use\n"
    )


def test_oversized_body_gives_one_line(tmp_path: Path) -> None:
    file = tmp_path / "huge.cdr"
    with open(file, "wb") as huge:
        huge.truncate(17_000_000)
    done = run(*SEND, file, "--topic", "/huge")
    assert done.returncode == 2
    assert done.stderr.startswith("udp-bridge: Twist on topic '/huge': a body of 17000000 bytes")
    assert done.stderr.count("\n") == 1
