# SPDX-License-Identifier: Apache-2.0
"""The C# library against the vectors, and against the Python library on datagrams of all kinds.

One process answers all queries: a runtime that starts for each of them would take minutes.
"""

import hashlib
import os
import socket
import struct
import subprocess
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tests.udp_bridge.reported import (
    CASES,
    KNOWN,
    LARGE,
    REPORT,
    WALL_NANOS,
    Arrival,
    by_python,
    challenges,
    controls,
    damaged,
    journey,
    own_give_way,
    part,
)
from tests.udp_bridge.vectors import IN_ORDER, NAMES, TYPED_BODIES, VECTORS, Vector, load, typed_as
from udp_bridge import Header, Message, Reassembler, fragments, parse
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, TopicReport

from .programs import BUFFER, LINK_REPORT, Exchange, of_readme

SECOND = 10**9


def told(message: Message) -> tuple[Any, ...]:
    """Return a message of the Python library as `Received` has it."""
    body = bytes(message.body)
    head = message.msg_type, message.seq_number, message.stamp_nanos, message.parts
    names = message.topic, message.link
    return (*head, *names, len(body), hashlib.sha256(body).hexdigest())


@pytest.mark.parametrize("vector", VECTORS, ids=NAMES)
def test_a_vector_decodes_to_its_meaning(vector: Vector, exchange: Exchange) -> None:
    arrivals = [(now, 1, datagram) for now, datagram in enumerate(vector.datagrams)]
    received = exchange.receive(arrivals)
    meant = vector.meaning
    assert sum(received.refused.values()) == len(meant.get("refused", []))
    assert set(received.refused) == set(meant.get("refused", []))
    assert received.counts[:2] == (len(meant["messages"]), meant.get("incomplete", 0))
    assert received.counts[-1] == 0
    for message, wanted in zip(received.messages, meant["messages"], strict=True):
        stamp = wanted["time_sec"] * SECOND + wanted["time_nsec"]
        head = wanted["msg_type"], wanted["seq_number"], stamp, wanted["parts"]
        body = wanted["body_size"], wanted["body_sha256"]
        assert message == (*head, wanted["topic"], wanted["link"], *body)


def test_typed_bodies_are_read_as_python_reads_them(exchange: Exchange) -> None:
    for body in TYPED_BODIES:
        ((_, *words),) = exchange.ask(b"T" + struct.pack("<i", len(body)) + body)
        assert " ".join(words) == typed_as(body)


@pytest.mark.parametrize("name", IN_ORDER)
def test_vector_is_fragmented_to_the_same_bytes(name: str, exchange: Exchange) -> None:
    datagrams = load(name).datagrams
    reassembler = Reassembler()
    message = [reassembler.receive(datagram, "", 0) for datagram in datagrams][-1]
    assert message is not None
    if message.seq_number > 1000:
        pytest.skip("the program would have to send billions before")
    size = max(256, len(datagrams[0]))
    assert exchange.send(message, size, message.seq_number + 1) == datagrams


@pytest.mark.parametrize("size", [256, 1472, 9000, 65507])
@pytest.mark.parametrize("body_size", [0, 1, 60_000, 400_000])
def test_a_message_is_cut_as_python_cuts_it(size: int, body_size: int, exchange: Exchange) -> None:
    stamp = -1_700_000_000_123_456_789
    message = Message(1, "/Wolke_ü", "lidar_link", stamp, 2, os.urandom(body_size))
    ours = [head + bytes(part) for head, part in fragments(message, size)]
    assert exchange.send(message, size, 3) == ours


@pytest.mark.parametrize(
    ("topic", "stamp", "body_size", "size"),
    [
        ("/" + 233 * "a", 0, 1, 1472),
        ("/a\0", 0, 1, 1472),
        ("/a", 2**31 * SECOND, 1, 1472),
        ("/a", 0, 255 * 65507, 1472),
        ("/a", 0, 1, 255),
        ("/a", 0, 1, 65508),
    ],
)
def test_unsendable_messages_are_refused(
    topic: str, stamp: int, body_size: int, size: int, exchange: Exchange
) -> None:
    message = Message(1, topic, "l", stamp, 0, bytes(body_size))
    assert exchange.send(message, size) == []
    assert exchange.send(message._replace(topic="/a", stamp_nanos=0, body=b"a"), 1472)


@pytest.mark.parametrize("datagrams", CASES.values(), ids=CASES)
def test_a_limit_is_the_same_to_both(datagrams: list[bytes], exchange: Exchange) -> None:
    means_the_same(exchange, [(now, 1, datagram) for now, datagram in enumerate(datagrams)])


def test_of_many_senders_the_memory_and_the_names_are_bounded(exchange: Exchange) -> None:
    large = [(0, who, part(0, 255, LARGE)) for who in (1, 2, 3, 4, 5)]
    means_the_same(exchange, KNOWN + large)
    means_the_same(exchange, [(0, who, part(0, 1, 1)) for who in [*range(66), 0]])
    means_the_same(exchange, own_give_way())


@pytest.mark.parametrize("first", range(0, 200, 50))
def test_whatever_arrives_means_the_same_to_both(exchange: Exchange, first: int) -> None:
    for seed in range(first, first + 50):
        means_the_same(exchange, damaged(journey(seed), seed))


