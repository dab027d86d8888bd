# SPDX-License-Identifier: Apache-2.0
"""What the C++ header reports and refuses, against the Python library."""

import struct
import subprocess
from pathlib import Path

import pytest

from tests.udp_bridge.reported import (
    WALL_NANOS,
    Arrival,
    Reported,
    boundaries,
    by_python,
    challenges,
    controls,
    credited,
    full_memory,
    journey,
    part,
    told,
)
from udp_bridge import BadMessage, parse
from udp_bridge.wire.control import Subscribe
from udp_bridge.wire.fragments import split

from .test_cpp import SANITIZERS, compiled

BUFFER = 1 << 30


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("report", tmp_path_factory.mktemp("cpp"), *SANITIZERS)


def lines_of(
    program: Path, arrivals: list[Arrival], folder: Path, *, buffer: int = BUFFER
) -> list[list[str]]:
    file = folder / "arrivals.bin"
    rows = [struct.pack("<qBI", now, sender, len(d)) + d for now, sender, d in arrivals]
    file.write_bytes(b"".join(rows))
    command = [str(program), str(file), str(WALL_NANOS), str(buffer)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    return [line.split() for line in done.stdout.splitlines()]


def by_cpp(program: Path, arrivals: list[Arrival], folder: Path) -> Reported:
    return reported(lines_of(program, arrivals, folder))


def reported(lines: list[list[str]]) -> Reported:
    found = Reported([], [], [], [])
    for word, *rest in lines:
        if word == "report":
            found.reports.append(told(int(rest[0]), bytes.fromhex(rest[1])))
        elif word == "refused":
            found.refused.append(rest[0])
        elif word == "subscribe":
            fields = *map(int, rest[:3]), float.fromhex(rest[3])
            found.subscribes.append(Subscribe(*fields))
        elif word == "answer":
            found.credits.append(credited(int(rest[0]), bytes.fromhex(rest[1])))
    return found


@pytest.mark.parametrize("seed", range(12))
def test_delivery_reports_match_python(program: Path, tmp_path: Path, seed: int) -> None:
    arrivals = journey(seed)
    ours, theirs = by_python(arrivals, BUFFER), by_cpp(program, arrivals, tmp_path)
    assert sorted(theirs.reports) == sorted(ours.reports)
    assert theirs.refused == ours.refused
    assert len({row[-1] for row in ours.reports}) > 10


def test_a_control_message_is_refused_for_the_same_reason(program: Path, tmp_path: Path) -> None:
    arrivals = controls()
    ours, theirs = by_python(arrivals, BUFFER), by_cpp(program, arrivals, tmp_path)
    assert theirs.refused == ours.refused
    assert 0 < len(ours.refused) < len(arrivals)


NEXT: Arrival = (0, 0, b"")


def test_at_every_bound_it_does_what_python_does(program: Path, tmp_path: Path) -> None:
    cases = boundaries()
    lines = lines_of(program, [row for case in cases for row in (*case, NEXT)], tmp_path)
    differ = []
    for case in cases:
        end = lines.index(["end"])
        theirs, lines = reported(lines[:end]), lines[end + 1 :]
        ours = by_python(case, BUFFER)
        if theirs._replace(reports=sorted(theirs.reports)) != ours._replace(
            reports=sorted(ours.reports)
        ):
            differ.append((case, ours, theirs))
    assert not differ


@pytest.mark.parametrize(("sizes", "given_up"), [((), 0), ((1,), 1), ((1, 1), 1)])
def test_beyond_its_memory_one_of_the_largest_gives_way(
    program: Path, tmp_path: Path, sizes: tuple[int, ...], given_up: int
) -> None:
    """Python counts what is held instead of what is announced (`test_flood.py`)."""
    found = by_cpp(program, full_memory(sizes), tmp_path).reports
    large = [row[-1] for row in found if row[1] == "/large"]
    assert sum(report.incomplete for report in large) == given_up
    assert sum(report.published for report in large) == 4 - given_up
    assert [row[-1].published for row in found if row[0] == 5] == [1] * len(sizes)


def cut_by_python(size: int, header: int, largest: int) -> int:
    try:
        return split(size, header, largest or "loopback").part_size
    except BadMessage:  # or TooLarge, which is one
        return 0


def test_a_body_is_cut_as_python_cuts_it_at_every_bound(tmp_path: Path) -> None:
    rows = []
    sizes = (0, 1, 255, 256, 257, 1471, 1472, 1473, 2951, 2952, 2953, 9000, 65_506, 65_507, 65_508)
    grown = [*range(1472, 65_507, 1480), 65_507]
    for largest in sizes:
        for header in (20, 24, 224, 228, 252):
            parts = {cut_by_python(0, header, largest), *(most - header for most in grown)}
            bodies = {255 * part + more for part in parts for more in (-1, 0, 1)}
            rows += [(body, header, largest) for body in bodies if body >= 0]
    asked = "".join(f"{body} {header} {largest}\n" for body, header, largest in rows)
    command = [str(compiled("cut", tmp_path))]
    done = subprocess.run(command, input=asked, capture_output=True, text=True, check=True)
    theirs = list(map(int, done.stdout.split()))
    differ = [
        (row, ours, found)
        for row, found in zip(rows, theirs, strict=True)
        if (ours := cut_by_python(*row)) != found
    ]
    assert not differ


@pytest.mark.parametrize("size", [16_383, 16_384, 16_385])
def test_a_credit_is_due_beyond_an_eighth_of_the_buffer(
    program: Path, tmp_path: Path, size: int
) -> None:
    """Each datagram counts as the kernel accounts it (PROTOCOL.md, section 8)."""
    head = len(part(0, 9, 0))
    cost = size + 1024 + (size if size <= 16_384 else 0)
    arrivals = [(0, 1, part(number, 9, size - head)) for number in range(8)]
    for buffer, after in ((8 * 3 * cost - 8, 3), (8 * 3 * cost, 4), (8 * 3 * cost + 8, 4)):
        lines = lines_of(program, arrivals, tmp_path, buffer=buffer)
        found = reported(lines).credits
        assert [credit.part_number for *_, credit in found] == list(range(after - 1, 8, after))


def test_only_a_peer_that_is_sent_messages_has_its_challenges_answered(
    program: Path, tmp_path: Path
) -> None:
    arrivals, responses = challenges()
    lines = lines_of(program, arrivals, tmp_path)
    assert [(word, to) for word, to, _ in lines] == [("answer", "1")] * len(responses)
    found = [bytes.fromhex(raw) for _, _, raw in lines]
    for number, (ours, theirs) in enumerate(zip(responses, found, strict=True)):
        assert theirs[:2] + theirs[6:] == ours[:2] + ours[6:]
        assert parse(theirs)[0].seq_number == number
