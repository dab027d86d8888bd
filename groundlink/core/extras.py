# SPDX-License-Identifier: Apache-2.0
"""Optional dependencies: a missing package becomes one error line that names the extra to install.

Commands and processes import optional packages inside `needs`; the rest works without them.
"""

import importlib.util
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from .errors import RequirementError

OWN = ("groundlink", "services")
"""Packages of this distribution. If one is missing, the installation is broken."""


@contextmanager
def needs(extra: str) -> Iterator[None]:
    """Turn a failed import in this block into an error that names the extra.

    Raises
    ------
    RequirementError
        if a package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package in OWN:
            raise
        raise _missing(package, extra) from None


def check_installed(packages: Iterable[str], extra: str) -> None:
    """Check that packages of an extra are installed, without importing them.

    Raises
    ------
    RequirementError
        if one is not.
    """
    for package in packages:
        if importlib.util.find_spec(package) is None:
            raise _missing(package, extra)


@contextmanager
def process_needs(process: str, extra: str) -> Iterator[None]:
    """Guard the imports at the top of a process's module; exit if the extra is missing."""
    try:
        with needs(extra):
            yield
    except RequirementError as error:
        print(f"{process}: {error}", file=sys.stderr)
        sys.exit(error.exit_code)


def _missing(package: str, extra: str) -> RequirementError:
    return RequirementError(
        f"the Python package `{package}` is not installed. Fix: pip install 'groundlink[{extra}]'"
    )
