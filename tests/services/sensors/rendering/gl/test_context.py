# SPDX-License-Identifier: Apache-2.0
"""What a user reads where pictures cannot be drawn."""

import os
import subprocess
import sys

import moderngl
import pytest

from groundlink.core.errors import UserError
from services.sensors.rendering.gl import context

DEBIAN = "libegl1 libegl-mesa0 libgl1 libgl1-mesa-dri"


def test_a_context_draws() -> None:
    opened = context.open_context()
    assert opened.version_code >= 330
    opened.release()


@pytest.mark.parametrize(
    ("cores", "chosen", "threads"), [(2, None, "0"), (3, None, None), (2, "1", "1")]
)
def test_mesa_has_threads_only_where_there_are_cores(
    cores: int, chosen: str | None, threads: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)))
    monkeypatch.setenv("LP_NUM_THREADS", chosen or "")
    if chosen is None:
        monkeypatch.delenv("LP_NUM_THREADS")
    context.open_context().release()
    assert os.environ.get("LP_NUM_THREADS") == threads


def line() -> str:
    with pytest.raises(UserError) as caught:
        context.open_context()
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_without_moderngl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", None)
    assert "pip install 'groundlink[camera]'" in line()


def test_without_egl(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(**_: object) -> None:
        raise Exception("libEGL.so\nnot loaded")

    monkeypatch.setattr(moderngl, "create_context", missing)
    text = line()
    assert DEBIAN in text
    assert "libEGL.so not loaded" in text


@pytest.mark.parametrize(("right", "wrong"), [("0.2, 0.4", "0.0, 0.0"), ("1234.5", "0.0")])
def test_a_driver_that_draws_nothing(
    right: str, wrong: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    fragment = context._FRAGMENT.replace(right, wrong)
    assert fragment != context._FRAGMENT
    monkeypatch.setattr(context, "_FRAGMENT", fragment)
    text = line()
    assert "test triangle" in text
    assert DEBIAN in text


def test_a_process_ends_with_one_line_and_3() -> None:
    broken = (
        "import moderngl, threading\n"
        "def missing(**_): raise Exception('no EGL')\n"
        "moderngl.create_context = missing\n"
        "from groundlink.process import runner\n"
        "from services.sensors.rendering.gl.context import open_context\n"
        "runner.run('sensors.camera', lambda *_: open_context())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", broken], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 3
    assert done.stderr.startswith("sensors.camera: cameras need OpenGL 3.3")
    assert done.stderr.count("\n") == 1
