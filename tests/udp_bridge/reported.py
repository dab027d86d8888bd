# SPDX-License-Identifier: Apache-2.0
"""What a receiver of this library reports and refuses, for receivers in other languages.

An arrival is a time in nanoseconds, a sender, and a datagram; from `REPORT` as sender it is a time
to report. A message with the link `REFUSED` is one that the user can't take.
"""

import json
import math
import random
import struct
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from tests.udp_bridge.vectors import FOLDER
from udp_bridge import Header, Message, fragments, parse
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.wire.control import Credit, LinkReport, Subscribe, TopicReport
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND, SUBSCRIBE

Arrival = tuple[int, int, bytes]
REPORT = 255
REFUSED = "refused"
SECOND = 10**9
WALL_NANOS = 1_800_000_000 * SECOND
"""What the wall clock is ahead of the time of arrivals."""


class Reported(NamedTuple):
    """All that was reported and acknowledged, in order, and what was refused."""

    reports: list[tuple[int, str, str, int, TopicReport]]
    """To whom, topic, link, stamp and body."""
    refused: list[str]
    credits: list[tuple[int, str, int, Credit]]
    """To whom, topic, stamp and body."""
    subscribes: list[Subscribe]
    """What was handed over of type 7."""


def credited(to: int, datagram: bytes) -> tuple[int, str, int, Credit]:
    """Return a Credit as `Reported` has it."""
    header, at = parse(datagram)
    assert (header.msg_type, header.parts_max, header.link) == (CONTROL, 1, "")
    return to, header.topic, header.stamp_nanos, Credit.parse(datagram[at:])


def told(to: int, datagram: bytes) -> tuple[int, str, str, int, TopicReport]:
    """Return a report as `Reported` has it."""
    header, at = parse(datagram)
    assert (header.msg_type, header.parts_max) == (CONTROL, 1)
    return to, header.topic, header.link, header.stamp_nanos, TopicReport.parse(datagram[at:])


def by_python(arrivals: list[Arrival], receive_buffer: int, *, drops: bool = True) -> Reported:
    """Return what the library reports; without `drops` the user takes every message."""
    inbox = Inbox(receive_buffer=receive_buffer, on_credit=lambda *_: None)
    found = Reported([], [], [], [])
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
        message, answer = inbox.receive(memoryview(datagram), address, now)
        if answer is not None:
            found.credits.append(credited(sender, answer[0]))
        if message is not None and message.msg_type == SUBSCRIBE:
            found.subscribes.append(Subscribe.parse(message.body))
        if message is not None and message.msg_type != CONTROL:
            if drops and message.link == REFUSED:
                inbox.mark_dropped(message, address)
            else:
                inbox.mark_published(message, address, WALL_NANOS + now)
            inbox.update_logs()
        found.refused.extend(why for why, n in refused.items() if n > before.get(why, 0))
    return found


def journey(seed: int) -> list[Arrival]:
    """Return what arrives of some senders over networks that lose, copy and delay."""
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


def damaged(arrivals: list[Arrival], seed: int) -> list[Arrival]:
    """Return arrivals of which every fourth has a flipped bit, or more or fewer bytes."""
    rng = random.Random(seed)
    found = []
    for now, sender, datagram in arrivals:
        damage = rng.choice(["", "", "", "", "", "", "flipped", "flipped", "longer", "shorter"])
        if damage == "flipped" and datagram:  # not its type, which receivers need not know
            at = rng.randrange(1, min(30, len(datagram)))
            flipped = datagram[at] ^ 1 << rng.randrange(8)
            datagram = datagram[:at] + bytes([flipped]) + datagram[at + 1 :]
        elif damage == "longer":
            datagram += b"more"
        elif damage == "shorter":
            datagram = datagram[: rng.randrange(len(datagram) + 1)]
        found.append((now, sender, datagram))
    return found


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
    names = [b"", b"a" * 32, b"a" * 33, b"a b", *(bytes([byte]) for byte in b"A`{/:09z_")]
    links += [links[0] + bytes(8) + bytes([len(name)]) + name for name in names]
    links += [links[-1] + bytes(8), links[4] + bytes(8) + b"\1a", links[0] + bytes(8) + b"\2a"]
    bodies += links
    bodies += [b"", b"\3\0\0\0", bytes([255]) + bytes(20)]
    bodies += [bytes([kind]) + bytes(size) for kind in (8, 9, 12) for size in (14, 15, 16)]
    for whole in (bodies[0], report.pack(), links[0], links[1], b"\3\0\0\0"):
        bodies += [whole[:-1], whole + b"\0", whole[:1]]
    head = Header(CONTROL, 0, 0, 1, 1, 0, "/a").pack()
    rows = [head + body for body in bodies]
    rows += [Header(CONTROL, 0, part, 2, 1, 0, "/a").pack() + report.pack() for part in (0, 1)]
    rows.append(Header(CONTROL, 0, 0, 2, 1, 0, "/a").pack())
    return [(now, 2, row) for now, row in enumerate(rows)]


