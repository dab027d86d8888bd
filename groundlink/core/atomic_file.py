# SPDX-License-Identifier: Apache-2.0
"""Atomic output: write beside the final name, rename when complete.

An interrupted or killed command, or a full disk, leaves no partial file under the final name.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import UserError, os_error_reason


def check_new_file(option: str, path: Path) -> None:
    """Check that a file does not exist and its folder does.

    Raises
    ------
    UserError
        if the file cannot be created.
    """
    if path.exists():
        raise UserError(f"{option} {path}: file exists. Fix: delete it or choose another name")
    if not path.resolve().parent.is_dir():
        raise UserError(f"{option} {path}: no such folder: {path.parent}")


@contextmanager
def write_atomically(out: Path) -> Iterator[Path]:
    """Yield a temporary path for a file or folder; rename it to `out` at the end.

    Raises
    ------
    UserError
        if the output cannot be written.
    """
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        yield part
        os.replace(part, out)
    except OSError as error:
        raise UserError(f"cannot write {out}: {os_error_reason(error)}") from None
    finally:
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)
