# SPDX-License-Identifier: Apache-2.0
"""PROTOCOL.md says what the code does."""

import ast
import re
from pathlib import Path

import pytest

import udp_bridge
from udp_bridge import Limits, parse
from udp_bridge.receiver import assembly, nack, round_trip
from udp_bridge.sender import flow_control as flow
from udp_bridge.sender import resend
from udp_bridge.wire import address_validation, control, world_queries
from udp_bridge.wire.control import Subscribe

from .vectors import load

SOURCE = Path(udp_bridge.__file__).parent
PAGE = (SOURCE.parents[1] / "PROTOCOL.md").read_text()


def table(heading: str) -> list[list[str]]:
    """Return the cells of the first table behind a text, without its head."""
    behind = PAGE[PAGE.index(heading) :]
    rows = re.search(r"(?:^\|.*\n)+", behind, re.MULTILINE)
    assert rows is not None
    lines = rows.group().splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_the_worked_example_is_the_vector() -> None:
    lines = re.findall(r"^([0-9a-f]{4})  ([0-9a-f ]+)$", PAGE, re.MULTILINE)
    dump = bytes.fromhex(" ".join(data for _, data in lines))
    (datagram,) = load("twist").datagrams
    assert dump == datagram
    assert [int(offset, 16) for offset, _ in lines] == list(range(0, len(dump), 16))
    explained = [cell.strip("`") for cell, _, _ in table("the wrap.") if cell.startswith("`")]
    header, offset = parse(datagram)
    assert bytes.fromhex(" ".join(explained)) == datagram[: offset + 4]
    values = {field: value for _, field, value in table("the wrap.") if field != "body"}
    assert values["seq_number"] == str(header.seq_number)
    assert values["time_sec"] == str(header.time_sec)
    assert values["time_nsec"] == str(header.time_nsec)
    assert values["topic"] == header.topic


def test_every_reason_in_code_is_on_the_page_and_the_other_way_round() -> None:
    on_page = {
        reason.strip() for reasons, _ in table("**Refused**") for reason in reasons.split(",")
    }
    in_code = set()
    for path in SOURCE.rglob("*.py"):
        in_code |= reasons_in(path)
    assert in_code == on_page


def reasons_in(path: Path) -> set[str]:
    """Return the constants that a module hands to `Refused` or `refuse`, with the names' ends."""
    reasons = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        if name not in ("Refused", "refuse"):
            continue
        for constant in ast.walk(node.args[0]):
            if isinstance(constant, ast.Constant):
                text = str(constant.value)
                both = (f"topic{text}", f"link{text}")
                reasons |= set(both) if text.startswith("_") else {text}
    return reasons


@pytest.mark.parametrize(
    ("heading", "size"),
    [
        ("## 5. Subscribe", len(Subscribe(9).pack())),
        ("**Kind 0, Credit**", 12),
        ("**Kind 1, TopicReport**", 128),
        ("**Kind 2, LinkReport**", 40),
        ("**Kind 3, CreditRequest**", 4),
        ("**Kind 4, Barrier**", 24),
        ("Each listed topic takes", 8),
        ("Each expected response takes", 4),
        ("**Kind 5, BarrierReply**", 24),
        ("**Kind 6, RunCommand**", 16),
        ("**Kind 7, RunCommandReply**", 24),
        ("**Kind 8, AddressChallenge**", 16),
        ("**Kind 9, AddressResponse**", 16),
        ("**Kind 10, WorldQuery**", 16),
        ("**Kind 11, WorldReply**", 16),
        ("**The cookie**", 12),
        ("**Kind 0, Offer**", 8),
        ("**Kind 1, Request**", 8),
    ],
)
def test_bodies_have_no_gaps_and_their_declared_size(heading: str, size: int) -> None:
    sizes = {"uint8": 1, "uint16": 2, "uint32": 4, "float32": 4, "uint64": 8, "int64": 8}
    offset = 0
    for at, _, kind, _ in table(heading):
        assert int(at) == offset
        offset += sizes[kind] if kind in sizes else int(kind.split()[0])
    assert offset == size
    assert f"{size} bytes" in PAGE[PAGE.index(heading) :][:200]


