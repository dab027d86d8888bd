# SPDX-License-Identifier: Apache-2.0
"""What not every machine has. In CI all of it is there, and nothing may be skipped.

`.ci/run` installs it and sets `GROUNDLINK_EVERY_TEST`; elsewhere the test says what it lacks.
"""

from __future__ import annotations

import os
import shutil
from typing import NoReturn

import pytest


def missing(what: str) -> NoReturn:
    """Skip the test, saying what is missing; in CI, fail it."""
    if os.environ.get("GROUNDLINK_EVERY_TEST"):
        pytest.fail(what)
    pytest.skip(what)


def need(program: str) -> None:
    """Go on only where a program is installed."""
    if shutil.which(program) is None:
        missing(f"{program} is not installed: apt-get install {program}; .ci/run does")
