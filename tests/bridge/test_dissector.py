# SPDX-License-Identifier: Apache-2.0
"""The Wireshark dissector decodes and refuses datagrams as the library does."""

import random
import struct
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.udp_bridge.vectors import VECTORS
from udp_bridge import MSG_TYPES, Header, Link, Message, Refused, parse
from udp_bridge.io.socket_wrappers import SocketWrapper
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.wire import control
from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse
from udp_bridge.wire.control import Credit, CreditRequest, LinkReport, Subscribe, TopicReport
from udp_bridge.wire.fec import RAPTORQ
from udp_bridge.wire.header import Buffer
from udp_bridge.wire.lockstep import (
    RESTARTED,
    WAITING,
    Barrier,
    BarrierReply,
    ExpectedResponse,
    SentMessages,
)
from udp_bridge.wire.message import Address
from udp_bridge.wire.repair import Offer, Request, Symbol, parse_resend, parse_symbol
from udp_bridge.wire.run_commands import PAUSED, STEP, RunCommand, RunCommandReply
from udp_bridge.wire.seal import Seal
from udp_bridge.wire.typed import pack_typed, parse_typed
from udp_bridge.wire.types import CONTROL, REPAIR, RESEND, SEALED, SUBSCRIBE, TYPED
from udp_bridge.wire.world_queries import WorldQuery, WorldReply, pack_text

from .pcap import Packet, write
from .tshark import Decoded, columns, decode

GATEWAY = ("10.0.0.1", 7510)
NODE = ("10.0.0.2", 7511)
ELSEWHERE = ("10.0.0.3", 9)


def decoded(
    folder: Path, datagrams: Sequence[bytes], *options: str, to: Address = NODE
) -> list[Decoded]:
    capture = folder / "capture.pcap"
    write(capture, [Packet((GATEWAY[0], to[1]), to, datagram) for datagram in datagrams])
    return decode(capture, *options)


SINGLE_PART: dict[int, Callable[[bytes], object]] = {
    CONTROL: control.parse,
    RESEND: parse_resend,
    SUBSCRIBE: Subscribe.parse,
}
"""Parsers of bodies that have one part."""


def reason(datagram: bytes) -> str | None:
    """Return why the library refuses a single datagram."""
    try:
        header, offset = parse(datagram)
        if header.parts_max > 1 and len(datagram) == offset:
            return "part_size"
        if parse_body := SINGLE_PART.get(header.msg_type):
            if header.parts_max > 1:
                return "parts_max"
            parse_body(datagram[offset:])
        if header.msg_type == REPAIR and parse_symbol(datagram[offset:])[0].code != RAPTORQ:
            return "repair_code"
        if header.msg_type == TYPED and header.parts_max == 1:
            parse_typed(datagram[offset:])
    except Refused as refused:
        return refused.reason
    return None


def shown(header: Header, size: int) -> Decoded:
    """Return what the dissector should show of a header and a body of `size` bytes."""
    fields = {
        name: str(getattr(header, name))
        for name in ("msg_type", "seq_number", "part_number", "parts_max", "time_sec", "time_nsec")
    }
    topic, link = header.topic.encode(), header.link.encode()
    fields["header_size"] = str(len(header.pack()))
    fields["topic_size"], fields["link_size"] = str(len(topic)), str(len(link))
    fields["topic"], fields["link"] = header.topic, header.link
    fields["fragment_size"] = str(size)
    row = MSG_TYPES[header.msg_type]
    if row.ros_type is not None:
        fields["ros_type"] = row.ros_type
    if not header.topic and row.default_topic:
        fields["default_topic"] = row.default_topic
    return fields


def test_vectors(tmp_path: Path) -> None:
    datagrams = [datagram for vector in VECTORS for datagram in vector.datagrams if datagram]
    found = decoded(tmp_path, datagrams)
    assert len(found) == len(datagrams)
    for datagram, fields in zip(datagrams, found, strict=True):
        assert fields.get("refused") == reason(datagram)
        if reason(datagram) is None:
            header, offset = parse(datagram)
            body = datagram[offset:]
            expected = shown(header, len(body))
            assert expected.items() <= fields.items()
            if header.msg_type not in (SUBSCRIBE, CONTROL):
                assert fields["fragment"] == body.hex(":")
        else:
            assert str(reason(datagram)) in fields["_ws.expert.message"]


