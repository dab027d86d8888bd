# SPDX-License-Identifier: Apache-2.0
"""Scenario schema: what a run is made of, as typed data.

May be imported by everything except `core`. Reads no file: `groundlink.loader` does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .schema import Scenario

__all__ = ["Scenario"]


def __getattr__(name: str) -> Any:
    """Import the schema at first use: it needs all sensor kinds, which import this package."""
    if name != "Scenario":
        raise AttributeError(name)
    from .schema import Scenario

    return Scenario
