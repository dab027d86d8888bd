# SPDX-License-Identifier: Apache-2.0
"""Messages pass a pipe unchanged and in order."""

import io

from groundlink.bus.core_topics import CLOCK, Delivery
from groundlink.bus.pipe import PipeBus, PipedMessage, read_piped
from groundlink.messages.base import Clock, encode

KEY = CLOCK.key_in("run")
CLOCKS = [Clock(stamp_nanos=i, epoch_nanos=0, tick=i, episode=0) for i in range(3)]


def written() -> bytes:
    out = io.BytesIO()
    bus = PipeBus(out)
    publish = bus.publisher(KEY, Delivery.ALL)
    assert [publish(clock) for clock in CLOCKS] == [encode(clock) for clock in CLOCKS]
    bus.write("empty", b"")
    bus.close()
    return out.getvalue()


def test_what_is_published_is_read() -> None:
    expected = [PipedMessage(KEY, encode(clock)) for clock in CLOCKS]
    assert [*read_piped(io.BytesIO(written()))] == [*expected, PipedMessage("empty", b"")]


def test_a_message_that_is_cut_off_is_none() -> None:
    whole = written()
    for size in range(len(whole)):
        found = [*read_piped(io.BytesIO(whole[:size]))]
        assert found == [*read_piped(io.BytesIO(whole))][: len(found)]
        assert len(found) < 4


def test_nobody_else_is_there() -> None:
    bus = PipeBus(io.BytesIO())
    bus.answers["key", "part"] = b"answer"
    assert bus.query("key", "part", seconds=1.0) == {"key/0": b"answer"}
    assert bus.query("key", seconds=1.0) == {}
    assert bus.is_connected()
    assert not bus.reconnects()
    assert not bus.present("key", seconds=1.0)
    bus.watch("key", lambda key, present: None)
    bus.serve("key", lambda parameters: [])
    bus.announce("key")()