def test_every_type_has_its_name_and_default_topic(tmp_path: Path) -> None:
    headers = [
        Header(number, 5, 0, 2, 1000, 7, "", "")
        for number, row in MSG_TYPES.items()
        if row.ros_type is not None
    ]
    found = decoded(tmp_path, [header.pack() + b"part" for header in headers])
    for header, fields in zip(headers, found, strict=True):
        assert shown(header, 4).items() <= fields.items()
        assert "refused" not in fields


CREDIT = Credit(33, 200, 2**32 - 1, 8 << 20)
REPORT = TopicReport(1, 2**32 - 2, 3, 2**63, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, -16, -(2**63))
BODIES: list[tuple[int, bytes, str, dict[str, object]]] = [
    (
        SUBSCRIBE,
        Subscribe(1, 1, 10, 2.5).pack(),
        "subscribe",
        {"wanted_type": 1, "action": 1, "lease": 10, "max_rate": 2.5},
    ),
    (CONTROL, CREDIT.pack(), "credit", CREDIT._asdict()),
    (CONTROL, CreditRequest().pack(), "credit_request", {}),
    (
        *(CONTROL, REPORT.pack(), "topic_report"),
        {name.replace("_nanos", ""): value for name, value in REPORT._asdict().items()},
    ),
    (
        CONTROL,
        LinkReport.of(212_992, 2**63, 2, 4, {"part_size": 3}).pack(),
        "link_report",
        {
            "receive_buffer": 212_992,
            "datagrams": 2**63,
            "bytes": 2,
            "refused": 3,
            "kernel_drops": 4,
            "reason": "part_size",
            "reason_count": 3,
        },
    ),
    (
        CONTROL,
        Barrier(
            2**64 - 1,
            -1,
            500,
            (SentMessages(36, "/odóm", 2**32 - 1, 2),),
            (ExpectedResponse("/cmd_vel", "/clock", 9, 3),),
            in_turn=True,
        ).pack(),
        "barrier",
        {"topics": 1, "responses": 1, "in_turn": 1, "limit": 500, "episode": 2**64 - 1, "tick": -1},
    ),
    (
        CONTROL,
        BarrierReply(7, 2**53 + 1, WAITING, 3, (SentMessages(9, "/cmd_vel", 5, 1),)).pack(),
        "barrier_reply",
        {"topics": 1, "state": 1, "lost": 3, "episode": 7, "tick": 2**53 + 1},
    ),
    (CONTROL, BarrierReply(7, 0, RESTARTED).pack(), "barrier_reply", {"state": 3}),
    (
        CONTROL,
        RunCommand(2**63, STEP, 400).pack(),
        "run_command",
        {"action": 3, "ticks": 400, "number": 2**63},
    ),
    (
        CONTROL,
        RunCommandReply(2**63, PAUSED, 400, "no próblem").pack(),
        "run_command_reply",
        {"state": 2, "number": 2**63, "tick": 400, "error": "no próblem"},
    ),
    (
        CONTROL,
        AddressChallenge(bytes(range(12))).pack(),
        "address_challenge",
        {"cookie": bytes(range(12)).hex(":")},
    ),
    (
        CONTROL,
        AddressResponse(bytes(range(12))).pack(),
        "address_response",
        {"cookie": bytes(range(12)).hex(":")},
    ),
    (
        CONTROL,
        WorldQuery(2**63, pack_text('{"query": "world"}')).pack(),
        "world_query",
        {"number": 2**63},
    ),
    (
        CONTROL,
        WorldReply(2**64 - 1, pack_text('{"error": "próblem"}')).pack(),
        "world_reply",
        {"number": 2**64 - 1},
    ),
    (
        RESEND,
        Offer(1, 20, 500).pack(),
        "offer",
        {"msg_type": 1, "parts_max": 20, "limit": 500},
    ),
    (
        RESEND,
        Request(1, 20, 1, 2**32 - 1, (0, 7, 8, 19)).pack(),
        "request",
        {
            "msg_type": 1,
            "parts_max": 20,
            "messages": 1,
            "goodput": 2**32 - 1,
            "parts": "0 7 8 19",
        },
    ),
    (RESEND, Request(1, 0, 64, 5).pack(), "request", {"parts_max": 0, "messages": 64}),
    (
        REPAIR,
        Symbol(1, 4, 1, 63).pack() + bytes(range(16)),
        "symbol",
        {
            "msg_type": 1,
            "parts_max": 4,
            "code": 1,
            "body_size": 63,
            "data": bytes(range(16)).hex(":"),
        },
    ),
    (
        TYPED,
        pack_typed("sensor_msgs/msg/MagneticField", bytes(9)),
        "typed",
        {"name_size": 29, "ros_type": "sensor_msgs/msg/MagneticField"},
    ),
]