def challenges() -> tuple[list[Arrival], list[bytes]]:
    """Return challenges of senders 1, whose are answered, and 2; and the answers' bodies."""
    rows = json.loads((FOLDER / "control/address-validation.json").read_text())["cookies"]
    sent = [bytes.fromhex(row["challenge"]) for row in rows]
    arrivals = [(now, who, one) for now, one in enumerate(sent) for who in (2, 1)]
    return arrivals, [bytes.fromhex(row["response"]) for row in rows]


def single(number: int = 0, sec: int = 1, topic: str = "/a", link: str = "") -> bytes:
    return Header(1, number, 0, 1, sec, 0, topic, link).pack() + b"x"


def part(number: int, of: int, size: int, seq: int = 0, topic: str = "/a", sec: int = 1) -> bytes:
    return Header(1, seq, number, of, sec, 0, topic).pack() + bytes(size)


def at_once(datagrams: Iterable[bytes], sender: int = 1) -> list[Arrival]:
    rows = [(0, sender, datagram) for datagram in datagrams]
    return [*rows, (SECOND, REPORT, b"")]


def edge(datagram: bytes, **fields: int) -> bytes:
    """Return a datagram with other bytes in its header."""
    raw = bytearray(datagram)
    for name, value in fields.items():
        offset, layout = _PLACES[name]
        struct.pack_into(layout, raw, offset, value)
    return bytes(raw)


_PLACES = {
    "header_size": (1, "<B"),
    "part_number": (6, "<B"),
    "parts_max": (7, "<B"),
    "nsec": (12, "<i"),
    "topic_size": (16, "<B"),
    "link_size": (17, "<B"),
}


def _headers() -> list[bytes]:
    rows = [bytes(size) for size in (0, 1, 17, 18, 19, 20)]
    whole = single(topic="/abc", link="map")  # 18 + 4 + 3 + 3 of padding
    rows += [whole[:size] for size in (27, 28, 29)]
    rows += [edge(whole, header_size=size) for size in (0, 16, 19, 20, 24, 27, 28, 29, 32)]
    rows += [edge(whole, nsec=nsec) for nsec in (-(2**31), -1, 0, 1, 10**9 - 1, 10**9)]
    rows += [edge(whole, topic_size=size, link_size=0) for size in range(15)]
    rows += [edge(whole, link_size=size) for size in range(12)]
    rows += [
        edge(part(0, 2, 9), part_number=number, parts_max=of)
        for of in (0, 1, 2, 255)
        for number in (0, 1, 2, 254, 255)
    ]
    rows += [edge(single(), header_size=20, topic_size=2) + bytes(size) for size in (0, 1)]
    known = set(range(256)) - {RESEND, REPAIR}  # which receivers need not know
    rows += [Header(kind, 0, 0, 1, 1, 0, f"/{kind}").pack() + b"x" for kind in known]
    return rows


