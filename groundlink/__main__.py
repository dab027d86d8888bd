# SPDX-License-Identifier: Apache-2.0
"""The command `groundlink`: run a subcommand; print an error as one line and set the exit code."""

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from groundlink.core.errors import UserError, os_error_text

INTERRUPTED = 128 + signal.SIGINT
"""Exit code after Ctrl-C, by the convention of shells."""

TERMINATED = 128 + signal.SIGTERM


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code.

    2 or 3 after an error that the user can fix, 130 after Ctrl-C. SIGTERM raises SystemExit, so
    that `finally` blocks clean up.
    """
    try:
        with _terminable():
            from .cli.commands import parser

            options = parser().parse_args(arguments)
            code: int = options.command(options)
            sys.stdout.flush()
            return code
    except UserError as error:
        return _failed(str(error), error.exit_code)
    except KeyboardInterrupt:
        return _failed("interrupted", INTERRUPTED)
    except BrokenPipeError:
        # The reader closed the pipe. Redirect stdout so that the flush at exit does not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _failed(os_error_text(error), UserError.exit_code)


def _failed(line: str, code: int) -> int:
    print(f"groundlink: {line}", file=sys.stderr)
    return code


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM raise SystemExit; commands that run processes install their own handlers."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
