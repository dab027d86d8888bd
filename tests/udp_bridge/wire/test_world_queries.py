# SPDX-License-Identifier: Apache-2.0
import json
import random
import tracemalloc
import zlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.udp_bridge.vectors import FOLDER
from udp_bridge import BadMessage, Header, Refused, parse
from udp_bridge.wire import control
from udp_bridge.wire.fragments import LARGEST_DATAGRAM
from udp_bridge.wire.seal import Seal
from udp_bridge.wire.types import CONTROL
from udp_bridge.wire.world_queries import (
    PACKED_BYTES,
    TEXT_BYTES,
    WorldQuery,
    WorldReply,
    pack_text,
    unpack_text,
)

VECTOR: dict[str, Any] = json.loads((FOLDER / "control/world-queries.json").read_text())
KINDS: dict[str, type[WorldQuery] | type[WorldReply]] = {
    "WorldQuery": WorldQuery,
    "WorldReply": WorldReply,
}
NUMBERS = st.integers(0, 2**64 - 1)
TEXTS = st.text(st.characters(blacklist_categories=["Cs"], blacklist_characters="\0"), max_size=200)


@pytest.mark.parametrize("row", VECTOR["messages"])
def test_vectors(row: dict[str, Any]) -> None:
    datagram = bytes.fromhex(row["datagram"])
    header, offset = parse(datagram)
    assert (header.msg_type, header.parts_max, header.topic) == (CONTROL, 1, "")
    body = control.parse(memoryview(datagram)[offset:])
    assert isinstance(body, KINDS[row["kind"]])
    assert (body.number, unpack_text(body.packed_text)) == (row["number"], row["text"])
    assert body.pack() == datagram[offset:]
    assert unpack_text(pack_text(row["text"])) == row["text"]
    for wrong in (body.pack()[:15], body.pack()[:1]):
        with pytest.raises(Refused, match="body_size"):
            control.parse(wrong)


@pytest.mark.parametrize("row", VECTOR["refused_texts"], ids=lambda row: row["what"])
def test_refused_texts(row: dict[str, str]) -> None:
    with pytest.raises(Refused, match=row["reason"]):
        unpack_text(bytes.fromhex(row["packed"]))


@given(st.builds(WorldQuery, NUMBERS, TEXTS.map(pack_text)), TEXTS)
def test_what_is_packed_is_parsed(query: WorldQuery, text: str) -> None:
    assert control.parse(query.pack()) == query
    reply = WorldReply(query.number, pack_text(text))
    assert control.parse(reply.pack()) == reply
    assert unpack_text(reply.packed_text) == text


@given(st.sampled_from([10, 11]), st.binary(max_size=60))
def test_any_bytes_are_refused_or_mean_the_same_when_packed_again(kind: int, rest: bytes) -> None:
    body = bytes([kind]) + rest
    try:
        value = control.parse(body)
    except Refused:
        assert len(body) < 16
        return
    assert control.parse(value.pack()) == value


@given(st.binary(max_size=60))
def test_bytes_that_are_no_text_are_refused(packed: bytes) -> None:
    try:
        text = unpack_text(packed)
    except Refused:
        return
    assert unpack_text(pack_text(text)) == text


def test_a_bomb_takes_no_more_memory_than_the_limit() -> None:
    bomb = zlib.compress(bytes(64 * TEXT_BYTES), 9)
    tracemalloc.start()
    with pytest.raises(Refused, match="body_size"):
        unpack_text(bomb)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 3 * TEXT_BYTES


def test_the_largest_texts() -> None:
    assert unpack_text(pack_text(" " * TEXT_BYTES)) == " " * TEXT_BYTES
    with pytest.raises(BadMessage, match="the text has 4194305 bytes; at most 4194304"):
        pack_text(" " * (TEXT_BYTES + 1))
    with pytest.raises(BadMessage, match="NUL"):
        pack_text("\0")
    random_text = random.Random(1).randbytes(90_000).hex()
    with pytest.raises(
        BadMessage, match=rf"180000 bytes, compressed \d+; one datagram holds {PACKED_BYTES}"
    ):
        pack_text(random_text)


def test_the_largest_body_fits_into_a_sealed_datagram() -> None:
    header = Header(CONTROL, 0, 0, 1, 0, 0).pack()
    largest = WorldReply(1, bytes(PACKED_BYTES)).pack()
    sealed = Seal(b"a secret for this test", sends=1, sender=7).sealed([header, largest], 0)
    assert sum(map(len, sealed)) == LARGEST_DATAGRAM
