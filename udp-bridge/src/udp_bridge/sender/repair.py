# SPDX-License-Identifier: Apache-2.0
"""How lost datagrams of a topic are made good: the sender's choice, topic by topic.

One table says it, and a topic that is not in it is not repaired. What the modes do is in `fec`
and `resend` (sending), `fec_parts` and `resend_asking` (receiving).
"""

from __future__ import annotations

import math
from typing import Dict, Mapping, NamedTuple, Optional, Union

from udp_bridge.wire import fec
from udp_bridge.wire.header import NANOS, BadMessage
from udp_bridge.wire.message import TopicKey

DEFAULT_LIMIT_S = 0.5
"""Six rounds of 20 ms with their waiting times, three times over."""
LONGEST_LIMIT_S = 60.0


class Fec(NamedTuple):
    """Repair data go out with every message, and the receiver computes what is lost."""

    share: float
    """Repair symbols for each part of the message, above 0 and at most 1; rounded up."""


class Resend(NamedTuple):
    """The receiver asks for what is lost, and the sender sends it again."""

    limit_nanos: int
    """A message is stale, and neither asked for nor sent, when this old."""


Mode = Union[Fec, Resend]
RepairTable = Mapping[TopicKey, Mode]


def parse_mode(mode: object) -> Optional[Mode]:
    """Return the mode that a user wrote: `none`, `resend`, or a dict with one key.

    Parameters
    ----------
    mode
        `"none"`, `"resend"`, `{"resend": limit in seconds}` or `{"fec": share}`.

    Raises
    ------
    BadMessage
        When it is none of these.
    """
    if mode is None or mode == "none":
        return None
    if mode == "resend":
        return Resend(int(DEFAULT_LIMIT_S * NANOS))
    if isinstance(mode, dict) and len(mode) == 1:
        ((name, value),) = mode.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            if name == "fec" and 0 < value <= 1:
                return Fec(float(value))
            if name == "resend" and 0.001 <= value <= LONGEST_LIMIT_S:
                return Resend(math.ceil(value * NANOS))
    raise BadMessage(
        f"repair {mode!r} is neither none, resend, {{resend: seconds up to"
        f" {LONGEST_LIMIT_S:.0f}}} nor {{fec: share above 0 and up to 1}}"
    )


def check_table(table: Optional[RepairTable]) -> RepairTable:
    """Return a copy of a table that can be kept to here.

    Raises
    ------
    BadMessage
        When it holds `Fec` and the library for it is not installed.
    """
    copy: Dict[TopicKey, Mode] = dict(table or {})
    if not fec.is_available():
        for (_, topic), mode in copy.items():
            if isinstance(mode, Fec):
                raise BadMessage(
                    f"repair of {topic!r} by fec needs the package raptorq:"
                    " install udp-bridge[fec], or choose resend or none"
                )
    return copy
