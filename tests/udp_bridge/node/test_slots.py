# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge.node.slots import UNKNOWN, Slot, given_back

NOW, IDLE = 100.0, 10.0
A, B = "192.0.2.1", "192.0.2.2"


def slots(*rows: tuple[str, float]) -> list[Slot[int]]:
    return [Slot(key, host, used_s) for key, (host, used_s) in enumerate(rows)]


@pytest.mark.parametrize(
    ("held", "host", "key"),
    [
        # Idle ones of unknown senders go first, the oldest of them.
        ([(A, 1.0), (UNKNOWN, 5.0), (UNKNOWN, 4.0)], A, 2),
        ([(A, 1.0), (UNKNOWN, 5.0), (UNKNOWN, 4.0)], UNKNOWN, 2),
        # Unknown senders take nothing else.
        ([(A, 1.0), (UNKNOWN, 95.0)], UNKNOWN, None),
        ([(A, 1.0)] * 3, UNKNOWN, None),
        # A known one takes active ones of unknown senders, then idle ones of anybody.
        ([(A, 1.0), (UNKNOWN, 99.0)], A, 1),
        ([(A, 1.0), (A, 2.0)], A, 0),
        ([(A, 1.0), (A, 2.0)], B, 0),
        # Of active hosts, one with more than its share gives way to another one.
        ([(A, 95.0), (A, 94.0), (B, 93.0)], B, None),
        ([(A, 95.0), (A, 94.0), (A, 96.0), (B, 93.0)], B, 1),
        ([(A, 95.0), (A, 94.0)], B, 1),
        ([(A, 95.0), (A, 94.0)], A, None),
    ],
)
def test_which_is_given_back(held: list[tuple[str, float]], host: str, key: int | None) -> None:
    slot = given_back(slots(*held), host, NOW, idle_s=IDLE)
    assert (slot.key if slot else None) == key
