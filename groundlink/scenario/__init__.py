# SPDX-License-Identifier: Apache-2.0
"""Scenario schema: what a run is made of, as typed data.

May be imported by everything except `core`. Reads no file: `groundlink.loader` does.
"""

from .schema import Scenario

__all__ = ["Scenario"]