def _texts() -> list[bytes]:
    """Return names at the bounds of UTF-8, as topic and as link."""
    leads = (0x7F, 0x80, 0xBF, 0xC0, 0xC1, 0xC2, 0xDF, 0xE0, 0xE1, 0xEC, 0xED, 0xEE, 0xEF)
    leads += (0xF0, 0xF1, 0xF3, 0xF4, 0xF5, 0xFF)
    nexts = (0x7F, 0x80, 0x8F, 0x90, 0x9F, 0xA0, 0xBF, 0xC0)
    names = [bytes([lead]) for lead in leads]
    for lead in leads:
        for second in nexts:
            names += [bytes([lead, second])]
            for more in (b"\x80", b"\xbf", b"\x7f", b"\xc0"):
                names += [bytes([lead, second]) + more, bytes([lead, second]) + more * 2]
    names += [b"\0", b"a\0", b"\0a", b"ab"]
    pairs = [pair for name in names for pair in ((name, b"l"), (b"t", name))]
    # What a name lacks stands behind it: in the link, or in the padding.
    pairs += [(b"\xc2", b"\x80"), (b"\xe0\xa0", b"\x80"), (b"\xf0\x90\x80", b"\x80")]
    rows = []
    for topic, link in pairs:
        pad = -(18 + len(topic) + len(link)) % 4
        head = struct.pack("<BBIBBii", 1, 18 + len(topic) + len(link) + pad, 0, 0, 1, 1, 0)
        rows.append(head + bytes([len(topic), len(link)]) + topic + link + bytes(pad) + b"x")
    return rows


def _subscribes() -> list[bytes]:
    rates = (0.0, -0.0, -1e-45, 1e-45, 3.4e38, math.inf, -math.inf, math.nan, 3.4028234e38)
    bodies = [struct.pack("<BBHf", 1, 1, 0, rate) for rate in rates]
    bodies += [struct.pack("<BBHf", kind, 1, 0, 0.0) for kind in range(256)]
    bodies += [struct.pack("<BBHf", 1, action, 0, 0.0) for action in (0, 1, 2, 255)]
    bodies += [struct.pack("<BBHf", 1, 1, lease, 2.5) for lease in (1, 255, 256, 65535)]
    bodies += [bodies[0][:-1], bodies[0] + b"\0", b""]
    return [Header(7, n, 0, 1, 1, 0, "/a").pack() + body for n, body in enumerate(bodies)]


def _times() -> Iterator[list[Arrival]]:
    """Yield arrivals at the bounds of time, each for a receiver of its own."""
    for later in (-1, 0, 1):
        two = 2 * SECOND + later  # a message is given up
        ask = Header(CONTROL, 0, 0, 1, 0, 0, "").pack() + b"\3\0\0\0"
        yield [(0, 1, part(0, 2, 9)), (two, 1, part(1, 2, 9)), (two, REPORT, b"")]
        yield [(0, 1, part(0, 2, 9)), (two, REPORT, b""), (two, 1, part(1, 2, 9))]
        yield [(0, 1, part(0, 2, 9)), (two, 2, ask), (two, REPORT, b"")]
        for number in (0, 254, 255, 256, 257):  # a sender is restarted, or late
            for last in (number - 1, number, number + 1, 2**31 + number - 1, 2**31 + number):
                first = single(last % 2**32, sec=5)
                rows = [(0, 1, first), (1, 1, part(0, 2, 9, (last + 5) % 2**32, sec=6))]
                now = SECOND + later
                rows += [(now, 1, single(number, sec)) for sec in (5, 4, 6)]
                rows += [(now, 1, first), (now, 1, part(1, 2, 9, (last + 5) % 2**32, sec=6))]
                yield [*rows, (now, REPORT, b"")]
        sec, nanos = divmod(3 * SECOND + later, SECOND)  # stale, or a clock that was set back
        imu = [Header(2, 5, 0, 1, 5, 0, "/imu"), Header(2, 6, 0, 1, sec, nanos, "/imu")]
        yield [*((0, 1, header.pack() + b"body") for header in imu), (SECOND, REPORT, b"")]
        for bound in (5 * SECOND, 10 * SECOND):  # of reporting, and of ages
            yield [(0, 1, single()), (bound + later, REPORT, b"")]
            heard = [(0, 1, single()), (bound + later, 1, single(1, 2))]
            yield [*heard, (bound + later, REPORT, b"")]


