# SPDX-License-Identifier: Apache-2.0
"""CDR in C# against the codecs that Groundlink uses: fields by name, and equal bytes."""

import dataclasses
import random
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundlink.ros.types import STORE
from tests.udp_bridge.vectors import VECTORS
from udp_bridge import MSG_TYPES, Reassembler

from .programs import Exchange

OF_PAPER = {
    number: row.ros_type for number, row in MSG_TYPES.items() if number <= 11 and row.ros_type
}
OTHER_NAMES = {"Range.Range": "Value", "Clock.Clock": "Value"}
"""Fields that C# cannot name as ROS does: a member has another name than its class."""
RANGES = {"int8": (-(2**7), 2**7), "uint8": (0, 2**8), "uint16": (0, 2**16)}
RANGES |= {"int32": (-(2**31), 2**31), "uint32": (0, 2**32), "int64": (-(2**63), 2**63)}
TEXTS = ["", "a", "map", "kół/ö", "a" * 233, "\U0001f916"]


def test_every_type_of_the_paper_is_there() -> None:
    assert sorted(OF_PAPER) == [1, 2, 3, 4, 5, 6, 8, 9, 10, 11]


@pytest.mark.parametrize("number", OF_PAPER, ids=list(OF_PAPER.values()))
def test_random_messages_are_read_by_name_and_written_to_the_same_bytes(
    number: int, exchange: Exchange
) -> None:
    for seed in range(8):
        message = randomly(OF_PAPER[number], random.Random(f"{number} {seed}"))
        cdr = bytes(STORE.serialize_cdr(message, OF_PAPER[number]))
        fields, again = decoded(exchange, number, cdr)
        wanted = dict(flat(message))
        assert fields.keys() == wanted.keys()
        for name, value in wanted.items():
            assert_same(fields[name], value)
        assert again == cdr


@pytest.mark.parametrize("number", OF_PAPER, ids=list(OF_PAPER.values()))
def test_damaged_bodies_are_refused_as_python_refuses_them(number: int, exchange: Exchange) -> None:
    rng = random.Random(number)
    cdr = bytes(STORE.serialize_cdr(randomly(OF_PAPER[number], rng), OF_PAPER[number]))
    assert decoded(exchange, number, cdr)[1] == cdr
    for more in range(1, 9):  # DDS pads bodies by up to 3 bytes
        again = decoded(exchange, number, cdr + bytes(more))[1]
        assert again == (cdr if more <= 3 else None)
    cuts = {*range(min(len(cdr), 24)), *(rng.randrange(len(cdr)) for _ in range(40))}
    for cut in cuts:
        assert decoded(exchange, number, cdr[:cut])[1] is None
    for kind in (b"\0\0", b"\1\0", b"\0\2"):
        assert decoded(exchange, number, kind + cdr[2:])[1] is None


@pytest.mark.parametrize("number", OF_PAPER, ids=list(OF_PAPER.values()))
def test_no_body_ends_the_program(number: int, exchange: Exchange) -> None:
    """Counts of 4 billion elements, text that is not UTF-8, and the like: read or refused."""
    rng = random.Random(number)
    cdr = bytes(STORE.serialize_cdr(randomly(OF_PAPER[number], rng), OF_PAPER[number]))
    refused = 0
    for _ in range(60):
        body = bytearray(cdr)
        for _ in range(rng.choice([1, 4, 20])):
            at = rng.randrange(len(body))
            body[at] = rng.choice([0, 255, rng.randrange(256)])
        refused += decoded(exchange, number, bytes(body))[1] is None
    assert refused or number in {8, 9}, "these are numbers only"


@pytest.mark.parametrize(
    ("number", "zeros", "sequences"), [(3, 16, 1), (5, 12, 2)], ids=["bytes", "strings"]
)
def test_a_count_takes_no_memory_before_it_is_believed(
    number: int, zeros: int, sequences: int, exchange: Exchange
) -> None:
    ahead = b"\0\1\0\0" + bytes(zeros)  # a header, and the format of an image
    before = peak_bytes(exchange)
    for count in (2**31 - 1, 2**28, 2**32 - 1):
        body = ahead + struct.pack("<I", count) + bytes(100)
        assert decoded(exchange, number, body)[1] is None
    assert peak_bytes(exchange) - before < 100 << 20
    assert decoded(exchange, number, ahead + bytes(4 * sequences))[1] is not None


