# SPDX-License-Identifier: Apache-2.0
"""What all tests share: plugins, an asset store, and no deadline for generated examples."""

import gc
from collections.abc import Iterator

import hypothesis
import pytest

from groundlink.world.assets import VARIABLE

pytest_plugins = ["tests.strict_skips", "tests.machine_load", "tests.reruns"]

# An example that takes long on a busy machine is not a wrong one.
hypothesis.settings.register_profile("groundlink", deadline=None)
hypothesis.settings.load_profile("groundlink")

LONGEST = (
    "tests/test_wheels.py",
    "tests/test_house.py",
    "tests/bridge/test_fuzz.py",
    "tests/udp_bridge/cpp/",
    "tests/udp_bridge/test_conversations.py",
    "tests/udp_bridge/test_soak.py",
    # More than 20 s each, the longest first.
    "tests/system/test_determinism.py",
    "tests/ros1/test_paper_scenarios.py",
    "tests/system/test_verify.py",
    "tests/system/test_installed.py",
    "tests/system/test_overload.py",
    "tests/system/test_lockstep_ros.py",
    "tests/system/test_secure.py",
    "tests/system/test_view.py",
    "tests/system/test_ros_control.py",
    "tests/system/test_foreign_sensor.py",
    "tests/system/test_three_hosts.py",
    "tests/system/test_search.py",
    "tests/system/test_ros_graph.py",
    "tests/docs/test_tutorials.py",
    "tests/system/test_save.py",
    "tests/system/test_recording.py",
    "tests/system/test_replay.py",
    "tests/system/test_both_ways.py",
    "tests/system/test_mistakes.py",
    "tests/system/test_faults.py",
    "tests/system/test_camera.py",
    "tests/system/test_driver.py",
)
"""Begun first, in this order, so that at the end no worker is left alone with one of them."""


def _rank(item: pytest.Item) -> int:
    return next((i for i, file in enumerate(LONGEST) if item.nodeid.startswith(file)), len(LONGEST))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=_rank)


def pytest_collection_finish() -> None:
    """Spare the garbage collector what was collected: it stays to the end."""
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, str(tmp_path_factory.mktemp("assets")))
        yield
