# SPDX-License-Identifier: Apache-2.0
"""Performance claim: a measured value and the documented limit.

A claim is a ratio or a count, never a time: those depend on the machine.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

Row = Mapping[str, Any]
"""A line of a table of measurements."""


class Claim(NamedTuple):
    """A figure with its limit."""

    what: str
    value: float
    limit: float
    is_at_least: bool = True

    @property
    def holds(self) -> bool:
        """Whether the figure keeps to its limit."""
        return self.value >= self.limit if self.is_at_least else self.value <= self.limit

    @property
    def limit_text(self) -> str:
        """What is claimed, in words."""
        return f"at {'least' if self.is_at_least else 'most'} {self.limit:g}"

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "DOES NOT HOLD"
        return f"{verdict:13} {self.what}: {self.value:.2f}, claimed {self.limit_text}"


class BenchmarkResult(NamedTuple):
    """Measured rows and the claims that they support."""

    rows: Sequence[Row]
    claims: Sequence[Claim]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that every benchmark with claims has."""
    parser.add_argument("--check", action="store_true", help="fail where a claim does not hold")
    parser.add_argument("--claims", metavar="FILE", type=Path, help="write the claims, as JSON")


def judge(claims: Sequence[Claim], options: argparse.Namespace) -> int:
    """Print the claims and write them where asked; return the exit code."""
    print("", *claims, sep="\n")
    if options.claims is not None:
        rows = [claim._asdict() for claim in claims]
        options.claims.write_text(json.dumps(rows), encoding="utf-8")
    return int(options.check and not all(claim.holds for claim in claims))
