# SPDX-License-Identifier: Apache-2.0
"""Errors that a user reads, each as one line: where, the problem, what was expected, the fix.

The entry point of a command or process prints the line and exits with the error's code. No other
code catches these errors.
"""

import difflib
import errno
from collections.abc import Collection, Iterable
from typing import ClassVar

TOO_MANY_FILES = (errno.EMFILE, errno.ENFILE)


class UserError(Exception):
    """A problem that the user can fix."""

    exit_code: ClassVar[int] = 2


class RequirementError(UserError):
    """The machine lacks something that a process needs. Other processes may continue."""

    exit_code: ClassVar[int] = 3


class RunFailed(UserError):
    """The run was aborted because its scenario says so, as by `overload: fail`."""

    exit_code: ClassVar[int] = 4


class DeafSession(UserError):
    """The session is connected, but its router sends nothing to it.

    A session that has lost its link connects again under the same id. If the router is still
    closing the old link then, which it does when several hosts are cut off one after the other,
    Zenoh (1.10) may keep the new link and send to the old one: the session stays connected, what it
    publishes arrives, and nothing comes to it. Only a new session ends this.
    """


def os_error_text(error: OSError) -> str:
    """Return the file name and the reason of an operating system error, with a fix if known."""
    if error.errno in TOO_MANY_FILES or error.filename is None:
        return os_error_reason(error)
    return f"{error.filename}: {os_error_reason(error)}"


def os_error_reason(error: OSError) -> str:
    """Return the reason of an operating system error, without the file name."""
    text = (error.strerror or str(error) or type(error).__name__).lower()
    return (
        f"{text}. Fix: raise the limit, ulimit -n 1024" if error.errno in TOO_MANY_FILES else text
    )


def did_you_mean(word: str, known: Iterable[str], missing: Collection[str] = ()) -> str:
    """Return a hint that names the known word closest to `word`, the only missing one, or all."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if close:
        return f"did you mean `{close[0]}`?"
    if len(missing) == 1:
        return f"did you mean `{next(iter(missing))}`, which is missing?"
    return f"expected one of {', '.join(known)}"
