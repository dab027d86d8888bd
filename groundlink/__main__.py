# SPDX-License-Identifier: Apache-2.0
"""The command `groundlink`: runs a subcommand; errors and interrupts become one line and a code."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

from groundlink.core.errors import UserError, os_error_text

INTERRUPTED = 128 + signal.SIGINT
"""Exit code after Ctrl-C, as shells have it."""

TERMINATED = 128 + signal.SIGTERM


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code.

    2 or 3 after a mistake or a lack that the user can mend, 130 after Ctrl-C. SIGTERM raises
    SystemExit, so that what was begun is cleared away.
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
        # The reader of our output has seen enough. Nothing is flushed to it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _failed(os_error_text(error), UserError.exit_code)


def _failed(line: str, code: int) -> int:
    print(f"groundlink: {line}", file=sys.stderr)
    return code


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM raise SystemExit; commands that run processes take it over."""

    def end(number: int, frame: FrameType | None) -> NoReturn:
        raise SystemExit(TERMINATED)

    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


if __name__ == "__main__":
    sys.exit(main())
