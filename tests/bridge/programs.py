# SPDX-License-Identifier: Apache-2.0
"""Optional programs; `.ci/run` installs them."""

import shutil

import pytest


def need(program: str) -> None:
    """Skip the test if a program is not installed."""
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed: apt-get install {program}; .ci/run does")
