# SPDX-License-Identifier: Apache-2.0
import io

import pytest

from udp_bridge.wire.capture import BadRecording, datagrams

TWO = b"\x03\0\0\0abc" + b"\0\0\0\0"


def test_datagrams_in_order_empty_ones_too() -> None:
    assert list(datagrams(io.BytesIO(TWO))) == [b"abc", b""]
    assert list(datagrams(io.BytesIO(b""))) == []


@pytest.mark.parametrize(
    ("end", "text"),
    [
        (b"\x05\0\0", "truncated length prefix at offset 11: 3 of 4 bytes"),
        (b"\x05\0\0\0abcd", "truncated datagram at offset 15: 4 of 5 bytes"),
        (b"\xe4\xff\0\0", "the length prefix at offset 11 says 65508 bytes;.*at most 65507"),
    ],
)
def test_where_it_is_broken_is_said_after_what_was_whole(end: bytes, text: str) -> None:
    recording = datagrams(io.BytesIO(TWO + end))
    assert [next(recording), next(recording)] == [b"abc", b""]
    with pytest.raises(BadRecording, match=text):
        next(recording)
