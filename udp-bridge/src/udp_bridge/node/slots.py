# SPDX-License-Identifier: Apache-2.0
"""Reuse of bounded slots: which slot to give back when all are taken and one more is requested.

Idle slots go first, those of unknown senders before others. A known sender may also take slots of
unknown senders, and of a host that holds more than its share. Unknown senders take only idle slots
of unknown senders. So no flood locks out an active sender.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Generic, List, Optional, Sequence, TypeVar

UNKNOWN = ""
"""Host of all unknown senders: their addresses can be forged."""

_Key = TypeVar("_Key")


@dataclass
class Slot(Generic[_Key]):
    """A slot in use."""

    key: _Key
    host: str
    """The owner: a sender's host, or `UNKNOWN`."""
    used_s: float
    """Time of the last use."""


def given_back(
    slots: Sequence[Slot[_Key]], host: str, now_s: float, *, idle_s: float
) -> Optional[Slot[_Key]]:
    """Return the slot that a host may take over, or None.

    Parameters
    ----------
    slots
        All slots in use.
    host
        The host that requests a slot.
    now_s, idle_s
        A slot is idle when it was last used `idle_s` seconds before `now_s` or earlier.
    """
    unknown = [slot for slot in slots if slot.host == UNKNOWN]
    candidates: List[Slot[_Key]] = [slot for slot in unknown if now_s - slot.used_s >= idle_s]
    if host != UNKNOWN:
        idle = [slot for slot in slots if now_s - slot.used_s >= idle_s]
        counts = Counter(slot.host for slot in slots)
        largest, count = counts.most_common(1)[0]
        of_largest = [slot for slot in slots if slot.host == largest]
        is_more = count > counts[host] + 1
        candidates = candidates or unknown or idle or (of_largest if is_more else [])
    return min(candidates, key=lambda slot: slot.used_s, default=None)
