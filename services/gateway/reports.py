# SPDX-License-Identifier: Apache-2.0
"""Delivery reports: for each topic, what arrived at the peer, beside what the scenario declares.

Rates are computed from the stamps of all received messages. Ages are given only where stamps follow
the wall clock. The sums come from `udp_bridge`.
"""

from collections.abc import Iterable, Mapping

from msgspec.structs import replace

from groundlink.core.clock import NANOS
from groundlink.messages.base import StreamReport
from udp_bridge.sender.delivery_counts import DeliveryCounts, received_counts
from udp_bridge.wire.control import NO_AGE, LinkReport, TopicReport
from udp_bridge.wire.types import MSG_TYPES, TYPED

from .subscribers import TopicKey

TO_ROS = "to ROS"
FROM_ROS = "from ROS"


class PeerReports:
    """Builds the rows of the delivery report.

    Parameters
    ----------
    declared_hz
        by wire type and topic, for topics with a declared rate.
    stamps_follow_wall
        whether stamps follow the wall clock, so that ages have a meaning.
    """

    def __init__(
        self, declared_hz: dict[tuple[int, str], float], *, stamps_follow_wall: bool
    ) -> None:
        self._declared_hz = declared_hz
        self._stamps_follow_wall = stamps_follow_wall
        self.link: LinkReport | None = None

    def streams(
        self,
        deliveries: Iterable[DeliveryCounts],
        arrivals: Iterable[tuple[str, TopicReport]] = (),
    ) -> list[StreamReport]:
        """Return a row for every declared topic, in that order, then for the others.

        Parameters
        ----------
        deliveries
            of what was sent to the peer.
        arrivals
            topic and report of what came from it.
        """
        sent = {(row.msg_type, row.topic): row for row in deliveries}
        # A receiver that reports one topic reports all topics of which messages arrived.
        reported = self.link is not None or any(row.report is not None for row in sent.values())
        of_ros = (key for key in sorted(sent) if MSG_TYPES[key[0]].ros_type)
        keys = dict.fromkeys([*self._declared_hz, *of_ros])
        back = [row for row in arrivals if MSG_TYPES[row[1].msg_type].ros_type]
        return [
            *(self._sent(key, sent.get(key), reported=reported) for key in keys),
            *(
                _row(received_counts(topic, report), FROM_ROS, has_ages=True)
                for topic, report in back
            ),
        ]

    def _sent(
        self, key: tuple[int, str], counts: DeliveryCounts | None, *, reported: bool
    ) -> StreamReport:
        msg_type, topic = key
        declared = self._declared_hz.get(key)
        if counts is None:
            name = MSG_TYPES[msg_type].name
            return StreamReport(topic, name, declared, None, None, 0, 0, reported=reported)
        # A topic without a rate repeats old measurements, so its stamps give no age.
        has_ages = self._stamps_follow_wall and declared is not None
        row = _row(counts, TO_ROS, declared, has_ages=has_ages)
        if reported:
            return row
        return replace(row, lost=0, missing=0, in_flight=row.sent, reported=False)


def _row(
    counts: DeliveryCounts, direction: str, declared_hz: float | None = None, *, has_ages: bool
) -> StreamReport:
    report = counts.report
    aged = report if has_ages else None
    return StreamReport(
        counts.topic,
        MSG_TYPES[counts.msg_type].name,
        declared_hz,
        _rate_hz(report),
        _seconds(aged.age_p50_nanos) if aged else None,
        counts.delivered,
        counts.missing + counts.incomplete + counts.late,
        direction,
        age_p99_seconds=_seconds(aged.age_p99_nanos) if aged else None,
        sent=counts.sent,
        missing=counts.missing,
        incomplete=counts.incomplete,
        late=counts.late,
        dropped=counts.dropped,
        in_flight=counts.in_flight,
        repaired=counts.repaired,
        superseded=counts.superseded,
        delivered_bytes=counts.delivered_bytes,
    )


def with_pushed_out(row: StreamReport, pushed_out: Mapping[str, int]) -> StreamReport:
    """Return a row with the messages to ROS, by topic, that were replaced before the link."""
    more = pushed_out.get(row.topic, 0) if row.direction == TO_ROS else 0
    return replace(row, superseded=row.superseded + more) if more else row


def peer_counters(link: LinkReport | None) -> dict[str, int]:
    """Return the counters of datagrams that the peer's socket lost or refused."""
    if link is None:
        return {}
    by_reason = {f"peer_refused_{reason}": count for reason, count in link.reasons}
    return {"peer_refused": link.refused, **by_reason, "peer_kernel_drops": link.kernel_drops}


def _rate_hz(report: TopicReport | None) -> float | None:
    if report is None:
        return None
    span_nanos = report.last_stamp_nanos - report.first_stamp_nanos
    return (report.published - 1) * NANOS / span_nanos if span_nanos > 0 else None


def _seconds(age_nanos: int) -> float | None:
    return None if age_nanos == NO_AGE else age_nanos / NANOS


def with_type(row: StreamReport, typed: Mapping[TopicKey, str]) -> StreamReport:
    """Return a report with the ROS type of a topic whose type has no number on the wire."""
    ros_type = typed.get((TYPED, row.topic), "") if row.type == MSG_TYPES[TYPED].name else ""
    return replace(row, type=ros_type.rpartition("/")[2]) if ros_type else row
