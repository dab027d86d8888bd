# SPDX-License-Identifier: Apache-2.0
"""Where a Rerun recording goes: to a window, to a browser, or into a file.

Rule: window and web server are a child process, Rerun's own binary: what it takes of memory is
limited, it yields to the run (niceness), and it ends with this process whatever ends that. A file
holds one life of a run's physics; the next life gets a file of its own.
"""

from __future__ import annotations

import contextlib
import importlib.util
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol
from urllib.parse import quote

import rerun as rr
import rerun.blueprint as rrb

from groundlink.core.errors import UserError
from groundlink.monitor.supervisor import end_with_parent

APPLICATION = "groundlink"

WINDOW_MEMORY = "2GB"
"""What the window keeps: about four minutes of a VLP-16; beyond it the oldest goes."""

SERVER_MEMORY = "256MB"
"""What the server keeps for browsers that join later: about 30 s, and all that stands still."""

WHOLE_MEMORY = "75%"
"""Of the machine's memory, what either may keep of a file: all of it is to be looked at."""

EVERYWHERE = "0.0.0.0"
"""The address that stands for all of a machine's."""

NICENESS = 10
END_SECONDS = 0.7

_BATCHES = rr.ChunkBatcherConfig(flush_tick=1 / 30, flush_num_bytes=1 << 20)
"""A picture is on its way within a frame."""


class RerunDestination(Protocol):
    """Where recordings go."""

    def new_recording(self) -> rr.RecordingStream:
        """Return a recording that goes there."""

    def alive(self) -> bool:
        """Return whether anybody can still look at it."""

    def close(self) -> None:
        """End it."""


def _recording() -> rr.RecordingStream:
    recording = rr.RecordingStream(APPLICATION, batcher_config=_BATCHES)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


class RerunFile:
    """A file that `rerun FILE` opens; FILE-2 and so on for further lives of physics."""

    def __init__(self, path: Path, blueprint: rrb.Blueprint) -> None:
        if not path.resolve().parent.is_dir():
            raise UserError(f"--save {path}: there is no folder {path.parent}")
        self._path, self._blueprint = path, blueprint
        self._lives = 0
        self._recording: rr.RecordingStream | None = None

    def new_recording(self) -> rr.RecordingStream:
        """Return a recording into the next file."""
        self.close()
        self._lives += 1
        again = f"-{self._lives}" if self._lives > 1 else ""
        self._recording = _recording()
        self._recording.save(
            self._path.with_stem(self._path.stem + again), default_blueprint=self._blueprint
        )
        return self._recording

    def alive(self) -> bool:
        """Return that a file is always there."""
        return True

    def close(self) -> None:
        """Write what waits, and the file's end."""
        if self._recording is not None:
            self._recording.flush()
            self._recording.disconnect()
            self._recording = None


class ViewerProcess:
    """Rerun's own program as a child process.

    Parameters
    ----------
    port
        where it takes recordings.
    arguments
        what else it is told.
    """

    def __init__(
        self, blueprint: rrb.Blueprint, host: str, port: int, arguments: Sequence[str]
    ) -> None:
        self._blueprint = blueprint
        here = "127.0.0.1" if host == EVERYWHERE else host
        self._address = f"rerun+http://{here}:{port}/proxy"
        command = [str(program()), "--bind", host, "--port", str(port), *arguments]
        self._process = subprocess.Popen(
            command,
            env={"RUST_LOG": "error"} | os.environ,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            start_new_session=True,
            preexec_fn=_as_child,
        )
        self._recording: rr.RecordingStream | None = None

    def new_recording(self) -> rr.RecordingStream:
        """Return a recording that the viewer shows as soon as it is there."""
        self._recording = _recording()
        self._recording.connect_grpc(self._address, default_blueprint=self._blueprint)
        return self._recording

    def alive(self) -> bool:
        """Return whether the viewer is there; a user may have closed its window."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the viewer."""
        self._process.terminate()
        try:
            self._process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def window(blueprint: rrb.Blueprint, port: int, *, whole: bool = False) -> ViewerProcess:
    """Return the viewer in a window; `whole` keeps all, for a file."""
    limit = WHOLE_MEMORY if whole else WINDOW_MEMORY
    memory = ["--memory-limit", limit, "--server-memory-limit", SERVER_MEMORY]
    return ViewerProcess(
        blueprint, "127.0.0.1", port, [*memory, "--hide-welcome-screen", "--expect-data-soon"]
    )


def web(
    blueprint: rrb.Blueprint,
    host: str,
    port: int,
    web_port: int,
    *,
    machine: str,
    whole: bool = False,
) -> tuple[ViewerProcess, str]:
    """Return the viewer for browsers, and the address to open there.

    Parameters
    ----------
    machine
        what others call this machine; said where the viewer listens on all of its addresses.
    whole
        keep all for browsers that come later, for a file.
    """
    arguments = ["--serve-web", "--web-viewer-port", str(web_port)]
    arguments += ["--server-memory-limit", WHOLE_MEMORY if whole else SERVER_MEMORY]
    # Whoever may load the page may also load the data.
    arguments += ["--cors-allow-origin", f"http://*:{web_port}"]
    name = machine if host == EVERYWHERE else host
    data = quote(f"rerun+http://{name}:{port}/proxy", safe="")
    return ViewerProcess(blueprint, host, port, arguments), f"http://{name}:{web_port}/?url={data}"


def program() -> Path:
    """Return Rerun's binary. The script of the same name would leave it behind when it ends."""
    found = importlib.util.find_spec("rerun_cli")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).with_name("rerun")


def _as_child() -> None:
    end_with_parent()
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
