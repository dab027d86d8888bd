# SPDX-License-Identifier: Apache-2.0
"""The errors that a user is meant to read.

Rule: the text is one line: what is wrong, where, what was expected, how to mend it. Whoever runs a
command prints it and exits with its code; nobody else catches it.
"""

from __future__ import annotations

import difflib
import errno
from collections.abc import Collection, Iterable
from typing import ClassVar

TOO_MANY_FILES = (errno.EMFILE, errno.ENFILE)


class UserError(Exception):
    """Something that the user can mend."""

    exit_code: ClassVar[int] = 2


class RequirementError(UserError):
    """Something that a process needs and this machine lacks; others may go on without it."""

    exit_code: ClassVar[int] = 3


class RunFailed(UserError):
    """A run could not be what its scenario asks for, and the scenario has it end then."""

    exit_code: ClassVar[int] = 4


def os_error_text(error: OSError) -> str:
    """Return what the operating system refused: where, the reason, and a fix where one is known."""
    if error.errno in TOO_MANY_FILES or error.filename is None:
        return os_error_reason(error)
    return f"{error.filename}: {os_error_reason(error)}"


def os_error_reason(error: OSError) -> str:
    """Return why the operating system refused something, without where."""
    told = (error.strerror or str(error) or type(error).__name__).lower()
    return (
        f"{told}. Fix: raise the limit, ulimit -n 1024" if error.errno in TOO_MANY_FILES else told
    )


def nearest(word: str, known: Iterable[str], missing: Collection[str] = ()) -> str:
    """Return a hint that names the known word closest to `word`, the only missing one, or all."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if close:
        return f"did you mean `{close[0]}`?"
    if len(missing) == 1:
        return f"did you mean `{next(iter(missing))}`, which is missing?"
    return f"expected one of {', '.join(known)}"
