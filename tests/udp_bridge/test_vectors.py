# SPDX-License-Identifier: Apache-2.0
import json
from collections import Counter

import pytest

from udp_bridge import Header, Reassembler, fragments, parse
from udp_bridge.cli import main

from .vectors import FOLDER, IN_ORDER, NAMES, VECTORS, Vector, load


def test_every_vector_has_a_meaning() -> None:
    assert len(NAMES) >= 25
    assert NAMES == sorted(path.stem for path in FOLDER.glob("*.json"))


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_decodes_to_its_meaning(vector: Vector, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["decode", str(FOLDER / f"{vector.name}.bin"), "--json"]) == 0
    *messages, counters = map(json.loads, capsys.readouterr().out.splitlines())
    meant = [
        {key: value for key, value in message.items() if key != "fields"}
        for message in vector.meaning["messages"]
    ]
    assert messages == meant
    refused = vector.meaning.get("refused", [])
    names = ["messages", "incomplete", "duplicates", "late", "missing", "refused"]
    assert list(counters) == names
    assert counters["messages"] == len(meant)
    assert counters["incomplete"] == vector.meaning.get("incomplete", 0)
    assert counters["refused"] == Counter(refused)


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_reasons_come_in_order_and_no_memory_stays_held(vector: Vector) -> None:
    reassembler = Reassembler()
    reasons = []
    for now, datagram in enumerate(vector.datagrams):
        before = dict(reassembler.counters.refused)
        reassembler.receive(datagram, "sender", now)
        after = reassembler.counters.refused
        reasons += [reason for reason in after if after[reason] > before.get(reason, 0)]
    assert reasons == vector.meaning.get("refused", [])
    reassembler.give_up_all()
    assert reassembler.memory_bytes == 0


@pytest.mark.parametrize("name", IN_ORDER)
def test_encodes_to_the_same_bytes(name: str) -> None:
    vector = load(name)
    reassembler = Reassembler()
    received = [reassembler.receive(datagram, "", 0) for datagram in vector.datagrams]
    message = received[-1]
    assert message is not None
    size = max(256, len(vector.datagrams[0]))
    sent = [header + bytes(part) for header, part in fragments(message, size)]
    assert sent == vector.datagrams


@pytest.mark.parametrize("name", ["cloud-shuffled", "cloud-duplicated", "two-interleaved"])
def test_every_header_packs_to_its_own_bytes(name: str) -> None:
    for datagram in load(name).datagrams:
        header, offset = parse(datagram)
        assert header.pack() == datagram[:offset]


def test_interleaved_messages_encode_to_the_same_datagrams() -> None:
    vector = load("two-interleaved")
    reassembler = Reassembler()
    messages = [reassembler.receive(datagram, "", 0) for datagram in vector.datagrams]
    size = max(map(len, vector.datagrams))
    sent = {
        header + bytes(part)
        for message in messages
        if message is not None
        for header, part in fragments(message, size)
    }
    assert sent == set(vector.datagrams)


def test_duplicates_of_the_vector_are_counted() -> None:
    reassembler = Reassembler()
    vector = load("cloud-duplicated")
    for datagram in vector.datagrams:
        reassembler.receive(datagram, "", 0)
    distinct = len(set(vector.datagrams))
    assert reassembler.counters.duplicates == len(vector.datagrams) - distinct == 17


def test_headers_of_the_vectors_are_what_their_names_say() -> None:
    shortest = load("clock-shortest-header").datagrams[0]
    assert parse(shortest)[1] == 20
    longest = load("longest-names").datagrams[0]
    assert parse(longest)[1] == 252
    assert isinstance(parse(longest)[0], Header)
