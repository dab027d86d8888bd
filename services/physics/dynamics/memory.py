# SPDX-License-Identifier: Apache-2.0
"""Inner state of simulated parts as plain numbers, from which an equal part continues."""

from collections.abc import Iterable, Sequence
from typing import Protocol


class PartWithMemory(Protocol):
    """A part of a vehicle whose inner state is some numbers."""

    @property
    def MEMORY(self) -> Sequence[str]:
        """Names of the attributes with these numbers."""


def numbers_of(parts: Iterable[PartWithMemory]) -> tuple[float, ...]:
    """Return the numbers of parts, in their order and in that of `MEMORY`."""
    return tuple(getattr(part, name) for part in parts for name in part.MEMORY)


def set_numbers(parts: Iterable[PartWithMemory], numbers: Sequence[float]) -> None:
    """Set the numbers of parts, as `numbers_of` returned them for parts like these.

    Raises
    ------
    ValueError
        when their count is another one.
    """
    names = [(part, name) for part in parts for name in part.MEMORY]
    for (part, name), number in zip(names, numbers, strict=True):
        setattr(part, name, number)