@pytest.mark.parametrize(("msg_type", "body", "name", "values"), BODIES)
def test_bodies_that_are_not_plain_cdr(
    tmp_path: Path, msg_type: int, body: bytes, name: str, values: dict[str, object]
) -> None:
    header = Header(msg_type, 0, 0, 1, 1000, 0, "/topic", "link")
    (fields,) = decoded(tmp_path, [header.pack() + body])
    assert shown(header, len(body)).items() <= fields.items()
    assert "refused" not in fields
    expected = {f"{name}.{field}": str(value) for field, value in values.items()}
    assert expected.items() <= fields.items()


def test_the_text_of_a_world_query_is_shown_decompressed(tmp_path: Path) -> None:
    head = Header(CONTROL, 0, 0, 1, 1000, 0).pack()
    whole, broken = pack_text('{"name": "próblem"}'), b"no zlib"
    found = decoded(
        tmp_path,
        [head + of(1, text).pack() for of in (WorldQuery, WorldReply) for text in (whole, broken)],
    )
    for fields, packed in zip(found, (whole, broken) * 2, strict=True):
        assert "refused" not in fields
        assert fields["world_text.packed"] == packed.hex(":")
        assert fields.get("world_text.text") == ('{"name": "próblem"}' if packed == whole else None)


def test_the_ranges_of_a_barrier_are_shown(tmp_path: Path) -> None:
    header = Header(CONTROL, 0, 0, 1, 1000, 0)
    (barrier,) = (body for _, body, name, _ in BODIES if name == "barrier")
    (fields,) = decoded(tmp_path, [header.pack() + barrier])
    assert fields["sent.msg_type"] == "36"
    assert fields["sent.topic"] == "/odóm"
    assert (fields["sent.first"], fields["sent.messages"]) == (str(2**32 - 1), "2")
    assert (fields["response.msg_type"], fields["response.every"]) == ("9", "3")
    assert (fields["response.topic"], fields["response.of"]) == ("/cmd_vel", "/clock")


def test_a_sealed_datagram_shows_the_one_within(tmp_path: Path) -> None:
    twist = Header(9, 1, 0, 1, 0, 0, "/cmd_vel", "").pack() + bytes(52)
    seal = Seal(b"a secret for this test", sends=1, sender=7)
    sealed = b"".join(bytes(part) for part in seal.sealed([twist], 2**63 + 1))
    capture = tmp_path / "sealed.pcap"
    write(capture, [Packet(GATEWAY, NODE, sealed), Packet(GATEWAY, NODE, sealed[:43])])
    names = "msg_type sealed.sender sealed.direction sealed.counter sealed.tag topic refused"
    whole, cut = columns(capture, [f"udpbridge.{name}" for name in names.split()])
    assert whole == [f"{SEALED},9", "7", "1", str(2**63 + 1), sealed[-16:].hex(), "/cmd_vel", ""]
    assert cut == [str(SEALED), "", "", "", "", "", "bad_tag"]


def test_other_ports_dissect_valid_datagrams_only(tmp_path: Path) -> None:
    twist = Header(9, 1, 0, 1, 0, 0, "/cmd_vel", "").pack() + bytes(52)
    broken = bytes([9, 21]) + twist[2:]
    ours, others = decoded(tmp_path, [twist, broken], to=ELSEWHERE)
    assert ours["topic"] == "/cmd_vel"
    assert others == {}
    _, told = decoded(tmp_path, [twist, broken], "-o", "udpbridge.ports:9", to=ELSEWHERE)
    assert told["refused"] == "header_size_unaligned"


