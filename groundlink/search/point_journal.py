# SPDX-License-Identifier: Apache-2.0
"""Journal of a search: one line of JSON for each point that was run, appended after its run.

The first line says which search it is. A line that a killed process left incomplete is removed.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Literal

import msgspec

from groundlink.core.errors import UserError

Values = Mapping[str, Any]
"""What identifies a point: values by field, or the columns of a campaign."""

Verdict = Literal["passed", "failed", "broken"]
"""`broken`: the run gave no result, for example because its vehicle has no room to start."""


class PointOutcome(msgspec.Struct, frozen=True):
    """Result of a run and of its check."""

    verdict: Verdict
    text: str
    """Last line of the check, or of the run."""

    objective: float | None = None
    figures: dict[str, float] = {}
    """Key figures of the recording."""


class PointRow(msgspec.Struct, frozen=True):
    """A point with its outcome: a line of the journal."""

    stage: str
    """`scenario`, `search`, `shrink` or `campaign`."""

    number: int
    """Number within the stage, from 1."""

    values: dict[str, Any]
    outcome: PointOutcome


class PointJournal:
    """Journal in a file, with its rows in memory; nobody else can use the file meanwhile.

    Parameters
    ----------
    file
        existing journal, or a new file.
    identity
        options that determine the points and their outcomes, by name.

    Raises
    ------
    UserError
        if the file belongs to other options, or is in use.
    """

    def __init__(self, file: Path, identity: Mapping[str, Any]) -> None:
        self._file = file
        self.determined_by: dict[str, Any] = json.loads(json.dumps(identity))
        self._stream: IO[bytes] = file.open("a+b")
        self._rows: dict[str, PointRow] = {}
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._read(self.determined_by)
        except BlockingIOError:
            self._stream.close()
            raise UserError(f"{file.parent}: in use by another process. Fix: wait for it") from None
        except UserError:
            self._stream.close()
            raise

    @property
    def identity(self) -> str:
        """Text that is the same for the same options."""
        return hashlib.sha256(key(self.determined_by).encode()).hexdigest()[:16]

    @property
    def rows(self) -> list[PointRow]:
        """Rows in the order of their stages and numbers."""
        stages = list(dict.fromkeys(row.stage for row in self._rows.values()))
        return sorted(self._rows.values(), key=lambda row: (stages.index(row.stage), row.number))

    def outcome(self, values: Values) -> PointOutcome | None:
        """Return the outcome of a point, None if it was not run."""
        row = self._rows.get(key(values))
        return row.outcome if row else None

    def add(self, row: PointRow) -> None:
        """Append a row; it is on disk when this returns."""
        self._append(msgspec.to_builtins(row))
        self._rows[key(row.values)] = row

    def discard(self) -> None:
        """Delete the file: what it holds is of no use."""
        self._file.unlink()

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def _read(self, identity: Mapping[str, Any]) -> None:
        """Read the rows of an existing file; write the first line of a new one."""
        self._stream.seek(0)
        lines = self._stream.read().splitlines(keepends=True)
        if lines and not lines[-1].endswith(b"\n"):
            self._stream.truncate(sum(map(len, lines[:-1])))
            del lines[-1]
        if not lines:
            self._append(identity)
            return
        self._check(json.loads(lines[0]), identity)
        for line in lines[1:]:
            row = msgspec.json.decode(line, type=PointRow)
            self._rows[key(row.values)] = row

    def _append(self, content: object) -> None:
        self._stream.write(json.dumps(content).encode() + b"\n")
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def _check(self, found: Mapping[str, Any], own: Mapping[str, Any]) -> None:
        for name, value in own.items():
            if found.get(name) != value:
                raise UserError(
                    f"--out {self._file.parent}: it holds the results of another search: "
                    f"{name} is {found.get(name)}, expected {value}. "
                    "Fix: repeat its command line, or choose another folder"
                )


def key(values: Values) -> str:
    """Return a text that is the same for the same values, whatever their order."""
    return json.dumps(values, sort_keys=True)
