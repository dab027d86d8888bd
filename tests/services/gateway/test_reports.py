# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import pytest

from groundlink.messages import StreamReport
from services.gateway.reports import PeerReports, peer_counters
from udp_bridge.control import NO_AGE, LinkReport, TopicReport


def report(**changes: int) -> TopicReport:
    whole = TopicReport(
        msg_type=2,
        messages=401,
        missing=0,
        incomplete=0,
        late=0,
        duplicates=0,
        first_stamp_nanos=10**9,
        last_stamp_nanos=2 * 10**9,
        age_nanos=3_000_000,
    )
    return whole._replace(**changes)


def test_declared_topics_have_a_row_before_anything_arrives() -> None:
    reports = PeerReports({(2, "/imu"): 400.0}, stamps_follow_wall=True)
    assert reports.streams() == [StreamReport("/imu", "Imu", 400.0, None, None, 0, 0)]


def test_rates_are_counted_in_stamps() -> None:
    reports = PeerReports({(2, "/imu"): 400.0}, stamps_follow_wall=True)
    reports.heard("/imu", report())
    (row,) = reports.streams()
    assert row.measured_hz == pytest.approx(400.0)
    assert row.age_seconds == pytest.approx(0.003)
    assert row.messages == 401


def test_losses_are_gaps_and_incomplete_messages() -> None:
    reports = PeerReports({}, stamps_follow_wall=True)
    reports.heard("/imu", report(missing=3, incomplete=2, late=7, duplicates=9))
    assert reports.streams()[0].lost == 5


def test_an_age_is_told_only_where_stamps_follow_the_wall() -> None:
    for follows, age, expected in [(False, 5, None), (True, NO_AGE, None), (True, 5, 5e-9)]:
        reports = PeerReports({(2, "/imu"): 400.0}, stamps_follow_wall=follows)
        reports.heard("/imu", report(age_nanos=age))
        assert reports.streams()[0].age_seconds == expected


def test_what_is_not_measured_has_no_age() -> None:
    reports = PeerReports({}, stamps_follow_wall=True)
    reports.heard("/tf_static", report(msg_type=35))
    assert reports.streams()[0].age_seconds is None


def test_the_bridges_own_messages_have_no_row() -> None:
    reports = PeerReports({}, stamps_follow_wall=True)
    reports.heard("/cmd_vel", report(msg_type=7))
    assert reports.streams() == []


def test_one_message_has_no_rate() -> None:
    reports = PeerReports({}, stamps_follow_wall=True)
    reports.heard("/imu", report(messages=1, last_stamp_nanos=10**9))
    assert reports.streams()[0].measured_hz is None


def test_what_the_peers_socket_lost() -> None:
    assert peer_counters(None) == {}
    assert peer_counters(LinkReport(1, 2, 3, 4, 5)) == {"peer_refused": 4, "peer_kernel_drops": 5}
