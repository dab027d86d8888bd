# SPDX-License-Identifier: Apache-2.0
"""What the peer says that it received, put beside what the scenario declares.

Rule: rates are counted in stamps, over all that the peer has received. An age only means something
where stamps follow the wall clock.
"""

from __future__ import annotations

from groundlink.clock import NANOS
from groundlink.messages import StreamReport
from udp_bridge.control import NO_AGE, LinkReport, TopicReport
from udp_bridge.types import MSG_TYPES


class PeerReports:
    """The newest reports of the gateway's peer.

    Parameters
    ----------
    declared_hz
        by wire type and topic, for the topics that have a declared rate.
    stamps_follow_wall
        whether an age may be told.
    """

    def __init__(
        self, declared_hz: dict[tuple[int, str], float], *, stamps_follow_wall: bool
    ) -> None:
        self._declared_hz = declared_hz
        self._stamps_follow_wall = stamps_follow_wall
        self._topics: dict[tuple[int, str], TopicReport] = {}
        self.link: LinkReport | None = None

    def heard(self, topic: str, report: TopicReport) -> None:
        """Take note of a report about one topic."""
        self._topics[report.msg_type, topic] = report

    def streams(self) -> list[StreamReport]:
        """Return a row for every declared topic, in that order, then for the others."""
        of_ros = (key for key in sorted(self._topics) if MSG_TYPES[key[0]].ros_type)
        keys = dict.fromkeys([*self._declared_hz, *of_ros])
        return [self._row(key) for key in keys]

    def _row(self, key: tuple[int, str]) -> StreamReport:
        msg_type, topic = key
        ros_type = MSG_TYPES[msg_type].name
        declared = self._declared_hz.get(key)
        report = self._topics.get(key)
        if report is None:
            return StreamReport(topic, ros_type, declared, None, None, 0, 0)
        span_nanos = report.last_stamp_nanos - report.first_stamp_nanos
        measured = (report.messages - 1) * NANOS / span_nanos if span_nanos > 0 else None
        # What has no rate is not measured anew each time, so its stamp says nothing of its age.
        is_measured = declared is not None and report.age_nanos != NO_AGE
        known_age = self._stamps_follow_wall and is_measured
        return StreamReport(
            topic,
            ros_type,
            declared,
            measured,
            report.age_nanos / NANOS if known_age else None,
            report.messages,
            report.missing + report.incomplete,
        )


def peer_counters(link: LinkReport | None) -> dict[str, int]:
    """Return what the peer's socket lost, by name."""
    if link is None:
        return {}
    return {"peer_refused": link.refused, "peer_kernel_drops": link.kernel_drops}
