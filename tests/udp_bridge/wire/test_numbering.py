# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge.wire.numbering import NUMBERED_TOPICS, Numbering


def test_numbers_count_by_type_and_topic() -> None:
    numbering = Numbering()
    given = [
        numbering.next(*key) for key in [(1, "/a"), (1, "/a"), (1, "/b"), (2, "/a"), (1, "/a")]
    ]
    assert given == [0, 1, 0, 0, 2]


@pytest.mark.parametrize(("signed_peer", "modulus"), [(False, 2**32), (True, 2**31)])
def test_numbers_wrap(signed_peer: bool, modulus: int) -> None:
    numbering = Numbering(signed_peer=signed_peer)
    numbering.next(1, "/a")
    numbering._next[1, "/a"] = modulus - 1
    assert [numbering.next(1, "/a"), numbering.next(1, "/a")] == [modulus - 1, 0]


def test_numbers_of_more_topics_than_any_peer_knows_are_forgotten() -> None:
    numbering = Numbering()
    numbering.next(1, "/first")
    for index in range(NUMBERED_TOPICS):
        numbering.next(1, str(index))
    assert numbering.next(1, "/first") == 0
    assert numbering.next(1, str(NUMBERED_TOPICS - 1)) == 1
