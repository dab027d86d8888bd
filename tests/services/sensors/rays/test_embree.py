# SPDX-License-Identifier: Apache-2.0
"""What a user reads where ray casting cannot work, and memory as Embree wants it."""

import importlib.util
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from groundlink.core.errors import UserError
from services.sensors.rays import embree, engine, kernels
from services.sensors.rays.embree import library


@pytest.fixture(autouse=True)
def _load_anew() -> Iterator[None]:
    """What was loaded before a test, or in it, is not kept."""
    caches = embree.library, kernels.kernels
    for cached in caches:
        cached.cache_clear()
    yield
    for cached in caches:
        cached.cache_clear()


@pytest.mark.parametrize(
    ("load", "module", "advice"),
    [
        (library, "embreex", r"pip install 'groundlink\[sensors\]'"),
        (kernels.kernels, "services.sensors.rays._kernels", "Fix: install gcc or clang"),
    ],
)
def test_a_missing_library_is_one_line_with_advice(
    load: Callable[[], Any], module: str, advice: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == module else real(name)
    )
    with pytest.raises(UserError, match=advice) as caught:
        load()
    assert "\n" not in str(caught.value)


def test_wheel_without_embree_gives_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = SimpleNamespace(origin=str(tmp_path_factory.mktemp("site") / "embreex" / "x.py"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: elsewhere)
    with pytest.raises(embree.EngineUnavailableError, match="no libembree4 in"):
        embree.library()


@pytest.mark.parametrize("supported", [(40000, 40400), (40500, 40600)])
def test_another_version_is_refused(
    supported: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(embree, "SUPPORTED", supported)
    with pytest.raises(embree.EngineUnavailableError, match=r"includes Embree 4\.4\.0, expected"):
        embree.Device()


def test_a_refused_call_is_an_error() -> None:
    device = embree.Device()
    embree.library().rtcNewGeometry(device.handle, 12345)
    with pytest.raises(embree.EngineError, match="Embree reports error"):
        device.check()


@pytest.mark.parametrize("shape", [(1, 3), (11, 3), (7, 5, 16)])
def test_aligned_memory(shape: tuple[int, ...]) -> None:
    array = engine.aligned(shape, np.float32)
    assert array.ctypes.data % 64 == 0
    assert (array.shape, array.dtype) == (shape, np.float32)
    assert array.base is not None
    base = array.base
    while base.base is not None:
        base = base.base
    end = base.ctypes.data + base.nbytes
    assert end - (array.ctypes.data + array.nbytes) >= 16
