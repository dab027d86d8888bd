# SPDX-License-Identifier: Apache-2.0
"""Result of one part of the benchmark."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from benchmarks.claims import Claim

Row = Mapping[str, Any]
"""A line of a table in `--json`."""


class BenchmarkResult(NamedTuple):
    """Measured rows and the claims that they support."""

    rows: Sequence[Row]
    claims: Sequence[Claim]
