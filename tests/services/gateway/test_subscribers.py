# SPDX-License-Identifier: Apache-2.0
import pytest

from services.gateway.subscribers import IDLE_SECONDS, MAX_RECEIVERS, Subscribers
from udp_bridge.wire.control import Subscribe

IMU = (2, "/imu")
CLOUD = (1, "/points")
PEER = ("127.0.0.1", 1)
OTHER = ("127.0.0.1", 2)


@pytest.fixture
def subscriptions() -> Subscribers:
    return Subscribers(frozenset({IMU, CLOUD}))


def test_a_pushed_topic_goes_to_the_peer_for_ever(subscriptions: Subscribers) -> None:
    subscriptions.push(IMU, PEER)
    assert subscriptions.receivers(IMU, 0, 1e9) == [PEER]
    assert subscriptions.receivers(CLOUD, 0, 1e9) == []


def test_a_subscriber_is_added_and_its_lease_ends(subscriptions: Subscribers) -> None:
    subscriptions.push(IMU, PEER)
    assert subscriptions.request(OTHER, "/imu", Subscribe(2, lease_s=3), 100.0)
    assert subscriptions.receivers(IMU, 0, 102.9) == [PEER, OTHER]
    assert subscriptions.receivers(IMU, 1, 103.1) == [PEER]


def test_a_renewed_lease_counts_from_its_renewal(subscriptions: Subscribers) -> None:
    subscriptions.request(OTHER, "/imu", Subscribe(2, lease_s=3), 100.0)
    subscriptions.request(OTHER, "/imu", Subscribe(2, lease_s=3), 102.0)
    assert subscriptions.receivers(IMU, 0, 104.9) == [OTHER]
    assert subscriptions.receivers(IMU, 0, 105.1) == []


@pytest.mark.parametrize("max_rate_hz", [0.0, 1.0])
def test_no_lease_holds_until_unsubscribed(subscriptions: Subscribers, max_rate_hz: float) -> None:
    assert subscriptions.request(OTHER, "/imu", Subscribe(2, max_rate_hz=max_rate_hz), 0.0)
    assert subscriptions.receivers(IMU, 0, 1e6) == [OTHER]
    assert subscriptions.request(OTHER, "/imu", Subscribe(2, action=0), 1e6)
    assert subscriptions.receivers(IMU, 10**12, 1e6) == []


def test_the_last_subscribe_of_an_unlimited_subscription_counts(subscriptions: Subscribers) -> None:
    subscriptions.request(OTHER, "/imu", Subscribe(2), 0.0)
    subscriptions.request(OTHER, "/imu", Subscribe(2, max_rate_hz=5.0, lease_s=3), 0.0)
    sent = [bool(subscriptions.receivers(IMU, i * 10**7, 0.0)) for i in range(100)]
    assert sum(sent) == 5  # of 100 in a second
    assert subscriptions.receivers(IMU, 10**10, 3.1) == []


def test_the_peers_push_cannot_be_unsubscribed_or_throttled(subscriptions: Subscribers) -> None:
    subscriptions.push(IMU, PEER)
    subscriptions.request(PEER, "/imu", Subscribe(2, action=0), 0.0)
    subscriptions.request(PEER, "/imu", Subscribe(2, max_rate_hz=1.0, lease_s=1), 0.0)
    assert subscriptions.receivers(IMU, 0, 100.0) == [PEER]
    assert subscriptions.receivers(IMU, 1, 100.0) == [PEER]


def test_unknown_topic_is_refused(subscriptions: Subscribers) -> None:
    assert not subscriptions.request(OTHER, "/nothing", Subscribe(2), 0.0)
    assert not subscriptions.request(OTHER, "/imu", Subscribe(1), 0.0)


def test_subscribers_are_bounded_and_idle_ones_give_their_places_back(
    subscriptions: Subscribers,
) -> None:
    def asks(port: int, now_seconds: float, action: int = 1) -> bool:
        request = Subscribe(2, action)
        return subscriptions.request(("10.0.0.1", port), "/imu", request, now_seconds)

    subscriptions.push(IMU, PEER)
    assert all(asks(port, 0.0) for port in range(MAX_RECEIVERS))
    assert not asks(99, 1.0)
    assert asks(0, IDLE_SECONDS / 2)
    assert asks(99, IDLE_SECONDS)
    assert len(subscriptions.receivers(IMU, 0, IDLE_SECONDS)) == 1 + MAX_RECEIVERS
    assert ("10.0.0.1", 1) not in subscriptions.receivers(IMU, 1, IDLE_SECONDS)
    assert asks(0, IDLE_SECONDS, action=0)
    assert asks(1, IDLE_SECONDS)
    assert PEER in subscriptions.receivers(IMU, 2, IDLE_SECONDS)


@pytest.mark.parametrize(
    ("stream_hz", "wanted_hz", "expected"),
    [(400, 100, 100), (10, 3, 3), (50, 50, 50), (10, 20, 10)],
)
def test_a_rate_limit_is_counted_in_stamps(
    subscriptions: Subscribers, stream_hz: int, wanted_hz: float, expected: int
) -> None:
    subscriptions.request(OTHER, "/imu", Subscribe(2, max_rate_hz=wanted_hz), 0.0)
    passed = sum(
        bool(subscriptions.receivers(IMU, i * 10**9 // stream_hz, 0.0))
        for i in range(10 * stream_hz)
    )
    assert passed == pytest.approx(10 * expected, abs=1)


def test_a_rate_limit_survives_time_that_jumps_back(subscriptions: Subscribers) -> None:
    subscriptions.request(OTHER, "/imu", Subscribe(2, max_rate_hz=1.0), 0.0)
    assert subscriptions.receivers(IMU, 500 * 10**9, 0.0) == [OTHER]
    assert subscriptions.receivers(IMU, 10**9, 0.0) == [OTHER]
    assert subscriptions.receivers(IMU, 10**9 + 1, 0.0) == []
