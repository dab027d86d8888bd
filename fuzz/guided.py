# SPDX-License-Identifier: Apache-2.0
"""Fuzz header and reassembler by coverage: headers round-trip, refused datagrams change nothing.

`python -m fuzz.guided [--seconds S] [--runs N] [--corpus DIR]` searches for datagrams that break
this, raise, or exceed a limit (atheris; Linux on x86-64). It starts from the vectors. An input is a
sequence of arrivals: sender, pause in units of 10 ms, size as uint16, datagram. A failing input is
written to `crash-*`; `python -m fuzz.guided crash-...` repeats it.
"""

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

from .reassembly import SENDERS, VECTORS, ReassemblerPair

ARRIVAL = struct.Struct("<BBH")
PAUSE_NANOS = 10_000_000
LARGEST_INPUT = 1 << 16


def arrive(data: bytes) -> None:
    """Pass all arrivals of an input; `AssertionError` where the property does not hold."""
    pair = ReassemblerPair()
    view = memoryview(data)
    while len(view) >= ARRIVAL.size:
        sender, pause, size = ARRIVAL.unpack_from(view)
        datagram = bytes(view[ARRIVAL.size : ARRIVAL.size + size])
        view = view[ARRIVAL.size + size :]
        check_header(datagram)
        pair.feed(datagram, sender % SENDERS, pause * PAUSE_NANOS)
    pair.end()


def check_header(datagram: bytes) -> None:
    """Check that a valid header packs to the same bytes, except for the padding."""
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
    """Fuzz until the time is over, in a child process, because libFuzzer exits its process.

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
    parser.add_argument("--runs", type=int, default=-1, help="end after this many inputs")
    parser.add_argument("--corpus", type=Path, help="folder that keeps the inputs found")
    parser.add_argument("crash", nargs="*", help="inputs to run once")
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
