# SPDX-License-Identifier: Apache-2.0
"""Fuzz whole conversations by coverage: senders, a lossy network, restarts and forgers.

`python -m fuzz.sequences [--seconds S] [--runs N] [--corpus DIR]` searches for a sequence of events
that breaks an invariant of `conversation` or raises (atheris; Linux on x86-64). The bytes of an
input choose the events: messages, transfers with loss, duplicates and reordering, restarts with a
changed clock, pauses, and forged datagrams of every type. A failing input is written to `crash-*`;
`python -m fuzz.sequences crash-...` repeats it.
"""

import random
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["udp_bridge"]):
    from udp_bridge import MSG_TYPES

    from .conversation import HONEST, SENDERS, Conversation, Forgery

from .guided import fuzz

LARGEST_INPUT = 2048
SEEDS = 50
_TYPES = sorted(MSG_TYPES)
_TOPICS = ("/p", "/p", "/p", "", "/q")
_BODIES = {
    64: b"\0\1\2\3\4\5\6\7",
    65: b"\0\0\0\1",
}
"""First byte of a forged body by type: the valid kinds."""


def converse(data: bytes) -> None:
    """Run the events of an input."""
    choose = atheris.FuzzedDataProvider(data)
    conversation = Conversation()

    def upto(most: int) -> int:
        return int(choose.ConsumeIntInRange(0, most))

    while choose.remaining_bytes():
        event = upto(5)
        if event == 0:
            conversation.send(upto(SENDERS - 1), upto(1 << 16))
        elif event in (1, 2):
            conversation.transfer(upto(SENDERS - 1), list(choose.ConsumeBytes(upto(40))))
        elif event == 3:
            conversation.restart(upto(SENDERS - 1), upto(5))
        elif event == 4:
            conversation.wait(upto(255) ** 2 // 16)
        else:
            msg_type = _TYPES[upto(len(_TYPES) - 1)] if upto(1) else 1 + 64 * upto(1)
            parts_max = 1 + upto(254) if msg_type < 64 else 1
            kinds = _BODIES.get(msg_type, b"")
            kind = kinds[upto(len(kinds) - 1) :][:1] if kinds else b""
            conversation.forge(
                Forgery(
                    *(HONEST + 1 + upto(SENDERS - 2), msg_type),
                    number=(0, -1, -2, 1, 300, 1 << 30)[upto(5)],
                    seconds=(0, 0, -1, 1, 1 << 31)[upto(4)],
                    part_number=upto(254),
                    parts_max=parts_max,
                    topic=_TOPICS[upto(len(_TOPICS) - 1)],
                    body=kind + bytes(choose.ConsumeBytes(upto(48))),
                )
            )
    conversation.end()


def seeds(folder: Path) -> None:
    """Write some random inputs, long enough for many events."""
    rng = random.Random(0)
    for index in range(SEEDS):
        (folder / str(index)).write_bytes(rng.randbytes(rng.randint(64, LARGEST_INPUT)))


if __name__ == "__main__":
    sys.exit(fuzz("fuzz.sequences", converse, LARGEST_INPUT, seeds))
