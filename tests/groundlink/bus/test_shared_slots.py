# SPDX-License-Identifier: Apache-2.0
"""Slots of shared memory: messages are read in place, and slots are used again when dropped."""

import os

import numpy as np
import pytest

from groundlink.bus import shared_slots
from groundlink.bus.shared_slots import (
    FEWEST_SLOTS,
    MOST_HELD,
    MOST_SLOTS,
    SlotPool,
    SlotReader,
    SocketFrame,
    room_around,
)

SIZE = 100_000


class Ends:
    """A pool and its reader, with what passes between them."""

    def __init__(self) -> None:
        self.pool, self.reader = SlotPool(), SlotReader()
        self.memfds = 0

    def write(self, content: bytes) -> SocketFrame:
        frame = self.pool.write((b"<", memoryview(content), b">"))
        assert frame is not None, "no slot is free"
        return frame

    def read(self, frame: SocketFrame) -> bytes | memoryview:
        files = [] if frame.file is None else [os.dup(frame.file)]
        self.memfds += len(files)
        payload = self.reader.payload(frame.content, files)
        assert payload is not None
        return payload


@pytest.fixture
def ends() -> Ends:
    return Ends()


def content(number: int, size: int = SIZE) -> bytes:
    return bytes([number]) * size


def test_dropped_messages_make_room_in_the_same_memory(ends: Ends) -> None:
    for number in range(200):
        assert ends.read(ends.write(content(number))) == b"<" + content(number) + b">"
    assert ends.memfds == 1


def test_a_view_of_an_array_keeps_the_message(ends: Ends) -> None:
    payload = ends.read(ends.write(content(1)))
    array = np.frombuffer(payload[10:20], np.uint8)
    del payload
    for number in range(2, 20):
        ends.read(ends.write(content(number)))
    assert array.tolist() == [1] * 10
    assert ends.memfds == 2


def test_a_reader_that_keeps_messages_copies_them(ends: Ends) -> None:
    kept = [ends.read(ends.write(content(number))) for number in range(100)]
    assert [type(each) for each in kept[:MOST_HELD]] == [memoryview] * MOST_HELD
    assert {type(each) for each in kept[MOST_HELD:]} == {bytes}
    assert kept == [b"<" + content(number) + b">" for number in range(100)]
    assert ends.memfds == MOST_HELD + 1


def test_a_larger_message_gets_a_larger_slot(ends: Ends) -> None:
    small = ends.read(ends.write(content(1)))
    assert small[1] == 1
    del small
    large = ends.read(ends.write(content(2, 10 * SIZE)))
    assert large == b"<" + content(2, 10 * SIZE) + b">"
    assert ends.memfds == 2


@pytest.mark.parametrize(("size", "slots"), [(SIZE, MOST_SLOTS), (30_000_000, FEWEST_SLOTS)])
def test_memory_is_bounded(ends: Ends, size: int, slots: int) -> None:
    pages = memoryview(bytes(size))
    frames = [ends.pool.write((pages,)) for _ in range(slots + 1)]
    assert None not in frames[:slots]
    assert frames[slots] is None
    assert ends.read(frames[0] or SocketFrame(b""))[0] == 0  # and dropped
    assert ends.pool.write((pages,)) is not None


def test_a_withdrawn_message_frees_its_slot_and_its_memfd_is_sent_later(ends: Ends) -> None:
    ends.pool.withdraw(ends.write(content(1)))
    ends.pool.withdraw(SocketFrame(b"a small message"))
    assert ends.read(ends.write(content(2)))[1] == 2
    ends.pool.withdraw(ends.write(content(3)))
    assert ends.write(content(4)).file is None


def test_a_message_outlives_its_sender(ends: Ends) -> None:
    payload = ends.read(ends.write(content(1)))
    ends.pool.close()
    assert payload == b"<" + content(1) + b">"


def test_nothing_stays_open(ends: Ends) -> None:
    before = os.listdir("/proc/self/fd")
    kept = [ends.read(ends.write(content(number))) for number in range(5)]
    assert len(os.listdir("/proc/self/fd")) > len(before)
    ends.pool.close()
    del kept, ends.reader
    assert os.listdir("/proc/self/fd") == before


def test_a_slot_that_cannot_be_read_is_no_payload(ends: Ends) -> None:
    frame = ends.write(content(1))
    assert ends.reader.payload(frame.content, []) is None, "without its memfd"
    unsealed = os.memfd_create("unsealed")
    os.ftruncate(unsealed, 10 * SIZE)
    assert ends.reader.payload(frame.content, [unsealed]) is None
    assert frame.file is not None
    far = shared_slots._FRAME.pack(frame.content[0], 0, 4096, 10 * SIZE)
    assert ends.reader.payload(far, [os.dup(frame.file)]) is None


def test_room_around_an_array_is_the_reader_s(ends: Ends) -> None:
    payload = ends.read(ends.write(content(1)))
    room = room_around(np.frombuffer(payload[1:-1], np.uint8))
    assert room is not None
    del payload
    enclosed = room.enclose(b"[a long head ", b"]")
    assert enclosed == b"[a long head " + content(1) + b"]"
    del room
    ends.read(ends.write(content(2)))
    assert enclosed[13] == 1, "the slot was used again too early"


def test_ordinary_arrays_have_no_room_around() -> None:
    array = np.zeros(100, np.uint8)
    for each in (array, array[10:20], np.frombuffer(b"bytes", np.uint8)):
        assert room_around(each) is None
