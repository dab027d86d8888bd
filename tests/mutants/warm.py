# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.mutants.warm`: for each line of arguments on stdin run pytest in a fork.

Imports what takes long once, and nothing of Groundlink: each fork reads the sources as they are
then. Answers a line each: pytest's exit code, or below 0 the signal that ended it. What pytest
prints is in the file `SAID` of the current folder.
"""

import os
import resource
import sys

import hypothesis.stateful  # noqa: F401
import msgspec  # noqa: F401
import numpy  # noqa: F401
import pytest

SAID = "said.txt"

SECONDS = 240
"""Of processor time; a mutant that loops for ever is noticed."""


def _run(arguments: list[str]) -> int:
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    said = os.open(SAID, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    null = os.open(os.devnull, os.O_RDONLY)
    for file, number in ((null, 0), (said, 1), (said, 2)):
        os.dup2(file, number)
    return int(pytest.main([*arguments, "-W", "ignore::pytest.PytestAssertRewriteWarning"]))


def main() -> None:
    """Serve until stdin ends."""
    for line in sys.stdin:
        child = os.fork()
        if not child:
            code = 1
            try:
                code = _run(line.split())
            finally:
                sys.stdout.flush()
                os._exit(code)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


if __name__ == "__main__":
    main()
