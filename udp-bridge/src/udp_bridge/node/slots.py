# SPDX-License-Identifier: Apache-2.0
"""Which of a bounded number of slots is given back when all are taken and one more is wanted.

Rule: idle slots first, those of unknown senders before others. A known sender also takes from
unknown ones, and from a host that holds more than its share. Unknown senders take idle slots of
unknown ones alone. So nobody who is active is locked out by others, however many they send.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Generic, List, Optional, Sequence, TypeVar

UNKNOWN = ""
"""Stands for the hosts of all senders that are not known: those can be forged."""

_Key = TypeVar("_Key")


@dataclass
class Slot(Generic[_Key]):
    """A slot that is taken."""

    key: _Key
    host: str
    """Whose it is: a sender's host, or `UNKNOWN`."""
    used_s: float
    """When it was used last."""


def given_back(
    slots: Sequence[Slot[_Key]], host: str, now_s: float, *, idle_s: float
) -> Optional[Slot[_Key]]:
    """Return the slot to give to a host, or None where it gets none.

    Parameters
    ----------
    slots
        All that are taken.
    host
        Who wants one.
    now_s, idle_s
        A slot is idle when it was not used for `idle_s` seconds before `now_s`.
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
