# SPDX-License-Identifier: Apache-2.0
import pytest

from groundlink.messages.base import StreamReport
from services.gateway.reports import PeerReports, peer_counters
from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.wire.control import NO_AGE, LinkReport, TopicReport

NANOS = 10**9


def sent_counts(msg_type: int = 2, topic: str = "/imu", **changes: int) -> DeliveryCounts:
    counts = dict.fromkeys(TopicReport._fields, 0) | {
        "msg_type": msg_type,
        "published": 401,
        "first_stamp_nanos": NANOS,
        "last_stamp_nanos": 2 * NANOS,
        "age_p50_nanos": 3_000_000,
        "age_p99_nanos": 8_000_000,
    }
    report = TopicReport(**(counts | changes))
    return DeliveryCounts(msg_type, topic, 420, 0, 1, 401, 2, 3, 4, 5, 5, 6, 7, report)


def reports(declared: bool = True, follows: bool = True) -> PeerReports:
    return PeerReports({(2, "/imu"): 400.0} if declared else {}, stamps_follow_wall=follows)


def test_declared_topics_have_a_row_before_anything_is_sent() -> None:
    row = StreamReport("/imu", "Imu", 400.0, None, None, 0, 0, reported=False)
    assert reports().streams([]) == [row]


NOTHING_TOLD = {"delivered": 0, "incomplete": 0, "late": 0, "dropped": 0, "repaired": 0}


def test_unreported_topic_is_not_lost() -> None:
    unknown = sent_counts()._replace(report=None, missing=400, in_flight=20, **NOTHING_TOLD)
    (row,) = reports().streams([unknown])
    assert (row.sent, row.measured_hz, row.age_seconds) == (420, None, None)
    assert (row.lost, row.missing, row.in_flight, row.reported) == (0, 0, 420, False)


def test_topic_missing_from_reports_is_lost() -> None:
    silent = sent_counts(2, "/imu")._replace(report=None, missing=400, in_flight=20, **NOTHING_TOLD)
    row, other = reports().streams([silent, sent_counts(1, "/points")])
    assert (row.lost, row.missing, row.in_flight, row.reported) == (400, 400, 20, True)
    assert other.reported
    with_link = reports()
    with_link.link = LinkReport(1, 0, 0, 0, 0)
    assert [one.lost for one in with_link.streams([silent])] == [400]


def test_rates_are_counted_in_stamps() -> None:
    (row,) = reports().streams([sent_counts()])
    assert row.measured_hz == pytest.approx(400.0)
    assert row.age_seconds == pytest.approx(0.003)
    assert row.age_p99_seconds == pytest.approx(0.008)


def test_the_sums_of_a_row_add_up() -> None:
    (row,) = reports().streams([sent_counts()])
    assert row.lost == row.missing + row.incomplete + row.late == 3 + 4 + 5
    assert row.sent == row.messages + row.lost + row.dropped + row.in_flight
    assert (row.superseded, row.repaired, row.delivered_bytes) == (1, 6, 7)


def test_age_is_reported_only_for_wall_clock_stamps() -> None:
    for follows, age, expected in [(False, 5, None), (True, NO_AGE, None), (True, 5, 5e-9)]:
        (row,) = reports(follows=follows).streams([sent_counts(age_p50_nanos=age)])
        assert row.age_seconds == expected


def test_unmeasured_stream_has_no_age() -> None:
    (row,) = reports(declared=False).streams([sent_counts(35, "/tf_static")])
    assert (row.age_seconds, row.age_p99_seconds) == (None, None)


def test_the_bridges_own_messages_have_no_row() -> None:
    own = sent_counts(7, "/cmd_vel")
    assert own.report is not None
    assert reports(declared=False).streams([own], [("/cmd_vel", own.report)]) == []


def test_one_message_has_no_rate() -> None:
    (row,) = reports().streams([sent_counts(published=1, last_stamp_nanos=NANOS)])
    assert row.measured_hz is None


def test_counts_and_age_of_messages_from_ros() -> None:
    counts = {"published": 90, "incomplete": 2, "late": 3, "dropped": 4, "pending": 1}
    report = sent_counts(9, "/cmd_vel", numbers=120, repaired=5, body_bytes=8, **counts).report
    assert report is not None
    (row,) = reports(declared=False, follows=False).streams([], [("/cmd_vel", report)])
    assert (row.topic, row.type, row.direction) == ("/cmd_vel", "Twist", "from ROS")
    assert (row.declared_hz, row.measured_hz, row.age_seconds) == (None, 89.0, 0.003)
    assert (row.missing, row.lost, row.in_flight, row.superseded) == (20, 25, 1, 0)
    assert row.sent == row.messages + row.lost + row.dropped + row.in_flight == 120
    assert (row.repaired, row.delivered_bytes) == (5, 8)


def test_losses_of_the_peers_socket() -> None:
    assert peer_counters(None) == {}
    assert peer_counters(LinkReport(1, 2, 3, 4, 5, (("short", 3), ("link", 1)))) == {
        "peer_refused": 4,
        "peer_refused_short": 3,
        "peer_refused_link": 1,
        "peer_kernel_drops": 5,
    }