def _counts() -> Iterator[list[Arrival]]:
    """Yield arrivals at the bounds of numbers, each for a receiver of its own."""
    for count in (3, 4, 5, 6):  # open messages of a topic
        rows = [part(0, 2, 9, seq) for seq in range(count)]
        yield at_once(rows + [part(1, 2, 9, seq) for seq in range(count)])
        yield at_once([*rows, single(count), *(part(1, 2, 9, seq) for seq in range(count))])
    for count in (63, 64, 65):  # finished ones that are remembered
        yield at_once([single(seq, 1 + seq) for seq in range(count)] + [single(0, 1)])
    for count in (63, 64, 65, 66):  # senders
        rows = [(now, 1 + now, single()) for now in range(count)]
        yield [*rows, (count, 1, single()), (count, REPORT, b"")]
        rows = [(now, 1 + now % count, single(now // count)) for now in range(2 * count)]
        yield [*rows, (count, 2, single(0)), (count, 200, single()), (2 * count, REPORT, b"")]
    for count in (1023, 1024, 1025):  # topics
        rows = [(now, 1, single(topic=f"/{now}")) for now in range(count)]
        yield [*rows, (count, 1, single(topic="/0")), (count, REPORT, b"")]
        yield [*rows[1:], (count, 2, single(topic="/0")), (count, REPORT, b"")]
    tie = [(0, who, single(topic=f"/{n}")) for who in (1, 2) for n in range(512)]
    back = [(0, who, single(topic="/0")) for who in (3, 2, 1)]
    yield [*tie, *back, (1, REPORT, b"")]
    for ahead in (1, 2, 1022, 1023, 1024, 1025, 2**31 - 1, 2**31):  # outcomes that are remembered
        rows = [part(0, 2, 9, 0), part(0, 2, 9, ahead), part(1, 2, 9, 0), single(ahead + 1, 2)]
        yield at_once(rows)
        yield at_once([single(ahead, 9), part(0, 2, 9, 0), part(1, 2, 9, 0, sec=1)])
        yield at_once([single(ahead, 9), single(ahead - 1, 8), single(ahead + 1, 1)])
    for count in (1, 2, 50, 99, 100, 101, 1023, 1024, 1025):  # ages
        rows = [(now * 7919 % 9_999_991, 1, single(seq, 1)) for seq, now in enumerate(range(count))]
        yield [*sorted(rows), (10**7, REPORT, b"")]
    for last in (0, 1, 8, 9, 10):  # parts and the part size
        for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0), (0, 2, 1), (2, 1, 0, 2), (0, 0, 1, 2)):
            sizes = {0: 9, 1: 9, 2: last}
            yield at_once(part(number, 3, sizes[number]) for number in order)
        yield at_once([part(0, 3, 9), part(1, 3, last), part(1, 3, 9), part(2, 3, 5)])
        yield at_once([part(0, 2, 9), edge(part(1, 2, 9), parts_max=3), part(1, 2, last)])
    for seq in (0, 63, 64, 65, 128, 192, 254):  # bits of parts
        yield at_once(part(number, 255, 3) for number in range(255) if number != seq)
        yield at_once(part(number, seq + 1, 3) for number in range(seq + 1))
    same, other = single(0, 1, link="x"), part(0, 2, 3)
    yield at_once([same, same, other, other, Header(1, 1, 0, 2, 1, 0, "/a", "y").pack() + b"abc"])
    yield at_once([other, Header(1, 0, 1, 2, 1, 0, "/a", "y").pack() + b"abc", part(1, 2, 3)])


def _memory() -> Iterator[list[Arrival]]:
    """Yield arrivals at the bounds of memory: a sender has 16 MiB of 64."""
    quarter = [part(0, 128, 1 << 15, seq, topic="/large") for seq in range(4)]
    small = part(0, 2, 9, topic="/small"), part(1, 2, 9, topic="/small")
    rests = [part(n, 128, 1 << 15, 0, topic="/large") for n in range(1, 128)]
    for count in (3, 4):
        yield at_once([*quarter[:count], *small, *rests])


def full_memory(sizes: tuple[int, ...]) -> list[Arrival]:
    """Return arrivals of four senders that announce 64 MiB, and of one with small messages."""
    quarter = [part(0, 128, 1 << 15, seq, topic="/large") for seq in range(4)]
    rests = [part(n, 128, 1 << 15, 0, topic="/large") for n in range(1, 128)]
    rows = [(0, who, row) for who in (1, 2, 3, 4) for row in quarter]
    rows += [(0, 5, part(0, 2, size, topic=f"/{n}")) for n, size in enumerate(sizes)]
    rows += [(0, who, row) for who in (1, 2, 3, 4) for row in rests]
    rows += [(0, 5, part(1, 2, size, topic=f"/{n}")) for n, size in enumerate(sizes)]
    return [*rows, (SECOND, REPORT, b"")]


def boundaries() -> list[list[Arrival]]:
    """Return arrivals at the bounds of PROTOCOL.md, each list for a receiver of its own."""
    alone = [at_once([row]) for row in (*_headers(), *_texts(), *_subscribes())]
    return [*alone, *_times(), *_counts(), *_memory()]


def twist(seq: int, tenths: int) -> bytes:
    return Header(9, seq, 0, 1, tenths // 10, tenths % 10 * 10**8, "/a").pack() + b"x"


JUMPING = [5, 3005, 6, 3006, 7, 3007, 10, 2**31, 2**31 + 1, 11, 12, 13, 4000, 3800, 3801, 3802]
STALE = [(5, 100), (6, 99), (7, 101), (8, 100), (9, 100), (10, 70), (11, 69), (12, 68), (13, 67)]
LARGE = 65_000
KNOWN = [(0, who, part(0, 1, 1, topic="/known")) for who in (1, 2, 3, 4, 5)]
"""Python lets strangers have no more together than one sender of which a message came."""
CASES: dict[str, list[bytes]] = {
    "behind with an equal stamp": [part(0, 1, 1, seq=5), part(0, 1, 1, seq=3)],
    "numbers that jump": [part(0, 1, 1, seq=seq) for seq in JUMPING],
    "messages that jump": [part(i, 2, 9, seq=seq) for seq in JUMPING for i in (0, 1)],
    "a clock that is set back": [twist(*row) for row in STALE],
    "last part first, and too large": [part(2, 3, 9), part(0, 3, 8), part(1, 3, 8), part(2, 3, 7)],
    "padding of a header": [
        edge(single(topic="/a") + bytes(8), header_size=size) for size in (20, 24, 28)
    ],
    "rates of subscriptions": [
        Header(7, 0, 0, 1, 1, 0, "/a").pack() + Subscribe(1, max_rate_hz=rate).pack()
        for rate in (0.0, 1.0)
    ],
    "more open messages than a topic has": [part(0, 2, 1, seq=i) for i in range(6)],
    "more than a sender's share": [part(0, 255, LARGE, topic=f"/{i}") for i in (1, 2, 1)],
    "more topics than are remembered": [part(0, 1, 1, topic=f"/{i % 1025}") for i in range(1030)],
}


def own_give_way() -> list[Arrival]:
    """Return what a sender sends that goes beyond all of the memory, and then asks of its first."""
    large = KNOWN + [(0, who, part(0, 255, LARGE)) for who in (1, 2, 3)]
    fourth = [(0, 4, part(0, 240, 65_000)), (0, 5, part(0, 40, 32_000, topic="/first"))]
    too_much = [(0, 5, part(0, 60, 32_000, topic="/second"))]
    return [
        *large,
        *fourth,
        *too_much,
        *((0, 5, part(i, 40, 32_000, topic="/first")) for i in range(1, 40)),
    ]