def peak_bytes(exchange: Exchange) -> int:
    """Return the most memory that the program has addressed so far."""
    status = Path(f"/proc/{exchange.process.pid}/status").read_text()
    (kib,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmPeak"))
    return int(kib) << 10


@pytest.mark.parametrize(
    ("text", "is_valid"),
    [
        (b"a\0", True),
        (b"", True),  # some writers leave out the NUL of an empty string
        (b"a", False),
        (b"\xff\0", False),
        (b"\xed\xa0\x80\0", False),
        (b"\xf4\x90\x80\x80\0", False),
    ],
)
def test_text_is_utf8_that_ends_with_nul(text: bytes, is_valid: bool, exchange: Exchange) -> None:
    pose = struct.pack("<HHiII", 0x100, 0, 1, 2, len(text)) + text
    pose += bytes(-(len(pose) - 4) % 8) + bytes(56)
    assert (decoded(exchange, 10, pose)[1] is not None) == is_valid


@pytest.mark.parametrize(
    "vector", [one for one in VECTORS if one.name != "malformed"], ids=lambda one: one.name
)
def test_bodies_of_the_vectors_are_written_to_the_same_bytes(
    vector: Any, exchange: Exchange
) -> None:
    reassembler = Reassembler()
    for now, datagram in enumerate(vector.datagrams):
        message = reassembler.receive(datagram, "", now)
        if message is not None and message.msg_type in OF_PAPER:
            body = bytes(message.body)
            if body[:2] != b"\0\1":
                continue  # vectors of fragments have any bytes as body
            again = decoded(exchange, message.msg_type, body)[1]
            assert again == body


def decoded(exchange: Exchange, number: int, cdr: bytes) -> tuple[dict[str, str], bytes | None]:
    """Return the fields that C# reads, and what it writes of them; None: it refuses the bytes."""
    *fields, (_, end) = exchange.ask(b"C" + struct.pack("<Bi", number, len(cdr)) + cdr)
    assert all(row[0] == "field" for row in fields)
    named = {row[1]: row[2] for row in fields}
    return named, None if end == "refused" else bytes.fromhex(end[1:])


def randomly(ros_type: str, rng: random.Random) -> Any:
    """Return a message with random fields."""
    return STORE.types[ros_type](
        **{name: _field(kind, rng) for name, kind in STORE.get_msgdef(ros_type).fields}
    )


def _field(kind: tuple[Any, Any], rng: random.Random) -> Any:
    shape, of = int(kind[0]), kind[1]
    if shape == 1:  # a basic type
        return _basic(of[0], rng)
    if shape == 2:  # another message
        return randomly(of, rng)
    (element_shape, element), size = of
    count = size or rng.choice([0, 1, 2, 7, 50])
    all_ = [_field((element_shape, element), rng) for _ in range(count)]
    if int(element_shape) == 1 and element[0] != "string":
        return np.array(all_, np.dtype(element[0]))
    return all_


def _basic(name: str, rng: random.Random) -> Any:
    if name == "string":
        return rng.choice(TEXTS)
    if name == "bool":
        return rng.random() < 0.5
    if name in RANGES:
        low, high = RANGES[name]
        return rng.choice([low, high - 1, rng.randrange(low, high)])
    value = rng.choice([0.0, -0.0, float("inf"), -float("inf"), rng.uniform(-1e3, 1e30)])
    return float(np.float32(value)) if name == "float32" else value


def flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the path of each field as C# has it, and its value."""
    if isinstance(value, np.ndarray) and value.itemsize == 1:
        yield path, value.tobytes()
    elif isinstance(value, (list, np.ndarray)):
        for index, one in enumerate(value):
            yield from flat(one, f"{path}.{index}")
        yield f"{path}.count", len(value)
    elif dataclasses.is_dataclass(value):
        kind = type(value).__name__.rpartition("__")[2]
        for name, _ in STORE.get_msgdef(value.__msgtype__).fields:
            pascal = "".join(word.capitalize() for word in name.split("_"))
            pascal = OTHER_NAMES.get(f"{kind}.{pascal}", pascal)
            yield from flat(getattr(value, name), f"{path}.{pascal}")
    else:
        yield path, value


def assert_same(said: str, value: Any) -> None:
    if isinstance(value, (str, bytes)):
        data = value.encode() if isinstance(value, str) else value
        assert bytes.fromhex(said[1:]) == data
    elif isinstance(value, (float, np.floating)):
        said = said.replace("Infinity", "inf")
        assert float(said) == value or np.float32(said) == np.float32(value)
    else:
        assert int(said) == int(value)
