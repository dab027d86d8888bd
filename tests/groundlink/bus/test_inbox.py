# SPDX-License-Identifier: Apache-2.0
import threading

from groundlink.bus.inbox import BusInbox
from groundlink.messages.base import Clock, encode


def clock(tick: int) -> bytes:
    return encode(Clock(tick * 10, 0, tick, 0))


def test_messages_come_out_in_order_with_their_keys() -> None:
    inbox: BusInbox[Clock] = BusInbox(depth=4)
    inbox.put("a", clock(1), Clock)
    inbox.put("b", clock(2), Clock)
    assert inbox.get(seconds=0) == ("a", Clock(10, 0, 1, 0))
    assert inbox.get(seconds=0) == ("b", Clock(20, 0, 2, 0))
    assert inbox.get(seconds=0) is None


def test_the_newest_are_kept_and_the_dropped_are_counted() -> None:
    inbox: BusInbox[Clock] = BusInbox(depth=3)
    inbox.put("b", clock(0), Clock)
    for tick in range(10):
        inbox.put("a", clock(tick), Clock)
    assert len(inbox) == 3
    assert inbox.dropped == 8
    assert inbox.dropped_of == {"a": 7, "b": 1}
    kept = [inbox.get(seconds=0) for _ in range(3)]
    assert [item[1].tick for item in kept if item] == [7, 8, 9]


def test_what_does_not_fit_is_counted_and_passed_over() -> None:
    inbox: BusInbox[Clock] = BusInbox(depth=8)
    inbox.put("bad", b"\xc1", Clock)
    inbox.put("worse", b"", Clock)
    inbox.put("good", clock(5), Clock)
    assert inbox.get(seconds=0) == ("good", Clock(50, 0, 5, 0))
    assert inbox.refused == 2
    assert inbox.last_refusal.startswith("worse: not a Clock")


def test_a_reader_wakes_when_a_message_comes() -> None:
    inbox: BusInbox[Clock] = BusInbox(depth=1)
    threading.Timer(0.05, inbox.put, ("late", clock(1), Clock)).start()
    arrived = inbox.get(seconds=30)
    assert arrived is not None
    assert arrived[0] == "late"


def test_waiting_ends_with_a_message_and_leaves_it_there() -> None:
    inbox: BusInbox[Clock] = BusInbox(depth=4)
    inbox.wait(0.0)
    timer = threading.Timer(0.05, inbox.put, ("a", clock(1), Clock))
    timer.start()
    inbox.wait(60.0)
    inbox.wait(60.0)
    assert len(inbox) == 1
    arrived = inbox.get(seconds=0)
    assert arrived is not None
    assert arrived[0] == "a"
    timer.join()
