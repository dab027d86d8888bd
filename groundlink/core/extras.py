# SPDX-License-Identifier: Apache-2.0
"""Optional dependencies: a missing package becomes one line that names the extra to install.

Rule: a command or a process imports what an extra brings inside `needs`, so that everything else
works without that extra.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from .errors import RequirementError

OWN = ("groundlink", "services")
"""Packages of this distribution. If one of them is missing, the installation is broken."""


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Name the extra that brings a package which cannot be imported in this block.

    Raises
    ------
    RequirementError
        when a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in OWN:
            raise
        raise RequirementError(
            f"the Python package `{package}` is not installed. "
            f"Fix: pip install 'groundlink[{extra}]'"
        ) from None


@contextmanager
def process_needs(process: str, extra: str) -> Iterator[None]:
    """Import what a process needs at the top of its module; end it where the extra is missing."""
    try:
        with needs(extra):
            yield
    except RequirementError as error:
        print(f"{process}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
