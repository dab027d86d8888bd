# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import importlib.util

import pytest

from groundlink.cli import running
from groundlink.errors import LackingError


@pytest.mark.parametrize("package", ["mcap", "rosbags", "zstandard"])
def test_a_recorder_that_cannot_work_is_told_of_before_the_run(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Physics would wait for it at the first tick, while a real-time run goes on without it."""
    running.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name: None if name == package else find(name)
    )
    with pytest.raises(LackingError, match=rf"`{package}` .*groundlink\[record\]"):
        running.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
