# SPDX-License-Identifier: Apache-2.0
"""Bodies are published from where they lie, by the function of rcl at an address."""

import ctypes

import pytest

from udp_bridge.io.native import batch_io

PUBLISHER = 0x1234


class _Message(ctypes.Structure):
    _fields_ = (
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", ctypes.c_void_p * 5),
    )


@pytest.mark.skipif(batch_io is None, reason="the C extension was not built")
@pytest.mark.parametrize("body", [b"", b"\x00\x01\x00\x00ab", bytes(100_000), bytearray(b"xyz")])
def test_a_body_is_passed_by_its_address(body: bytes | bytearray) -> None:
    taken = []

    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(_Message), ctypes.c_void_p)
    def publish(publisher: int, message: "ctypes._Pointer[_Message]", more: int | None) -> int:
        found = message.contents
        content = ctypes.string_at(found.buffer, found.length) if found.length else b""
        taken.append((publisher, content, found.capacity, more))
        return 7

    address = ctypes.cast(publish, ctypes.c_void_p).value
    assert batch_io.publish(address, PUBLISHER, memoryview(body)) == 7
    assert taken == [(PUBLISHER, bytes(body), len(body), None)]
    with pytest.raises(TypeError):
        batch_io.publish(address, PUBLISHER, "text")
    with pytest.raises(TypeError):
        batch_io.publish(address, PUBLISHER)
    assert len(taken) == 1
