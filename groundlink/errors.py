# SPDX-License-Identifier: Apache-2.0
"""The errors that a user is meant to read.

Rule: the text is one line: what is wrong, where, what was expected, how to mend it. Whoever runs a
command prints it and exits with its code; nobody else catches it.
"""

from __future__ import annotations

from typing import ClassVar


class UserError(Exception):
    """Something that the user can mend."""

    exit_code: ClassVar[int] = 2


class LackingError(UserError):
    """Something that a process needs and this machine lacks; others may go on without it."""

    exit_code: ClassVar[int] = 3


class RunFailed(UserError):
    """A run could not be what its scenario asks for, and the scenario has it end then."""

    exit_code: ClassVar[int] = 4
