# SPDX-License-Identifier: Apache-2.0
"""The relay between real links on loopback, in this process and as a command."""

import json
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from groundlink.__main__ import main
from groundlink.emulation.model import OUTCOMES
from groundlink.emulation.settings import Impairment
from services.link import relay as module
from services.link.relay import UdpRelay
from udp_bridge import Link, Message
from udp_bridge.wire.control import Subscribe

LOCAL = ("127.0.0.1", 0)
REPOSITORY = Path(__file__).resolve().parents[3]
CLEAN = Impairment()


def wait_for(condition: Callable[[], Any]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline, "the condition never came true"
        time.sleep(0.002)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def end(stack: ExitStack, **options: Any) -> tuple[Link, list[tuple[Message, Any]]]:
    received: list[tuple[Message, Any]] = []
    link = Link(LOCAL, on_message=lambda *both: received.append(both), **options)
    return stack.enter_context(link), received


def relay(stack: ExitStack, to: tuple[str, int], **options: Any) -> UdpRelay:
    """Run a relay in a thread until the test ends."""
    it = UdpRelay(LOCAL, to, **{"forward": CLEAN, "back": CLEAN, "seed": 1} | options)
    stop = threading.Event()

    def run() -> None:
        while not stop.is_set():
            it.turn(time.monotonic_ns)

    thread = threading.Thread(target=run)

    def end() -> None:
        stop.set()
        thread.join()
        it.close()

    thread.start()
    stack.callback(end)
    return it


def test_large_messages_pass_and_credits_come_back(stack: ExitStack) -> None:
    ros, received = end(stack)
    between = relay(stack, ros.address, forward=Impairment(delay_ms=5), back=Impairment(delay_ms=5))
    gateway, _ = end(stack, peer=between.address)
    body = bytes(range(256)) * 8000
    gateway.send(1, "/points", "lidar", 7, body)
    wait_for(lambda: received)
    assert received[0][0].body == body
    wait_for(lambda: between.back.counts["delivered"] > 0)
    # 32 parts, and requests for a Credit as long as none comes.
    assert between.forward.counts["datagrams"] == between.forward.counts["delivered"] > 32
    assert between.kernel_drops == between.unsent == 0


def test_every_sender_gets_its_own_answers(stack: ExitStack) -> None:
    ros, received = end(stack)
    between = relay(stack, ros.address)
    senders = [end(stack, peer=between.address) for _ in range(5)]
    for number, (link, _) in enumerate(senders):
        link.send(8, f"/clock{number}", "", number, b"x")
    wait_for(lambda: len(received) == 5)
    assert between.peers == len({sender for _, sender in received}) == 5
    request = Subscribe(9).pack()
    for message, sender in received:
        ros.send(7, message.topic, "", message.stamp_nanos, request, to=sender)
    wait_for(lambda: all(answers for _, answers in senders))
    for number, (_, answers) in enumerate(senders):
        assert [message.topic for message, _ in answers] == [f"/clock{number}"]


def test_loss_is_what_the_receiver_misses(stack: ExitStack) -> None:
    ros, received = end(stack)
    between = relay(stack, ros.address, forward=Impairment(loss=0.2, duplicate=0.1))
    gateway, _ = end(stack, peer=between.address)
    for index in range(2000):
        gateway.send(8, "/clock", "", index, b"x")
        if index % 100 == 0:
            gateway.flush(5)
    counts = between.forward.counts
    wait_for(lambda: counts["datagrams"] == 2000 and not between.forward.waiting)
    wait_for(lambda: ros.counters()["received_datagrams"] == counts["delivered"])
    assert len(received) == 2000 - counts["lost"]
    assert 300 < counts["lost"] < 500
    assert 2000 + counts["duplicated"] == sum(counts[outcome] for outcome in OUTCOMES)


class Told:
    """A socket whose kernel tells with each datagram how many it has dropped so far."""

    def __init__(self, *drops: int) -> None:
        self._drops = list(drops)

    def recvmsg(self, size: int, ancillary: int) -> tuple[bytes, list[Any], int, tuple[str, int]]:
        if not self._drops:
            raise BlockingIOError
        told = struct.pack("=I", self._drops.pop(0))
        return b"", [(socket.SOL_SOCKET, 40, told)], 0, LOCAL


def test_what_the_kernel_drops_is_counted_once() -> None:
    it = UdpRelay(LOCAL, LOCAL, forward=CLEAN, back=CLEAN, seed=1)
    try:
        for drops in ((5, 5, 12), (3,)):
            it._take(module.RelaySocket(Told(*drops), ("127.0.0.1", 9)), lambda: 0)  # type: ignore[arg-type]
        assert it.kernel_drops == 12 + 3
    finally:
        it.close()


def test_senders_are_forgotten_when_there_are_too_many(
    stack: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PEERS", 3)
    ros, received = end(stack)
    between = relay(stack, ros.address)
    ports = []
    for number in range(6):
        link, _ = end(stack, peer=between.address)
        ports.append(link.address[1])
        link.send(8, f"/clock{number}", "", 1, b"x")
        wait_for(lambda number=number: len(received) == number + 1)
    assert [port for _, port in between._behind] == ports[3:]
    assert len(between._selector.get_map()) == 4


class Command:
    """`groundlink link` as a user starts it."""

    def __init__(self, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "groundlink", "link", *arguments],
            cwd=REPOSITORY,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def end(self, number: int = signal.SIGINT) -> str:
        self.process.send_signal(number)
        out, err = self.process.communicate(timeout=20)
        assert (self.process.returncode, err) == (0, "")
        return out


def listening(command: Command) -> tuple[str, int]:
    assert command.process.stdout is not None
    line = command.process.stdout.readline()
    assert line.startswith("relaying from 127.0.0.1:"), line
    return "127.0.0.1", int(line.split()[2].rpartition(":")[2])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_command_relays_and_prints_its_counters(stack: ExitStack, number: int) -> None:
    ros, received = end(stack)
    to = f"127.0.0.1:{ros.address[1]}"
    command = Command(
        *("--listen", "127.0.0.1:0", "--to", to, "--loss", "0.5", "--burst", "3", "--seed", "4"),
        *("--back-loss", "1", "--back-burst", "0", "--outage", "100:1", "--json"),
    )
    gateway, back = end(stack, peer=listening(command))
    count = 0
    while len(received) < 50:
        gateway.send(8, "/clock", "", count, b"x")
        gateway.flush(5)
        count += 1
    ros.send(8, "/clock", "", 1, b"x", to=received[0][1])
    wait_for(lambda: ros.counters()["sent_datagrams"] == 1)
    time.sleep(0.2)  # what must not happen is given time to
    told = json.loads(command.end(number))
    assert told["forward"]["lost"] + told["forward"]["delivered"] == count
    assert told["forward"]["lost"] > 10
    assert told["back"]["lost"] == told["back"]["datagrams"] == 1
    assert told["peers"] == 1
    assert not back


def test_an_outage_of_the_command(stack: ExitStack) -> None:
    ros, received = end(stack)
    to = f"127.0.0.1:{ros.address[1]}"
    command = Command("--listen", "127.0.0.1:0", "--to", to, "--outage", "0:1", "--delay-ms", "1")
    gateway, _ = end(stack, peer=listening(command))
    began, count = time.monotonic(), 0
    while not received:
        gateway.send(8, "/clock", "", count, b"x")
        count += 1
        time.sleep(0.01)
    assert time.monotonic() - began < 15
    told = command.end()
    assert "outage" in told
    assert "datagrams" in told


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--listen"),
        (["--listen", "nonsense"], "`nonsense`: not an address"),
        (["--listen", "127.0.0.1:0", "--loss", "1.5"], "--loss 1.5: expected `float` <= 1.0"),
        (["--listen", "127.0.0.1:0", "--loss", "many"], "invalid float"),
        (
            ["--listen", "127.0.0.1:0", "--back-loss", "0.9", "--back-burst", "2"],
            "direction back: loss 0.9 ",
        ),
        (["--listen", "127.0.0.1:0", "--outage", "5"], "START:LENGTH"),
        (["--listen", "127.0.0.1:0", "--seed", "-1"], "--seed -1"),
        (["--set", "to_ros.loss=1"], "expected --run NAME as well"),
    ],
)
def test_mistakes_are_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    def in_place_of_this(program: str, command: list[str]) -> None:
        sys.exit(subprocess.run(command, cwd=REPOSITORY, timeout=30, check=False).returncode)

    monkeypatch.setattr(os, "execv", in_place_of_this)
    to = ["--to", "127.0.0.1:9"] if "--listen" in arguments else []
    try:
        code = main(["link", *arguments, *to])
    except SystemExit as end:
        code = int(end.code or 0)
    assert code == 2
    error = capfd.readouterr().err
    assert words in error.strip().splitlines()[-1]
    assert "Traceback" not in error


def test_a_port_in_use_is_one_line() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(LOCAL)
        listen = f"127.0.0.1:{taken.getsockname()[1]}"
        done = subprocess.run(
            [sys.executable, "-m", "services.link", "--listen", listen, "--to", "127.0.0.1:9"],
            cwd=REPOSITORY,
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == f"link: cannot listen at {listen}: address already in use\n"