def test_ten_thousand_mutated_datagrams_get_the_library_s_reasons(tmp_path: Path) -> None:
    rng = random.Random(1)
    seeds = [datagram for vector in VECTORS for datagram in vector.datagrams if datagram]
    for msg_type, body, _, _ in BODIES:
        seeds += [Header(msg_type, 0, 0, 1, 1000, 0, "/topic", "link").pack() + body] * 40
    datagrams = []
    for _ in range(10_000):
        changed = bytearray(rng.choice(seeds)[:200])
        for _ in range(rng.randrange(3)):
            at = rng.randrange(min(len(changed), rng.choice([18, 60, 200])))
            changed[at] = rng.choice([0, 1, 2, 18, 20, 127, 128, 192, 255, rng.randrange(256)])
        if rng.random() < 0.2:
            del changed[rng.randrange(1, len(changed) + 1) :]
        datagrams.append(bytes(changed))
    found = decoded(tmp_path, datagrams)
    got = [fields.get("refused") for fields in found]
    expected = [reason(datagram) for datagram in datagrams]
    rows = zip(datagrams, got, expected, strict=True)
    # Whoever has no key refuses what is sealed; the dissector looks into it.
    differing = [row for row in rows if row[1] != row[2] and row[2] != "sealed"]
    assert not differing[:3]
    assert len(set(expected)) > 15  # it was worth comparing


NAMES = ["", "ż", "\0", "\U0010ffff"]
NO_NAMES = "c080 c1bf e09fbf eda080 f08fbfbf f4908080 f5808080 80 ff c5 e282 c541"
"""In hexadecimal: overlong forms, surrogates, beyond Unicode, stray and missing bytes."""


def test_names_are_utf8_where_they_are_for_the_library(tmp_path: Path) -> None:
    names = [name.encode() for name in NAMES] + [bytes.fromhex(name) for name in NO_NAMES.split()]
    fixed = Header(9, 1, 0, 1, 0, 0, "/12345", "").pack()
    datagrams = [fixed[:18] + name.ljust(6, b"x") + fixed[24:] for name in names]
    found = decoded(tmp_path, datagrams)
    expected = [reason(datagram) for datagram in datagrams]
    assert [fields.get("refused") for fields in found] == expected
    assert expected.count("topic_not_utf8") == len(NO_NAMES.split())


class RecordingSocket(SocketWrapper):
    """A socket that records what is sent."""

    def __init__(self, packets: list[Packet]) -> None:
        super().__init__(UdpSocket(("127.0.0.1", 0), receive_buffer=1 << 20, wait_s=0.1))
        self._packets = packets

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        self._packets.append(Packet(self.address, to, b"".join(bytes(part) for part in buffers)))
        return super().send(buffers, to)


def test_traffic_of_two_links(tmp_path: Path) -> None:
    packets: list[Packet] = []
    done = threading.Event()

    def on_message(message: Message, sender: Address) -> None:
        if message.msg_type == 1:
            done.set()

    here, there = RecordingSocket(packets), RecordingSocket(packets)
    with (
        Link(("", 0), there.address, socket=here) as sender,
        Link(("", 0), on_message=on_message, socket=there),
    ):
        sender.send(9, "/cmd_vel", "", 1_000_000_001, bytes(52))
        sender.send(1, "/points", "lidar", 2_000_000_000, bytes(200_000))
        assert done.wait(20.0)
    write(tmp_path / "traffic.pcap", packets)
    found = decode(tmp_path / "traffic.pcap")
    assert len(found) == len(packets)
    assert not [fields for fields in found if "refused" in fields]
    twist, *others = found
    assert (twist["topic"], twist["fragment_size"]) == ("/cmd_vel", "52")
    clouds = [fields for fields in others if fields["msg_type"] == "1"]
    assert [fields["part_number"] for fields in clouds] == ["0", "1", "2", "3"]
    first = 1 + next(index for index, fields in enumerate(found) if fields["msg_type"] == "1")
    assert {fields["first_part"] for fields in clouds} == {str(first)}
    credits = [fields for fields in others if "credit.part_number" in fields]
    assert credits[-1]["credit.part_number"] == "3"
    assert struct.calcsize("<BBBxII") == int(credits[-1]["fragment_size"])
