# SPDX-License-Identifier: Apache-2.0
"""Whatever arrives, headers pack to what they were parsed from, and refused ones change nothing.

`python -m fuzz.guided [--seconds S] [--runs N] [--corpus DIR]` looks for datagrams that break
that, or raise, or exceed a limit, by coverage of header, reassembly and what they use (atheris;
Linux on x86-64). It begins with the vectors. An input is a row of arrivals: sender, pause in
units of 10 ms, size as uint16, datagram. What fails is left as a file `crash-*`, to be given
back as argument: `python -m fuzz.guided crash-...`.
"""

from __future__ import annotations

import argparse
import os
import struct
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["udp_bridge"]):
    from udp_bridge import Refused, parse

from udp_bridge.wire.capture import datagrams

from .twins import SENDERS, Twins

VECTORS = Path(__file__).parents[1] / "tests" / "vectors"
ARRIVAL = struct.Struct("<BBH")
PAUSE_NANOS = 10_000_000
LARGEST_INPUT = 1 << 16


def arrive(data: bytes) -> None:
    """Let all arrivals of an input come; `AssertionError` where the property does not hold."""
    twins = Twins()
    view = memoryview(data)
    while len(view) >= ARRIVAL.size:
        sender, pause, size = ARRIVAL.unpack_from(view)
        datagram = bytes(view[ARRIVAL.size : ARRIVAL.size + size])
        view = view[ARRIVAL.size + size :]
        check_header(datagram)
        twins.feed(datagram, sender % SENDERS, pause * PAUSE_NANOS)
    twins.end()


def check_header(datagram: bytes) -> None:
    """Check that a header that is understood packs to the same bytes, but for the padding."""
    try:
        header, offset = parse(datagram)
    except Refused:
        return
    packed = header.pack()
    names = len(header.topic.encode()) + len(header.link.encode())
    assert len(packed) == offset
    assert packed[: 18 + names] == datagram[: 18 + names]


def seeds(folder: Path) -> None:
    """Write the vectors as inputs."""
    for path in VECTORS.glob("*.bin"):
        with open(path, "rb") as file:
            rows = [ARRIVAL.pack(0, 0, len(each)) + each for each in datagrams(file)]
        (folder / path.stem).write_bytes(b"".join(rows)[:LARGEST_INPUT])


def fuzz(
    program: str,
    test_one: Callable[[bytes], None],
    largest_input: int,
    seeds: Callable[[Path], None] = lambda _: None,
) -> int:
    """Fuzz until the time is over, in a child, because libFuzzer ends its process at once.

    Parameters
    ----------
    program
        Name of the module.
    test_one
        Takes one input.
    largest_input
        In bytes.
    seeds
        Writes the first inputs to a folder.
    """
    parser = argparse.ArgumentParser(prog=f"python -m {program}")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--runs", type=int, default=-1, help="end after so many inputs")
    parser.add_argument("--corpus", type=Path, help="folder that keeps what was found")
    parser.add_argument("crash", nargs="*", help="inputs to run once instead")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        corpus = arguments.corpus or Path(folder) / "corpus"
        corpus.mkdir(parents=True, exist_ok=True)
        begin = Path(folder) / "seeds"
        begin.mkdir()
        seeds(begin)
        options = [f"-max_total_time={arguments.seconds}", f"-runs={arguments.runs}", "-timeout=20"]
        options += [f"-max_len={largest_input}", "-len_control=0", "-rss_limit_mb=512"]
        options += ["-print_final_stats=1"]
        inputs = arguments.crash or [str(corpus), str(begin)]
        child = os.fork()
        if not child:
            atheris.Setup([sys.argv[0], *options, *inputs], test_one)
            atheris.Fuzz()
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


if __name__ == "__main__":
    sys.exit(fuzz("fuzz.guided", arrive, LARGEST_INPUT, seeds))