def means_the_same(exchange: Exchange, arrivals: list[Arrival]) -> None:
    """Assert that C# makes of datagrams what Python does."""
    inbox = Inbox(receive_buffer=BUFFER, on_credit=lambda *_: None)
    messages, credits_ = [], set()
    arrivals = [arrival for arrival in arrivals if arrival[1] != REPORT]
    for now, who, datagram in arrivals:
        address = "127.0.0.1", who
        message, answer = inbox.receive(memoryview(datagram), address, now)
        if message is not None:
            messages.append(told(message))
        if answer is not None:
            credits_.add(acknowledged(answer[0]))
    inbox.reassembler.give_up_all()
    counted = inbox.reassembler.counters
    received = exchange.receive(arrivals)
    assert received.messages == messages
    assert received.refused == dict(counted.refused)
    assert received.counts == (
        *(counted.messages, counted.incomplete, counted.late),
        *(counted.missing, counted.duplicates, 0),
    )
    assert credits_ == {acknowledged(credit) for credit in received.credits}


def acknowledged(datagram: bytes) -> tuple[Any, ...]:
    """Return what a Credit says, but not how it is numbered."""
    header, at = parse(datagram)
    credit = Credit.parse(datagram[at:])
    assert credit.receive_buffer == BUFFER
    assert (header.msg_type, header.link, header.parts_max) == (64, "", 1)
    return header.topic, header.time_sec, header.time_nsec, *credit[:3]


def test_a_request_for_credit_is_answered_by_one_for_itself(exchange: Exchange) -> None:
    asks = [Header(64, number, 0, 1, 0, 0, "").pack() + CreditRequest().pack() for number in (7, 8)]
    received = exchange.receive([(0, 1, ask) for ask in asks])
    assert [acknowledged(credit)[-3:] for credit in received.credits] == [(64, 0, 7), (64, 0, 8)]
    assert [parse(credit)[0].seq_number for credit in received.credits] == [0, 1]
    assert received.messages == []


@pytest.mark.parametrize("seed", range(12))
def test_delivery_reports_match_python(exchange: Exchange, seed: int) -> None:
    arrivals = journey(seed)
    ours = by_python(arrivals, BUFFER, drops=False)
    assert sorted(exchange.receive(arrivals).reports) == sorted(ours.reports)
    assert len({row[-1] for row in ours.reports}) > 10


def test_link_reports_match_python(exchange: Exchange) -> None:
    inbox = Inbox(receive_buffer=BUFFER, on_credit=lambda *_: None)
    ours = []
    arrivals = damaged(journey(1), 1)
    for now, who, datagram in arrivals:
        if who != REPORT:
            inbox.receive(memoryview(datagram), ("127.0.0.1", who), now)
            continue
        for report, (_, to) in inbox.reports(now, WALL_NANOS + now):
            body = report[parse(report)[1] :]
            if body[0] == LINK_REPORT:
                ours.append((to, LinkReport.parse(body)))
    assert sorted(exchange.receive(arrivals).link_reports) == sorted(ours)
    assert len(ours[-1][1].reasons) > 3


def test_a_control_message_is_refused_for_the_same_reason(exchange: Exchange) -> None:
    arrivals = controls()
    ours = by_python(arrivals, BUFFER)
    assert exchange.receive(arrivals).refused == Counter(ours.refused)
    for arrival in arrivals:
        wanted = Counter(by_python([arrival], BUFFER).refused)
        assert exchange.receive([arrival]).refused == wanted


def test_only_a_peer_that_is_sent_messages_has_its_challenges_answered(
    exchange: Exchange,
) -> None:
    arrivals, responses = challenges()
    answers = exchange.receive(arrivals).credits
    for number, (ours, theirs) in enumerate(zip(responses, answers, strict=True)):
        assert theirs[:2] + theirs[6:] == ours[:2] + ours[6:]
        assert parse(theirs)[0].seq_number == number


def test_readme_example_receives_and_replies(library: Path) -> None:
    program = of_readme("Example", library)
    cloud = load("cloud-in-order")
    size = cloud.meaning["messages"][0]["body_size"]
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours,
        subprocess.Popen(["mono", str(program), "0"], stdout=subprocess.PIPE, text=True) as theirs,
    ):
        assert theirs.stdout is not None
        ours.settimeout(20)
        port = int(theirs.stdout.readline().split()[1])
        for datagram in cloud.datagrams:
            ours.sendto(datagram, ("127.0.0.1", port))
        answers = [64]
        while answers[-1] == 64:
            answers.append(parse(ours.recv(65536))[0].msg_type)
        assert theirs.stdout.readline().split()[1:] == [str(size), "bytes"]
        report = None
        while report is None or report.published == 0:
            header, at = parse(datagram := ours.recv(65536))
            if header.msg_type == 64 and datagram[at] == 1:
                report = TopicReport.parse(datagram[at:])
        assert (report.msg_type, report.published, report.missing) == (1, 1, 0)
        theirs.kill()
    assert len(answers) > 2, "no Credit"
    assert answers[-1] == 9
