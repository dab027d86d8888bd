# SPDX-License-Identifier: Apache-2.0
"""The C++ header against the vectors, and against the Python library on datagrams of all kinds."""

import hashlib
import random
import shutil
import struct
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.udp_bridge.reported import CASES, REPORT, damaged, journey, own_give_way
from tests.udp_bridge.vectors import (
    FOLDER,
    IN_ORDER,
    NAMES,
    TYPED_BODIES,
    VECTORS,
    Vector,
    load,
    typed_as,
)
from udp_bridge import Header, Message, Reassembler, fragments
from udp_bridge.receiver.inbox import Inbox

HERE = Path(__file__).parent
HEADER = HERE.parents[2] / "udp-bridge/cpp"
LENGTH = struct.Struct("<I")
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror", f"-I{HEADER}")
SANITIZERS = (
    *("-O1", "-g1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"),
    "-D_GLIBCXX_DEBUG",  # iterators know what they belong to
)


def compiler() -> str:
    """Return the compiler; skip where there is none."""
    found = shutil.which("c++")
    if found is None:
        pytest.skip("no C++ compiler")
    return found


def compiled(source: str, folder: Path, *options: str) -> Path:
    """Return a program of this folder, compiled."""
    out = folder / source
    command = [compiler(), *STRICT, *options, str(HERE / f"{source}.cpp"), "-o", str(out)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return out


@pytest.fixture(scope="session")
def receive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("receive", tmp_path_factory.mktemp("cpp"), "-O2")


@pytest.fixture(scope="session")
def send(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("send", tmp_path_factory.mktemp("cpp"), "-O2")


@pytest.fixture(scope="session")
def rate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("rate", tmp_path_factory.mktemp("cpp"), "-O2")


def received(
    program: Path,
    datagrams: Sequence[bytes],
    folder: Path,
    apart_nanos: int = 1,
    senders: Sequence[int] = (),
) -> tuple[list[Any], list[str]]:
    """Return what the C++ receiver makes of datagrams: messages with their bodies, refusals.

    The last of the messages is how many were incomplete, and how many Credits it gave.
    """
    file, bodies = folder / "datagrams.bin", folder / "bodies.bin"
    rows = zip(datagrams, senders or [1] * len(datagrams), strict=True)
    file.write_bytes(b"".join(LENGTH.pack(len(d)) + bytes([sender]) + d for d, sender in rows))
    command = [str(program), str(file), str(bodies), str(apart_nanos)]
    lines = subprocess.run(command, capture_output=True, check=True).stdout.split(b"\n")
    body, at = bodies.read_bytes(), 0
    messages, refused = [], []
    for line in filter(None, lines):
        word, _, rest = line.decode().partition(" ")
        if word == "refused":
            refused.append(rest)
        elif word == "message":
            *numbers, names = rest.split(" ", 6)
            *fields, size = map(int, numbers)
            topic, _, link = names.partition("|")
            messages.append((*fields, topic, link, body[at : at + size]))
            at += size
        else:
            messages_counted, incomplete, memory, credits_given = map(int, rest.split())
            assert messages_counted == len(messages)
            assert memory == 0
            messages.append((incomplete, credits_given))
    return messages, refused


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_a_vector_decodes_to_its_meaning(vector: Vector, receive: Path, tmp_path: Path) -> None:
    (*messages, (incomplete, _)), refused = received(receive, vector.datagrams, tmp_path)
    meant = vector.meaning
    assert refused == meant.get("refused", [])
    assert incomplete == meant.get("incomplete", 0)
    assert len(messages) == len(meant["messages"])
    for (kind, seq, sec, nsec, parts, topic, link, body), wanted in zip(
        messages, meant["messages"], strict=True
    ):
        assert (kind, seq, sec, nsec) == (
            *(wanted["msg_type"], wanted["seq_number"]),
            *(wanted["time_sec"], wanted["time_nsec"]),
        )
        assert (parts, topic, link) == (wanted["parts"], wanted["topic"], wanted["link"])
        assert hashlib.sha256(body).hexdigest() == wanted["body_sha256"]


def test_typed_bodies_are_read_as_python_reads_them(tmp_path: Path) -> None:
    file = tmp_path / "bodies"
    file.write_bytes(b"".join(LENGTH.pack(len(body)) + body for body in TYPED_BODIES))
    command = [str(compiled("typed", tmp_path, *SANITIZERS)), str(file)]
    lines = subprocess.run(command, capture_output=True, check=True, text=True).stdout.split("\n")
    read = [typed_as(body) for body in TYPED_BODIES]
    assert lines[:-1] == [f"{line} 1" if " " in line else line for line in read]


@pytest.mark.parametrize("size", [256, 1472, 9000, 65507])
@pytest.mark.parametrize("body_size", [0, 1, 1000, 60_000, 400_000])
def test_a_message_is_cut_as_python_cuts_it(send: Path, size: int, body_size: int) -> None:
    body = random.Random(body_size).randbytes(body_size)
    stamp = 1_700_000_000_123_456_789
    message = Message(1, "/points", "lidar_link", stamp, 2, body)
    ours = [head + bytes(part) for head, part in fragments(message, size)]
    words = [str(send), "1", "/points", "lidar_link", str(stamp), "3", str(size)]
    out = subprocess.run(words, input=body, capture_output=True, check=True).stdout
    assert out == b"".join(LENGTH.pack(len(datagram)) + datagram for datagram in ours)


@pytest.mark.parametrize("seed", range(20))
def test_late_repeated_and_lost_parts_agree_with_python(
    receive: Path, tmp_path: Path, seed: int
) -> None:
    arrivals = [row for row in damaged(journey(seed), seed) if row[1] != REPORT]
    _, senders, datagrams = zip(*arrivals, strict=True)
    means_the_same(receive, tmp_path, datagrams, senders)


@pytest.mark.parametrize("datagrams", CASES.values(), ids=CASES)
def test_a_limit_is_the_same_to_both(receive: Path, tmp_path: Path, datagrams: list[bytes]) -> None:
    means_the_same(receive, tmp_path, datagrams, [1] * len(datagrams))


def test_sender_over_the_limit_loses_its_own_messages(receive: Path, tmp_path: Path) -> None:
    """Of all memory, where others hold more than he does: his first is given up, none of theirs."""
    _, senders, datagrams = zip(*own_give_way(), strict=True)
    assert means_the_same(receive, tmp_path, datagrams, senders) == 6


def means_the_same(
    receive: Path, folder: Path, datagrams: Sequence[bytes], senders: Sequence[int]
) -> int:
    """Assert that C++ makes of datagrams what Python does; return how many were incomplete."""
    inbox = Inbox(receive_buffer=1 << 30, on_credit=lambda *_: None)
    wanted: list[Any] = []
    credits_given = 0
    for now, (datagram, sender) in enumerate(zip(datagrams, senders, strict=True)):
        message, answer = inbox.receive(memoryview(datagram), ("127.0.0.1", sender), now)
        credits_given += answer is not None
        if message is None or message.msg_type >= 64:
            continue
        sec, nsec = divmod(message.stamp_nanos, 10**9)
        names = (message.topic, message.link, bytes(message.body))
        fields = (message.msg_type, message.seq_number, sec, nsec, message.parts)
        wanted.append((*fields, *names))
    inbox.reassembler.give_up_all()
    counters = inbox.reassembler.counters
    (*messages, counts), refused = received(receive, datagrams, folder, senders=senders)
    assert messages == wanted
    assert counts == (counters.incomplete, credits_given)
    assert {why: refused.count(why) for why in refused} == dict(counters.refused)
    return counters.incomplete


def test_restart_within_a_message_starts_it_over(receive: Path, tmp_path: Path) -> None:
    """What was open had fewer parts: nothing of it may take the new ones."""

    def part(seq_number: int, number: int, parts: int, sec: int) -> bytes:
        return Header(1, seq_number, number, parts, sec, 0, "/a").pack() + bytes(5_000)

    datagrams = [part(10, 0, 1, 100), part(5, 0, 2, 200), part(5, 200, 255, 200)]
    (*messages, (incomplete, _)), refused = received(receive, datagrams, tmp_path, 6 * 10**8)
    assert len(messages) == 1
    assert (incomplete, refused) == (2, [])


@pytest.mark.parametrize("name", IN_ORDER)
def test_vector_is_fragmented_to_the_same_bytes(name: str, send: Path) -> None:
    vector = load(name)
    reassembler = Reassembler()
    message = [reassembler.receive(datagram, "", 0) for datagram in vector.datagrams][-1]
    assert message is not None
    if message.seq_number > 1000:
        pytest.skip("the program would have to send billions before")
    size = max(256, len(vector.datagrams[0]))
    words = [str(message.msg_type), message.topic, message.link, str(message.stamp_nanos)]
    command = [str(send), *words, str(message.seq_number + 1), str(size)]
    done = subprocess.run(command, input=bytes(message.body), capture_output=True, check=True)
    assert done.stdout == b"".join(LENGTH.pack(len(d)) + d for d in vector.datagrams)


@pytest.mark.nightly
@pytest.mark.parametrize(("body_size", "size"), [(100, 1472), (300_000, 1472), (10**6, "loopback")])
def test_cpp_receives_at_least_as_fast_as_python(
    rate: Path, body_size: int, size: int | str, tmp_path: Path
) -> None:
    message = Message(1, "/points", "lidar_link", 10**18, 0, bytes(body_size))
    datagrams = [bytearray(head + bytes(part)) for head, part in fragments(message, size)]
    file = tmp_path / "datagrams.bin"
    file.write_bytes(b"".join(LENGTH.pack(len(datagram)) + datagram for datagram in datagrams))
    rounds = 30_000 // len(datagrams)
    command = [str(rate), str(file), str(rounds)]
    theirs_nanos = int(subprocess.run(command, capture_output=True, check=True).stdout)
    reassembler = Reassembler()
    begun = time.process_time()
    for number in range(rounds):
        for datagram in datagrams:
            LENGTH.pack_into(datagram, 2, number)
            reassembler.receive(datagram, "", number)
    ours_nanos = (time.process_time() - begun) / rounds * 1e9
    assert reassembler.counters.messages == rounds
    assert theirs_nanos <= ours_nanos


def test_a_fuzzer_finds_nothing_that_the_sanitizers_mind(tmp_path: Path) -> None:
    # Unoptimized: compiled in half the time, and it runs for half a second alone.
    program = compiled("fuzz", tmp_path, *SANITIZERS, "-O0")
    files = sorted(str(path) for path in FOLDER.glob("*.bin"))
    command = [str(program), "50000", "7", *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    taken, handed, credits_ = map(int, done.stdout.split())
    assert taken == 50_000
    assert handed > 0
    assert credits_ > 0
