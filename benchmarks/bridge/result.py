# SPDX-License-Identifier: Apache-2.0
"""What a part of the benchmark gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from benchmarks.claims import Claim

Row = Mapping[str, Any]
"""A line of a table, for machines."""


class Part(NamedTuple):
    """What a part of the benchmark found."""

    rows: Sequence[Row]
    claims: Sequence[Claim]