@pytest.mark.parametrize(
    ("heading", "kind"),
    [
        ("**Kind 0, Credit**", control.Credit),
        ("**Kind 1, TopicReport**", control.TopicReport),
        ("**Kind 2, LinkReport**", control.LinkReport),
        ("**Kind 3, CreditRequest**", control.CreditRequest),
    ],
)
def test_fields_of_control_stand_in_their_order(heading: str, kind: type[control.Control]) -> None:
    on_page = [field for _, field, _, _ in table(heading) if field not in ("", "kind")]
    in_code = [field.replace("_nanos", "") for field in kind._fields if field != "reasons"]
    assert on_page == [field.replace("bytes_received", "bytes") for field in in_code]


def test_limits_on_the_page_are_those_in_code() -> None:
    limits = Limits()
    for text in (
        f"{limits.memory_bytes >> 20} MiB in all",
        f"{limits.open_per_topic} open messages a topic",
        f"{limits.open_per_sender} open messages a sender",
        f"begin {limits.incomplete_per_s} messages of several parts a second",
        f"{limits.senders} senders, {limits.topics} topics",
        f"{limits.time_limit_nanos // 10**9} s after its first part",
        f"bursts of {flow.DEFAULT_BURST_BYTES:,} bytes".replace(",", " "),
        f"{flow.DEFAULT_RATE_BYTES_PER_S / 1e6:.0f} MB/s",
        f"still for {flow.REQUEST_NANOS // 10**6} ms",
        f"within {flow.FIRST_CREDIT_NANOS // 10**6} ms of the first request",
        f"later within {flow.GIVE_UP_NANOS // 10**9} s",
        f"again after {resend.FIRST_STEP_NANOS // 10**6} ms",
        f"every {resend.LONGEST_STEP_NANOS // 10**6} ms, until",
        f"one part at most every {resend.SMALL_STEP_NANOS // 10**6} ms",
        f"at most {resend.HISTORY_BYTES >> 20} MiB of bodies and {resend.HISTORY_MESSAGES}",
        f"within any {resend.BUDGET_WINDOW_S} s and for",
        f"up to {resend.BURST_BYTES:,}; and in".replace(",", " "),
        f"in any case {resend.MINIMUM_BYTES:,}.".replace(",", " "),
        f"below {nack.MAX_ENTRIES}, the messages from 0 on",
        f"again within {resend.DEBOUNCE_NANOS / 1e6} ms",
        f"the {nack.MAX_ENTRIES} newest such messages",
        f"at most {nack.MAX_TRIES} times",
        f"asks {round_trip.DEBOUNCE_NANOS // 10**6} ms later, or after"
        f" {round_trip.DEBOUNCE_SHARE} of the round trip",
        f"at least {round_trip.SHORTEST_WAIT_NANOS // 10**6} ms more than measured",
        f"{round_trip.FIRST_WAIT_NANOS // 10**6} ms while none was",
        f"then {round_trip.BACK_OFF} times later each time, up to"
        f" {round_trip.LONGEST_BACK_OFF:.0f} times",
        f"up to {limits.open_per_offered_topic} open messages of such a topic",
        f"tries at most {assembly.RECOVERY_ATTEMPTS} times",
        f"ends {address_validation.VALIDATION_NANOS // 10**9} s after the newest",
        f"older than {address_validation.RENEWAL_NANOS // 10**9} s",
        f"At most {address_validation.VALIDATED_MAX} addresses are validated at a time,"
        f" {address_validation.VALIDATED_PER_HOST} of one host",
        f"for {address_validation.COOKIE_NANOS // 10**9} s after `issued`",
        f"UTF-8 of at most {world_queries.TEXT_BYTES:,} bytes".replace(",", " "),
        f"it has at most {world_queries.PACKED_BYTES:,} bytes".replace(",", " "),
    ):
        assert text in re.sub(r"\s+", " ", PAGE), text
