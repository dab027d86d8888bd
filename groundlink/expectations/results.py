# SPDX-License-Identifier: Apache-2.0
"""Verdict on an expectation."""

from collections.abc import Iterable
from typing import Any, Literal

import msgspec

Verdict = Literal["passed", "failed", "undecided"]

PASSED: Verdict = "passed"
FAILED: Verdict = "failed"
UNDECIDED: Verdict = "undecided"


class ExpectationResult(msgspec.Struct, frozen=True, kw_only=True):
    """Verdict on an expectation, with the figure that decided it."""

    name: str
    kind: str
    verdict: Verdict
    """Undecided: the run was too short, or what is judged was not measured."""

    value: float | None
    """The measured figure: of a place, the least distance; of a limit, the largest value, or the
    first one beyond the limit; none: nothing was measured."""

    limit: float | None
    """None: what the expectation is about is not in the run."""

    unit: str
    at_s: float | None
    """Sim time of the value; none: of the whole run, or there is no value."""

    text: str
    """One line: what happened, when, and what was expected."""

    skipped: bool = False
    """Whether it cannot be decided in a run of this kind, which is no problem of the run."""

    @property
    def is_problem(self) -> bool:
        """Whether a run with this result fails: what was not decided has not passed."""
        return self.verdict != PASSED and not self.skipped

    @property
    def cells(self) -> tuple[str, str, str, str, str]:
        """Name, verdict, value, limit and text as texts, for tables."""
        verdict = "skipped" if self.skipped else self.verdict
        figures = ((self.value, ".3g"), (self.limit, ".6g"))
        value, limit = (
            "-" if x is None else f"{round(x, 6) + 0.0:{form}} {self.unit}" for x, form in figures
        )
        return self.name, verdict, value, limit, self.text

    @property
    def line(self) -> str:
        """The result as one line, for lists of what failed."""
        undecided = "undecided, " if self.verdict == UNDECIDED else ""
        return f"{self.name}: {undecided}{self.text}"

    def to_builtins(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        plain: dict[str, Any] = msgspec.to_builtins(self)
        return plain


COLUMNS = ("expectation", "verdict", "value", "limit", "what happened")
"""Titles of `ExpectationResult.cells`."""


def problems(results: Iterable[ExpectationResult]) -> list[str]:
    """Return the results with which a run fails as lines."""
    return [result.line for result in results if result.is_problem]
