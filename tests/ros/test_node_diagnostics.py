# SPDX-License-Identifier: Apache-2.0
"""The levels of /diagnostics and what is said with them."""

from typing import Any

import pytest

from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.wire.control import NO_AGE, TopicReport

pytest.importorskip("rclpy", reason="no ROS 2 here")
from udp_bridge.node.diagnostics import (
    BUFFER_HINT,
    ERROR,
    GOOD_BUFFER_BYTES,
    OK,
    STALE,
    STALE_NANOS,
    WARN,
    NodeDiagnostics,
    StatusRow,
)

COUNTS: dict[str, Any] = {
    "kernel_drops": 0,
    "errors": 0,
    "deaf": 0,
    "refused": {},
    "received_datagrams": 10,
    "received_bytes": 1000,
    "unreachable": 0,
}


def arriving(verdicts: NodeDiagnostics, now_nanos: int = 0, **changes: int) -> StatusRow:
    counts = dict.fromkeys(TopicReport._fields, 0) | {"msg_type": 2, "age_p50_nanos": 1_500_000}
    verdicts.begin()
    return verdicts.arriving("/imu", TopicReport(**(counts | changes)), "a:1", now_nanos)


def test_a_loss_is_warned_of_once_and_named() -> None:
    verdicts = NodeDiagnostics()
    assert arriving(verdicts, numbers=5, published=5).level == OK
    lost = arriving(verdicts, numbers=10, published=6, incomplete=1, late=1, dropped=1)
    assert (lost.level, lost.message) == (
        WARN,
        "4 lost; total: 1 missing, 1 incomplete, 1 late, 1 dropped",
    )
    assert arriving(verdicts, numbers=11, published=7, incomplete=1, late=1, dropped=1).level == OK


def test_a_subscriber_that_does_not_take_its_messages_is_named() -> None:
    verdicts = NodeDiagnostics()
    report = TopicReport(**(dict.fromkeys(TopicReport._fields, 0) | {"msg_type": 2, "numbers": 9}))

    def said(lost: dict[str, int]) -> StatusRow:
        verdicts.begin()
        return verdicts.arriving("/imu", report._replace(published=9), "a:1", 0, lost)

    assert said({}).level == OK
    warned = said({"/slow": 3})
    assert (warned.level, warned.message) == (WARN, "3 lost; total: 3 not taken by /slow")
    assert (warned.values["not taken by /slow"], warned.values["delivered"]) == ("3", "9")
    assert said({"/slow": 3}).level == OK
    assert said({}).level == OK, "it has gone"


def test_a_silent_topic_is_stale() -> None:
    verdicts = NodeDiagnostics()
    arriving(verdicts, 7, numbers=5, published=5)
    assert arriving(verdicts, 6 + STALE_NANOS, numbers=5, published=5).level == OK
    assert arriving(verdicts, 7 + STALE_NANOS, numbers=5, published=5).level == STALE
    assert arriving(verdicts, 8 + STALE_NANOS, numbers=6, published=6).level == OK


def test_the_values_of_a_topic_add_up() -> None:
    values = arriving(
        NodeDiagnostics(), numbers=30, published=9, dropped=2, incomplete=3, late=4, pending=5
    ).values
    parts = ("delivered", "missing", "incomplete", "late", "dropped", "waiting")
    assert int(values["sent"]) == sum(int(values[part]) for part in parts) == 30
    assert values["missing"] == "7"
    assert values["age p50 (ms)"] == "1.500"


def test_a_topic_that_leaves() -> None:
    sent = DeliveryCounts(9, "/cmd_vel", 10, 480, 2, 5, 1, 1, 1, 1, 1, 0, 240, None)
    verdict = NodeDiagnostics().outgoing(sent, "a:1", 0)
    parts = ("delivered", "missing", "incomplete", "late", "dropped", "in flight")
    assert int(verdict.values["sent"]) == sum(int(verdict.values[part]) for part in parts)
    assert (verdict.level, verdict.values["age p99 (ms)"]) == (WARN, "")
    assert NO_AGE < 0


class SilentPeer:
    """A link to a peer of which Clock comes, and that reports of the topics given alone."""

    receive_buffer = GOOD_BUFFER_BYTES

    def __init__(self, *reported: str) -> None:
        self._reported = reported

    def counters(self) -> dict[str, Any]:
        return COUNTS

    def arrivals(self) -> list[Any]:
        return [(("a", 1), "/clock", "", report_of(8))]

    def delivery_counts(self, _: Any) -> list[DeliveryCounts]:
        return [
            DeliveryCounts(
                kind, topic, 10, 0, 0, 0, 0, 0, 0, 9, 1, 0, 0, report_of(kind) if told else None
            )
            for kind, topic in ((9, "/cmd_vel"), (10, "/pose"))
            for told in [topic in self._reported]
        ]


def report_of(kind: int) -> TopicReport:
    return TopicReport(**dict.fromkeys(TopicReport._fields, 0) | {"msg_type": kind})


def outgoing(*reported: str) -> dict[str, tuple[int, str, str, str]]:
    judged = NodeDiagnostics().all_of(SilentPeer(*reported), 0)  # type: ignore[arg-type]
    return {
        row.name: (row.level, row.message, row.values["missing"], row.values["in flight"])
        for row in judged
        if row.values.get("direction") == "from ROS"
    }


def test_what_a_peer_never_reports_is_not_lost() -> None:
    unknown = OK, "not reported", "0", "10"
    assert outgoing() == {"/cmd_vel": unknown, "/pose": unknown}
    lost = WARN, "9 lost; total: 9 missing", "9", "1"
    assert outgoing("/pose") == {"/cmd_vel": lost, "/pose": lost}


def test_link_status_warns_of_drops_and_refusals_with_reasons() -> None:
    verdicts = NodeDiagnostics()

    def link(**changes: Any) -> StatusRow:
        verdicts.begin()
        return verdicts.link(COUNTS | changes, GOOD_BUFFER_BYTES)

    assert link().level == OK
    bad = link(kernel_drops=3, refused={"short": 2})
    assert (bad.level, bad.message) == (
        WARN,
        "5 datagrams refused, dropped by the kernel, or failed",
    )
    assert bad.values["refused: short"] == "2"
    assert link(kernel_drops=3, refused={"short": 2}).level == OK
    assert link(kernel_drops=3, refused={"short": 2}, errors=1).level == WARN
    assert link(deaf=1).level == ERROR


def test_a_small_receive_buffer_is_warned_of_with_how_to_raise_it() -> None:
    verdict = NodeDiagnostics().link(COUNTS, GOOD_BUFFER_BYTES - 1)
    assert verdict.level == WARN
    assert verdict.values["hint"] == BUFFER_HINT
    assert BUFFER_HINT in verdict.message
