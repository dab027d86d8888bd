# SPDX-License-Identifier: Apache-2.0
"""Diagnostics of a node: status rows for its topics and its link, and their publisher.

Levels are those of diagnostic_msgs/DiagnosticStatus:

- STALE: nothing was published, or acknowledged by the peer, for `STALE_NANOS`;
- WARN: since the last round, messages were lost or dropped, or a subscriber missed some, or
  datagrams were refused or dropped by the kernel, or a thread of the link raised an exception; or
  the receive buffer is smaller than `GOOD_BUFFER_BYTES`;
- ERROR: the receiving thread has not responded for 5 s;
- OK: none of these; "not reported" when the peer has never sent a report.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from udp_bridge.io.link import Link
from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.wire.control import NO_AGE, TopicReport
from udp_bridge.wire.types import MSG_TYPES

from .message_class import NotInstalled, message_class

TOPIC = "/diagnostics"
PERIOD_NANOS = 1_000_000_000
OK, WARN, ERROR, STALE = 0, 1, 2, 3
STALE_NANOS = 5_000_000_000
GOOD_BUFFER_BYTES = 4 << 20
"""As the kernel accounts it; half of it may be in flight (PROTOCOL.md, section 8)."""
BUFFER_HINT = "sudo sysctl -w net.core.rmem_max=8388608, then start the node again"


@dataclass(frozen=True)
class StatusRow:
    """A DiagnosticStatus without its hardware_id."""

    level: int
    name: str
    message: str
    values: Mapping[str, str]


@dataclass
class _Last:
    """State of a row in the last round."""

    lost: int = 0
    done: int = -1
    since_nanos: int = 0


class NodeDiagnostics:
    """Makes rounds of status rows; a level is about what happened since the round before."""

    def __init__(self) -> None:
        self._now: Dict[Tuple[str, ...], _Last] = {}
        self._previous: Dict[Tuple[str, ...], _Last] = {}

    def begin(self) -> None:
        """Begin a round; rows that the last round lacked are forgotten."""
        self._now, self._previous = {}, self._now

    def all_of(
        self,
        link: Link,
        now_nanos: int,
        *,
        lost: Callable[[str], Mapping[str, int]] = lambda _: {},
    ) -> List[StatusRow]:
        """Return the rows of a link and all its topics.

        `lost` returns the number of messages of a topic that each subscriber missed.
        """
        self.begin()
        rows = [self.link(link.counters(), link.receive_buffer)]
        arrivals = link.arrivals()
        for (host, port), topic, _, report in arrivals:
            if MSG_TYPES[report.msg_type].ros_type is not None:
                of = lost(topic or MSG_TYPES[report.msg_type].default_topic)
                rows.append(self.arriving(topic, report, f"{host}:{port}", now_nanos, of))
        for host, port in dict.fromkeys(sender for sender, *_ in arrivals):
            found = link.delivery_counts((host, port))
            # A peer that reports one topic reports every topic of which something arrived.
            reported = any(row.report is not None for row in found)
            for row in found:
                if MSG_TYPES[row.msg_type].ros_type is not None:
                    peer = f"{host}:{port}"
                    rows.append(self.outgoing(row, peer, now_nanos, reported=reported))
        return rows

    def arriving(
        self,
        topic: str,
        report: TopicReport,
        sender: str,
        now_nanos: int,
        lost: Mapping[str, int] = MappingProxyType({}),
    ) -> StatusRow:
        """Return the row of a topic that comes from a peer; `lost` is by subscriber."""
        causes = {name: getattr(report, name) for name in _CAUSES}
        causes.update((f"not taken by {name}", count) for name, count in sorted(lost.items()))
        values = {
            "type": MSG_TYPES[report.msg_type].name,
            "peer": sender,
            "direction": "to ROS",
            "sent": str(report.numbers),
            "delivered": str(report.published),
            **{name: str(count) for name, count in causes.items()},
            "waiting": str(report.pending),
            "repaired": str(report.repaired),
            "duplicates": str(report.duplicates),
            "bytes": str(report.body_bytes),
            "age p50 (ms)": _milliseconds(report.age_p50_nanos),
            "age p99 (ms)": _milliseconds(report.age_p99_nanos),
        }
        key = ("to ROS", topic, values["type"], sender)
        return self._row(key, topic, causes, report.published, values, now_nanos)

    def outgoing(
        self, sent: DeliveryCounts, peer: str, now_nanos: int, *, reported: bool = True
    ) -> StatusRow:
        """Return the row of a topic that goes to a peer, which may have reported nothing yet."""
        if not reported:
            sent = sent._replace(missing=0, in_flight=sent.sent)
        causes = {name: getattr(sent, name) for name in _CAUSES}
        report = sent.report
        values = {
            "type": MSG_TYPES[sent.msg_type].name,
            "peer": peer,
            "direction": "from ROS",
            "sent": str(sent.sent),
            "delivered": str(sent.delivered),
            **{name: str(count) for name, count in causes.items()},
            "in flight": str(sent.in_flight),
            "repaired": str(sent.repaired),
            "superseded": str(sent.superseded),
            "bytes": str(sent.delivered_bytes),
            "age p50 (ms)": _milliseconds(report.age_p50_nanos if report else NO_AGE),
            "age p99 (ms)": _milliseconds(report.age_p99_nanos if report else NO_AGE),
        }
        if not reported:
            return StatusRow(OK, sent.topic, "not reported", values)
        key = ("from ROS", sent.topic, values["type"], peer)
        return self._row(key, sent.topic, causes, sent.delivered, values, now_nanos)

    def link(self, counts: Mapping[str, Any], receive_buffer: int) -> StatusRow:
        """Return the row of the node's socket; `counts` are those of `Link.counters`."""
        refused: Dict[str, int] = counts["refused"]
        trouble = {
            "kernel_drops": int(counts["kernel_drops"]),
            "refused": sum(refused.values()),
            "errors": int(counts["errors"]),
        }
        before = self._last(("link",))
        more = sum(trouble.values()) - before.lost
        is_small = receive_buffer < GOOD_BUFFER_BYTES
        values = {
            "receive buffer (bytes)": str(receive_buffer),
            "kernel drops": str(trouble["kernel_drops"]),
            "datagrams": str(counts["received_datagrams"]),
            "bytes": str(counts["received_bytes"]),
            "unreachable": str(counts["unreachable"]),
            "errors": str(trouble["errors"]),
            "refused": str(trouble["refused"]),
            **{f"refused: {reason}": str(count) for reason, count in sorted(refused.items())},
        }
        if is_small:
            values["hint"] = BUFFER_HINT
        self._now["link",] = _Last(lost=sum(trouble.values()))
        problems = []
        if more > 0:
            problems.append(f"{more} datagrams refused, dropped by the kernel, or failed")
        if is_small:
            problems.append(
                f"the receive buffer has only {receive_buffer} bytes. Fix: {BUFFER_HINT}"
            )
        level = WARN if problems else OK
        if counts["deaf"]:
            level = ERROR
            problems.append("the receiving thread does not respond; restart the node")
        return StatusRow(level, "link", "; ".join(problems) or "receiving", values)

    def _row(
        self,
        key: Tuple[str, ...],
        topic: str,
        causes: Mapping[str, int],
        done: int,
        values: Mapping[str, str],
        now_nanos: int,
    ) -> StatusRow:
        before = self._last(key)
        lost = sum(causes.values())
        since = now_nanos if done != before.done else before.since_nanos
        self._now[key] = _Last(lost=lost, done=done, since_nanos=since)
        if now_nanos - since >= STALE_NANOS:
            seconds = (now_nanos - since) / 1e9
            return StatusRow(STALE, topic, f"nothing for {seconds:.0f} s", values)
        if lost > before.lost:
            named = ", ".join(f"{count} {name}" for name, count in causes.items() if count)
            return StatusRow(WARN, topic, f"{lost - before.lost} lost; total: {named}", values)
        return StatusRow(OK, topic, "no losses", values)

    def _last(self, key: Tuple[str, ...]) -> _Last:
        return self._previous.get(key, _Last())


