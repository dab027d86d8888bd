# SPDX-License-Identifier: Apache-2.0
"""Others' code that says whether ours is right; the extra `dev` installs it."""

from __future__ import annotations

import importlib
import os
from typing import Any

import pytest


def module(name: str) -> Any:
    """Return a module; where it is not installed the test is skipped, but fails in CI."""
    if os.environ.get("GROUNDLINK_EVERY_TEST"):
        return importlib.import_module(name)
    return pytest.importorskip(name, reason=f"`{name}` is not installed; the extra `dev` has it")
