# SPDX-License-Identifier: Apache-2.0
"""Headless rendering of a Rerun recording with Rerun's own viewer and software Vulkan.

The viewer's client is declared experimental and is used only here.
"""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from socket import SOCK_STREAM
from typing import Any

import numpy as np
import pytest
import rerun_cli
from numpy.typing import NDArray
from PIL import Image
from rerun.experimental import ViewerClient

from .rig import free_port, wait_for

VULKAN = Path("/usr/share/vulkan/icd.d")


def need_vulkan() -> None:
    """Go on only where a viewer can draw."""
    if not any(VULKAN.glob("*lvp*.json")):
        pytest.skip("no Vulkan in software: apt-get install mesa-vulkan-drivers; .ci/run does")


class Eyes:
    """One viewer."""

    def __init__(self, client: ViewerClient) -> None:
        self._client = client

    def state(self) -> Any:
        return self._client.get_state()

    def newest_seconds(self) -> float:
        """Return the sim time up to which the recording has come; 0 before it is there."""
        lines = [line for r in self.state().recordings for line in r.timelines]
        return max((line.end or 0 for line in lines), default=0) * 1e-9

    def reports(self) -> list[str]:
        """Return what views complain about."""
        return [f"{v.name}: {r.summary}" for v in self.state().views for r in v.reports]

    def picture(self, view: str | None = None) -> NDArray[np.uint8]:
        """Return what is seen, of one view by its name or of all, shape (height, width, 3)."""
        ids = {v.name: v.view_id for v in self.state().views}
        png = self._client.take_screenshot(ids[view] if view else None)
        with Image.open(BytesIO(png)) as image:
            return np.asarray(image.convert("RGB"))


@contextmanager
def eyes(source: str, folder: Path, size: str = "1280x800") -> Iterator[Eyes]:
    """Open a viewer on a file or on the address of a proxy."""
    port = free_port(SOCK_STREAM)
    program = Path(rerun_cli.__file__).with_name("rerun")
    command = ["nice", str(program), source, "--headless", "--window-size", size]
    environment = os.environ | {"RUST_LOG": "error", "XDG_RUNTIME_DIR": str(folder)}
    with (folder / "rerun.log").open("w") as log:
        process = subprocess.Popen(
            [*command, "--bind", "127.0.0.1", "--port", str(port)],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
    try:
        yield Eyes(wait_for(lambda: _client(port), 90, "the viewer answers"))
    finally:
        process.terminate()
        process.wait(30)


def _client(port: int) -> ViewerClient | None:
    try:
        client = ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
        client.get_state()
    except Exception:  # whatever it is while the viewer starts
        return None
    return client


def share_of(picture: NDArray[np.uint8], color: tuple[int, int, int], tolerance: int) -> float:
    """Return the share of pixels that are near a color."""
    away = np.abs(picture.astype(np.int16) - np.array(color, np.int16)).max(axis=-1)
    return float((away <= tolerance).mean())
