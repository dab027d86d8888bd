# SPDX-License-Identifier: Apache-2.0
"""The bus over real Zenoh: one router, clients, everything on this host's loopback."""

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from groundlink.bus.channel import BusChannel
from groundlink.bus.core_topics import Delivery
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus, BusError
from groundlink.bus.zenoh_config import ROUTER_WAIT_SECONDS
from groundlink.messages.base import POINT, BusMessage, Clock, PointCloud, packed

KEY = "groundlink/test/thing"


def wait_for(condition: Callable[[], object], seconds: float = 10) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def publish_until_heard(
    publish: Callable[[Any], None], message: BusMessage, inbox: BusInbox[Any]
) -> None:
    """Publish a message again and again until the subscription is there."""

    def arrived() -> bool:
        publish(message)
        return len(inbox) > 0

    wait_for(arrived)


def test_messages_reach_every_subscriber_in_order(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox: BusInbox[Clock] = BusInbox(depth=1000)
        receiver.subscribe(KEY, Clock, inbox)
        publish = sender.publisher(KEY, Delivery.ALL)
        publish_until_heard(publish, Clock(0, 0, -1, 0), inbox)
        for tick in range(500):
            publish(Clock(tick, 0, tick, 0))
        ticks = [-1]
        while ticks[-1] != 499:
            message = inbox.get(seconds=10)
            assert message is not None
            assert message[0] == KEY
            ticks.append(message[1].tick)
        assert [tick for tick in ticks if tick >= 0] == list(range(500))


def test_held_messages_wait_for_a_flush_and_keep_their_order(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox: BusInbox[Clock] = BusInbox(depth=1000)
        receiver.subscribe(KEY, Clock, inbox)
        publish = sender.publisher(KEY, Delivery.ALL)
        publish_until_heard(publish, Clock(0, 0, -1, 0), inbox)
        sender.hold()
        for tick in range(50):
            publish(Clock(tick, 0, tick, 0))
        while before := inbox.get(seconds=0.2):
            assert before[1].tick == -1
        sender.flush()
        ticks = [message[1].tick for _ in range(50) if (message := inbox.get(seconds=10))]
        assert ticks == list(range(50))


def test_a_session_that_ends_publishes_what_it_held(endpoint: str) -> None:
    with Bus(connect=endpoint) as receiver:
        inbox: BusInbox[Clock] = BusInbox(depth=1000)
        receiver.subscribe(KEY, Clock, inbox)
        with Bus(connect=endpoint) as sender:
            publish = sender.publisher(KEY, Delivery.ALL)
            publish_until_heard(publish, Clock(0, 0, -1, 0), inbox)
            sender.hold()
            publish(Clock(7, 0, 7, 0))
        ticks: list[int] = []
        while 7 not in ticks:
            message = inbox.get(seconds=10)
            assert message is not None
            ticks.append(message[1].tick)


def filled_channel(sender: Bus, receiver: Bus, *, depth: int, last: int) -> BusChannel[Clock]:
    """Return a channel to which ticks up to the last have been sent."""
    channel = receiver.channel(KEY, Clock, depth=depth)
    publish = sender.publisher(KEY, Delivery.ALL)

    def arrived() -> bool:
        publish(Clock(0, 0, -1, 0))
        return channel.get() is not None

    wait_for(arrived)
    for tick in range(last + 1):
        publish(Clock(tick, 0, tick, 0))
    return channel


def ticks_of(channel: BusChannel[Clock], last: int) -> list[int]:
    """Return what comes in a channel, up to the last tick."""
    ticks: list[int] = []

    def come() -> bool:
        if clock := channel.get():
            ticks.append(clock.tick)
        return ticks[-1:] == [last]

    wait_for(come)
    return [tick for tick in ticks if tick >= 0]


def test_a_channel_has_all_messages_in_order(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        channel = filled_channel(sender, receiver, depth=1000, last=499)
        assert ticks_of(channel, 499) == list(range(500))
        assert channel.get() is None, "nothing has come"
        assert len(channel) == 0


def test_local_messages_come_once_and_in_order_whether_by_the_router_or_not(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox = receiver.local_inbox(depth=10_000)
        receiver.subscribe_local(KEY, Clock, inbox)
        publish = sender.publisher(KEY, Delivery.ALL, local=True)
        publish_until_heard(publish, Clock(0, 0, -1, 0), inbox)
        for tick in range(2000):
            publish(Clock(tick, 0, tick, 0))
            if tick % 100 == 0:
                time.sleep(0.01)
        ticks = [-1]
        while ticks[-1] != 1999:
            message = inbox.get(seconds=10)
            assert message is not None
            ticks.append(message[1].tick)
        assert [tick for tick in ticks if tick >= 0] == list(range(2000))


def test_a_full_channel_drops_the_oldest(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox: BusInbox[Clock] = BusInbox(depth=1000)
        receiver.subscribe(KEY, Clock, inbox)
        channel = filled_channel(sender, receiver, depth=8, last=99)
        while (message := inbox.get(seconds=10)) and message[1].tick != 99:
            pass
        found = ticks_of(channel, 99)
        assert found == list(range(100 - len(found), 100))
        assert len(found) <= 8


def test_a_channel_counts_what_does_not_fit_its_schema(endpoint: str) -> None:
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        channel = filled_channel(sender, receiver, depth=1000, last=0)
        assert ticks_of(channel, 0) == [0]
        sender.publisher_of_bytes(KEY)(b"not a message", b"")
        wait_for(lambda: channel.get() is None and channel.refused)
        assert channel.refused == 1


def test_one_subscription_keeps_the_order_of_all_keys(endpoint: str) -> None:
    """Large and small messages, over keys of their own, as a sensor's readings and its words."""
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox: BusInbox[PointCloud | Clock] = BusInbox(depth=10_000)
        cloud_key, clock_key = "groundlink/test/a/cloud", "groundlink/test/b/clock"
        types = {cloud_key: PointCloud, clock_key: Clock}
        receiver.subscribe_in_order("groundlink/test/**", lambda key: types.get(key), inbox)
        tell = sender.publisher(clock_key, Delivery.ALL)
        show = sender.publisher(cloud_key, Delivery.ALL)
        pass_over = sender.publisher("groundlink/test/c", Delivery.ALL)
        publish_until_heard(tell, Clock(0, 0, -1, 0), inbox)
        for tick in range(300):
            points = np.zeros(1 + tick % 7 * 9_000, POINT)
            show(PointCloud(stamp_nanos=tick, frame="", points=packed(points)))
            pass_over(Clock(0, 0, tick, 0))
            tell(Clock(tick, 0, tick, 0))
        came = []
        while got := inbox.get(seconds=5):
            message = got[1]
            if not isinstance(message, Clock) or message.tick >= 0:
                came.append((message.stamp_nanos, type(message)))
            if came and came[-1] == (299, Clock):
                break
        assert came == [(tick, kind) for tick in range(300) for kind in (PointCloud, Clock)]
        assert inbox.refused == 0


def test_a_large_cloud_arrives_byte_for_byte(endpoint: str) -> None:
    points = np.frombuffer(np.random.default_rng(1).bytes(57_600 * POINT.itemsize), POINT)
    cloud = PointCloud(7, "lidar_link", packed(points))
    with Bus(connect=endpoint) as sender, Bus(connect=endpoint) as receiver:
        inbox: BusInbox[PointCloud] = BusInbox(depth=10)
        receiver.subscribe(KEY, PointCloud, inbox)
        publish = sender.publisher(KEY, Delivery.ALL)
        publish_until_heard(publish, cloud, inbox)
        message = inbox.get(seconds=1)
        assert message is not None
        assert bytes(message[1].points) == points.tobytes()


def test_a_router_waits_for_no_observer(endpoint: str) -> None:
    """An observer that handles no message stops neither the sender nor another receiver."""
    reached, released = threading.Event(), threading.Event()

    def block(_: bytes) -> None:
        reached.set()
        released.wait(30)

    with (
        Bus(connect=endpoint, observer=True) as observer,
        Bus(connect=endpoint) as sender,
        Bus(connect=endpoint) as receiver,
    ):
        inbox: BusInbox[PointCloud] = BusInbox(depth=1000)
        observer.subscribe_bytes(KEY, block)
        receiver.subscribe(KEY, PointCloud, inbox)
        publish = sender.publisher(KEY, Delivery.ALL, bulky=True)
        publish_until_heard(publish, PointCloud(-1, "", packed(np.zeros(1, POINT))), inbox)
        wait_for(reached.is_set)
        begin = time.monotonic()
        for number in range(600):  # more than queues and sockets hold
            publish(PointCloud(number, "", packed(np.zeros(5_000, POINT))))
        newest = -1
        while newest < 599:
            arrived = inbox.get(seconds=10)
            assert arrived is not None
            newest = arrived[1].stamp_nanos
        seconds = time.monotonic() - begin
        released.set()
    assert seconds < ROUTER_WAIT_SECONDS


def test_queries_are_answered_in_order_and_with_parameters(endpoint: str) -> None:
    with Bus(connect=endpoint) as server, Bus(connect=endpoint) as asker:
        server.serve(KEY, lambda words: [f"{i} {words}".encode() for i in range(12)])
        wait_for(lambda: asker.query(KEY, "rover/imu", seconds=2))
        replies = asker.query(KEY, "rover/imu", seconds=2)
        assert list(replies.values()) == [f"{i} rover/imu".encode() for i in range(12)]
        assert asker.query("groundlink/test/nobody", seconds=0.5) == {}


def test_a_long_answer_reaches_a_session_that_also_serves_queries(
    endpoint: str,
) -> None:
    states = [b"%d" % number for number in range(1025)]
    with Bus(connect=endpoint) as answering, Bus(connect=endpoint) as client:
        answering.serve(KEY, lambda _: states)
        client.serve(f"{KEY}/of_its_own", lambda _: [])
        wait_for(lambda: client.query(KEY, seconds=2))  # the router knows of both
        assert list(client.query(KEY, seconds=10).values()) == states


def test_presence_lists_joined_and_departed_processes(endpoint: str) -> None:
    changes: list[tuple[str, bool]] = []
    with Bus(connect=endpoint) as watcher:
        watcher.watch("groundlink/test/health/**", lambda key, there: changes.append((key, there)))
        with Bus(connect=endpoint) as process:
            process.announce("groundlink/test/health/rover/imu")
            wait_for(lambda: ("groundlink/test/health/rover/imu", True) in changes)
            there = {"groundlink/test/health/rover/imu"}
            wait_for(lambda: watcher.present("groundlink/test/health/**", seconds=2) == there)
        wait_for(lambda: ("groundlink/test/health/rover/imu", False) in changes)
        assert watcher.present("groundlink/test/health/**", seconds=2) == set()


@pytest.mark.parametrize("text", ["localhost:7447", "tcp/host", "tcp/host:port", "tcp/ :1"])
def test_invalid_endpoint_is_named(text: str) -> None:
    with pytest.raises(
        BusError, match=r"not an endpoint; expected PROTOCOL/HOST:PORT such as tcp/HOST:7447"
    ):
        Bus(connect=text)


def test_a_port_in_use_is_named(endpoint: str) -> None:
    with pytest.raises(BusError, match=f"{endpoint}: the address is in use"):
        Bus(listen=endpoint)


def test_links_that_had_to_be_made_again_are_counted(endpoint: str) -> None:
    again = endpoint.replace("127.0.0.1", "127.0.0.2")
    router = Bus(listen=again)
    with Bus(connect=again) as bus:
        assert bus.reconnects() == 0
        router.close()
        wait_for(lambda: not bus.is_connected())
        with Bus(listen=again) as router:
            wait_for(lambda: bus.is_connected() and bus.reconnects() == 1)
            assert router.reconnects() == 0