_CAUSES = ("missing", "incomplete", "late", "dropped")


def _milliseconds(age_nanos: int) -> str:
    return "" if age_nanos == NO_AGE else f"{age_nanos / 1e6:.3f}"


class DiagnosticsPublisher:
    """Publishes a link's counters on `TOPIC` once a second, as DiagnosticArray of either ROS.

    The array has one status for each topic and peer, and one for the link.

    Parameters
    ----------
    advertise
        Returns a publisher of `TOPIC`; called with the message class before the first message.
    stamp
        Returns the ROS time as a message.
    level
        Returns a level as a DiagnosticStatus of this ROS holds it.
    warn
        Called with a line for the log.
    lost
        Returns the number of messages of a topic that each subscriber missed.
    """

    def __init__(
        self,
        link: Link,
        *,
        advertise: Callable[[Any], Any],
        stamp: Callable[[], Any],
        level: Callable[[int], Any],
        warn: Callable[[str], object],
        lost: Callable[[str], Mapping[str, int]] = lambda _: {},
    ) -> None:
        self._link, self._lost = link, lost
        self._advertise, self._stamp, self._level, self._warn = advertise, stamp, level, warn
        self._diagnostics = NodeDiagnostics()
        self._due_nanos: Optional[int] = None
        self._publisher: Any = None

    def turn(self, now_nanos: int) -> None:
        """Publish once a second, for the first time one second after the first call."""
        if self._due_nanos is None:
            self._due_nanos = now_nanos + PERIOD_NANOS
        if now_nanos < self._due_nanos:
            return
        self._due_nanos = now_nanos + PERIOD_NANOS
        try:
            array_class, status_class, pair_class = (
                message_class(f"diagnostic_msgs/msg/{name}")
                for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue")
            )
        except NotInstalled:
            self._warn("diagnostic_msgs is not installed: no /diagnostics")
            self._due_nanos = sys.maxsize
            return
        if self._publisher is None:  # created late, so that it does not delay the first data
            self._publisher = self._advertise(array_class)
        host, port = self._link.address
        message = array_class()
        message.header.stamp = self._stamp()
        message.status = [
            status_class(
                level=self._level(row.level),
                name=f"udp_bridge: {row.name}",
                message=row.message,
                hardware_id=f"udp_bridge {host}:{port}",
                values=[pair_class(key=key, value=value) for key, value in row.values.items()],
            )
            for row in self._diagnostics.all_of(self._link, now_nanos, lost=self._lost)
        ]
        self._publisher.publish(message)
