# SPDX-License-Identifier: Apache-2.0
"""Tests of pictures need OpenGL; where there is none they are skipped, but fail in CI."""

from functools import cache

import pytest

from groundlink.core.errors import UserError
from services.sensors.rendering.gl.context import open_context


@cache
def _lacking() -> str:
    try:
        open_context().release()
    except UserError as error:
        return str(error)
    return ""


@pytest.fixture(autouse=True)
def _opengl() -> None:
    if _lacking():
        pytest.skip(_lacking())
