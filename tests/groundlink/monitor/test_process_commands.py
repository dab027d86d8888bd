# SPDX-License-Identifier: Apache-2.0
import importlib.util

import pytest

from groundlink.core.errors import RequirementError
from groundlink.monitor import process_commands


@pytest.mark.parametrize("package", ["mcap", "rosbags", "zstandard"])
def test_unusable_recorder_is_reported_before_the_run(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Physics would wait for it at the first tick, while a real-time run goes on without it."""
    process_commands.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name: None if name == package else find(name)
    )
    with pytest.raises(RequirementError, match=rf"`{package}` .*groundlink\[record\]"):
        process_commands.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
