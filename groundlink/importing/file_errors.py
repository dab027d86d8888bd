# SPDX-License-Identifier: Apache-2.0
"""Errors and warnings about imported files.

Libraries fail in many ways on broken files; every failure becomes a `BadFile` with one line.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from groundlink.core.errors import RequirementError, UserError

Warn = Callable[[str], None]
"""Receives a warning about a file, one line."""


class BadFile(UserError):
    """An imported file that cannot be used."""


def ignore_warning(line: str) -> None:
    """Discard a warning."""


@contextmanager
def reading(file: Path, kind: str) -> Iterator[None]:
    """Convert any error of a library into one line about `file`, expected to be a `kind`."""
    if file.exists() and not file.is_file():
        raise BadFile(f"{file}: no file, but a folder, a pipe or a device")
    try:
        yield
    except (BadFile, KeyboardInterrupt):
        raise
    except ModuleNotFoundError as error:
        if error.name not in ("PIL", "trimesh"):  # an optional dependency of trimesh
            raise BadFile(f"{file}: not a valid {kind}") from None
        raise RequirementError(
            f"{file}: reading a {kind} needs `{error.name}`. Fix: pip install 'groundlink[physics]'"
        ) from None
    except FileNotFoundError:
        raise BadFile(f"{file}: there is no such file") from None
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadFile(f"{file}: not a whole {kind}: {one_line(reason)}") from None
    except MemoryError:
        raise BadFile(f"{file}: too large for this machine's memory") from None
    except (LookupError, TypeError, AssertionError):
        # The texts of these errors are about the reader, not about the file.
        raise BadFile(f"{file}: not a valid {kind}") from None
    except Exception as error:
        # Libraries raise nearly any error for broken files.
        reason = str(error) or type(error).__name__
        raise BadFile(f"{file}: not a valid {kind}: {one_line(reason)}") from None


def one_line(text: str) -> str:
    """Return text as one line of at most 120 characters."""
    text = " ".join(text.split())
    return text if len(text) <= 120 else f"{text[:117]}..."
