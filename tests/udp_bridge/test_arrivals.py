# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from udp_bridge import Counters, Message
from udp_bridge.arrivals import AGES_KEPT, TOPICS_REPORTED, Arrivals
from udp_bridge.control import NO_AGE, TopicReport


def imu(stamp_nanos: int, link: str = "imu", topic: str = "/imu") -> Message:
    return Message(2, topic, link, stamp_nanos, 0, b"")


def test_counts_stamps_and_the_median_age() -> None:
    arrivals = Arrivals()
    for stamp, wall in ((1000, 1500), (2000, 2010), (3000, 3100)):
        arrivals.arrived(imu(stamp), wall)
    assert arrivals.reports() == [
        ("/imu", "imu", TopicReport(2, 3, 0, 0, 0, 0, 1000, 3000, 100)),
    ]


def test_ages_are_of_the_messages_since_the_last_report() -> None:
    arrivals = Arrivals()
    arrivals.arrived(imu(1000), 9000)
    arrivals.reports()
    ((_, _, silent),) = arrivals.reports()
    assert (silent.messages, silent.last_stamp_nanos, silent.age_nanos) == (1, 1000, NO_AGE)
    arrivals.arrived(imu(2000), 1990)  # clocks of two machines may disagree
    ((_, _, report),) = arrivals.reports()
    assert (report.messages, report.first_stamp_nanos, report.age_nanos) == (2, 1000, -10)


def test_links_of_a_topic_are_told_apart_and_share_its_losses() -> None:
    arrivals = Arrivals()
    arrivals.arrived(imu(1, "left"), 1)
    arrivals.arrived(imu(2, "right"), 2)
    lost = Counters()
    lost.missing, lost.incomplete, lost.late, lost.duplicates = 4, 3, 2, 1
    reports = arrivals.reports([(2, "/imu", "right", lost)])
    assert [(link, report[1:6]) for _, link, report in reports] == [
        ("left", (1, 4, 3, 2, 1)),
        ("right", (1, 4, 3, 2, 1)),
    ]


def test_a_topic_that_never_became_whole_is_reported() -> None:
    lost = Counters()
    lost.incomplete = 7
    arrivals = Arrivals()
    (row,) = arrivals.reports([(1, "/points", "lidar", lost)])
    assert row == ("/points", "lidar", TopicReport(1, 0, 0, 7, 0, 0, 0, 0, NO_AGE))


def test_memory_is_bounded() -> None:
    arrivals = Arrivals()
    for stamp in range(AGES_KEPT + 1):
        arrivals.arrived(imu(stamp), 2 * stamp)
    ((_, _, report),) = arrivals.reports()
    assert report.messages == AGES_KEPT + 1
    assert report.age_nanos == AGES_KEPT // 2 + 1  # the first one's age is no longer known
    for index in range(TOPICS_REPORTED):
        arrivals.arrived(imu(0, topic=str(index)), 0)
    topics = [topic for topic, _, _ in arrivals.reports()]
    assert len(topics) == TOPICS_REPORTED
    assert "/imu" not in topics
