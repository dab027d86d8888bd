# SPDX-License-Identifier: Apache-2.0
"""What a receiver of this library reports and refuses, for receivers in other languages.

An arrival is a time in nanoseconds, a sender, and a datagram; from `REPORT` as sender it is a time
to report. A message with the link `REFUSED` is one that the user can't take.
"""

from __future__ import annotations

import json
import random
from typing import NamedTuple

from tests.udp_bridge.vectors import FOLDER
from udp_bridge import Header, Message, fragments, parse
from udp_bridge.control import Credit, LinkReport, TopicReport
from udp_bridge.receiving import Inbox
from udp_bridge.types import CONTROL

Arrival = tuple[int, int, bytes]
REPORT = 255
REFUSED = "refused"
SECOND = 10**9
WALL_NANOS = 1_800_000_000 * SECOND
"""What the wall clock is ahead of the time of arrivals."""


class Reported(NamedTuple):
    """All that was reported, in order, and what was refused."""

    reports: list[tuple[int, str, str, int, TopicReport]]
    """To whom, topic, link, stamp and body."""
    refused: list[str]


def told(to: int, datagram: bytes) -> tuple[int, str, str, int, TopicReport]:
    """Return a report as `Reported` has it."""
    header, at = parse(datagram)
    assert (header.msg_type, header.parts_max) == (CONTROL, 1)
    return to, header.topic, header.link, header.stamp_nanos, TopicReport.parse(datagram[at:])


def by_python(arrivals: list[Arrival], receive_buffer: int, *, drops: bool = True) -> Reported:
    """Return what the library reports; without `drops` the user takes every message."""
    inbox = Inbox(receive_buffer=receive_buffer, on_credit=lambda *_: None)
    found = Reported([], [])
    refused = inbox.reassembler.counters.refused
    for now, sender, datagram in arrivals:
        if sender == REPORT:
            inbox.reassembler.expire(now)
            answers = inbox.reports(now, WALL_NANOS + now)
            topics = [one for one in answers if one[0][parse(one[0])[1]] == 1]
            found.reports.extend(told(to[1], answer) for answer, to in topics)
            continue
        before = dict(refused)
        address = "127.0.0.1", sender
        message, _ = inbox.receive(memoryview(datagram), address, now, 0)
        if message is not None and message.msg_type != CONTROL:
            if drops and message.link == REFUSED:
                inbox.dropped(message, address)
            else:
                inbox.published(message, address, WALL_NANOS + now)
            inbox.take_note()
        found.refused.extend(why for why, n in refused.items() if n > before.get(why, 0))
    return found


def journey(seed: int) -> list[Arrival]:
    """Return what arrives of some senders over networks that lose, copy, delay and damage."""
    rng = random.Random(seed)
    rows: list[tuple[float, int, bytes]] = []
    for sender in (1, 2):
        for topic, link in (("/a", ""), ("/b", "map"), ("/c", REFUSED)):
            number, now = rng.choice([0, 7, 2**32 - 3]), 0.0
            for _ in range(rng.choice([3, 12])):
                now += rng.choice([0.01, 0.3, 1.2])
                number += rng.choice([1, 1, 1, 2, 2000])
                if rng.random() < 0.1:  # restarted
                    number = rng.choice([0, 300])
                body = rng.randbytes(rng.choice([0, 5, 900, 3000]))
                stamp = WALL_NANOS + round((now - 0.5) * SECOND)
                one = Message(rng.choice([1, 1, 9]), topic, link, stamp, number % 2**32, body)
                for head, part in fragments(one, 600):
                    at = now + rng.choice([0, 0, 0, 0.1, 1.5])
                    rows += [(at, sender, head + bytes(part))] * rng.choice([0, 1, 1, 1, 1, 1, 2])
    rows += [(1.0 + i, REPORT, b"") for i in range(25)]
    rows.sort(key=lambda row: row[0])
    return [(round(at * SECOND), sender, datagram) for at, sender, datagram in rows]


def controls() -> list[Arrival]:
    """Return Control datagrams whose bodies are at their bounds and beyond."""
    report = TopicReport(1, 0, 5, 10, 1, 2, 3, 4, 0, 0, 0, 9, 1, 2, 3, 4, 5)
    most = 2**64 - 1
    bodies = [Credit(kind, 0, 0, 0).pack() for kind in range(256)]
    bodies += [report._replace(msg_type=kind).pack() for kind in range(256)]
    bodies += [report._replace(numbers=numbers).pack() for numbers in (9, 10, 11, 0, most)]
    for name in ("published", "dropped", "incomplete", "late", "pending"):
        value = getattr(report, name)
        for more in (-1, 0, 1, most - value, most - 9):
            if 0 <= value + more <= most:
                bodies.append(report._replace(**{name: value + more}).pack())
    reasons = tuple((chr(97 + i % 26) * (1 + i), i) for i in range(32))
    links = [LinkReport(1, 2, 3, 4, 5, reasons[:count]).pack() for count in (0, 1, 2, 31, 32)]
    names = [
        b"",
        b"a" * 32,
        b"a" * 33,
        b"A",
        b"a b",
        b"`",
        b"{",
        b"/",
        b":",
        b"0",
        b"9",
        b"z",
        b"_",
    ]
    links += [links[0] + bytes(8) + bytes([len(name)]) + name for name in names]
    links += [links[-1] + bytes(8), links[4] + bytes(8) + b"\1a", links[0] + bytes(8) + b"\2a"]
    bodies += links
    bodies += [b"", b"\3\0\0\0", bytes([255]) + bytes(20)]
    bodies += [bytes([kind]) + bytes(size) for kind in (8, 9, 10) for size in (14, 15, 16)]
    for whole in (bodies[0], report.pack(), links[0], links[1], b"\3\0\0\0"):
        bodies += [whole[:-1], whole + b"\0", whole[:1]]
    head = Header(CONTROL, 0, 0, 1, 1, 0, "/a").pack()
    rows = [head + body for body in bodies]
    rows += [Header(CONTROL, 0, part, 2, 1, 0, "/a").pack() + report.pack() for part in (0, 1)]
    rows.append(Header(CONTROL, 0, 0, 2, 1, 0, "/a").pack())
    return [(now, 1, row) for now, row in enumerate(rows)]


def challenges() -> tuple[list[Arrival], list[bytes]]:
    """Return challenges of senders 1, whose are answered, and 2; and the answers' bodies."""
    rows = json.loads((FOLDER / "control/address-validation.json").read_text())["cookies"]
    sent = [bytes.fromhex(row["challenge"]) for row in rows]
    arrivals = [(now, who, one) for now, one in enumerate(sent) for who in (2, 1)]
    return arrivals, [bytes.fromhex(row["response"]) for row in rows]
