# SPDX-License-Identifier: Apache-2.0
"""Destinations of a Rerun recording: a window, a browser or a file.

Window and web server are a child process, Rerun's own program. Its memory is limited, its priority
is low, and it ends with this process. A file holds one episode; the next one gets another file.
"""

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
"""Memory of the window: about four minutes of a VLP-16; beyond it the oldest data are dropped."""

SERVER_MEMORY = "256MB"
"""Memory of the server for browsers that join later: about 30 s, and all static data."""

WHOLE_MEMORY = "75%"
"""Share of the machine's memory, for files: they are kept completely."""

EVERYWHERE = "0.0.0.0"
"""The address for all interfaces."""

NICENESS = 10
END_SECONDS = 0.7

_BATCHES = rr.ChunkBatcherConfig(flush_tick=1 / 30, flush_num_bytes=1 << 20)
"""Data are sent within a frame."""


class RerunDestination(Protocol):
    """A destination of Rerun recordings."""

    def new_recording(self) -> rr.RecordingStream:
        """Return a new recording with this destination."""

    def alive(self) -> bool:
        """Return whether the destination is still open."""

    def close(self) -> None:
        """End it."""


def _recording() -> rr.RecordingStream:
    recording = rr.RecordingStream(APPLICATION, batcher_config=_BATCHES)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    return recording


class RerunFile:
    """A file that `rerun FILE` opens; further episodes go to FILE-2 and so on."""

    def __init__(self, path: Path, blueprint: rrb.Blueprint) -> None:
        if not path.resolve().parent.is_dir():
            raise UserError(f"--save {path}: no such folder: {path.parent}")
        self._path, self._blueprint = path, blueprint
        self._episodes = 0
        self._recording: rr.RecordingStream | None = None

    def new_recording(self) -> rr.RecordingStream:
        """Return a recording to the next file."""
        self.close()
        self._episodes += 1
        again = f"-{self._episodes}" if self._episodes > 1 else ""
        self._recording = _recording()
        self._recording.save(
            self._path.with_stem(self._path.stem + again), default_blueprint=self._blueprint
        )
        return self._recording

    def alive(self) -> bool:
        """Return True: a file has no window to close."""
        return True

    def close(self) -> None:
        """Write all waiting data and the end of the file."""
        if self._recording is not None:
            self._recording.flush()
            self._recording.disconnect()
            self._recording = None


class ViewerProcess:
    """Rerun's viewer as a child process.

    Parameters
    ----------
    port
        where it receives recordings.
    arguments
        further arguments of its command line.
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
        """Return a recording that the viewer shows."""
        self._recording = _recording()
        self._recording.connect_grpc(self._address, default_blueprint=self._blueprint)
        return self._recording

    def alive(self) -> bool:
        """Return whether the viewer is running; the user may have closed its window."""
        return self._process.poll() is None

    def close(self) -> None:
        """End the viewer."""
        if self._recording is not None and self.alive():
            self._recording.disconnect()  # a stream whose viewer has ended reports errors
            self._recording = None
        self._process.terminate()
        try:
            self._process.wait(END_SECONDS)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def window(blueprint: rrb.Blueprint, port: int, *, whole: bool = False) -> ViewerProcess:
    """Start the viewer in a window; `whole` keeps all data, for a file."""
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
    """Start the viewer for browsers; return it and the address to open.

    Parameters
    ----------
    machine
        host name of this machine, for the address if the viewer listens on all interfaces.
    whole
        keep all data for browsers that join later, for a file.
    """
    arguments = ["--serve-web", "--web-viewer-port", str(web_port)]
    arguments += ["--server-memory-limit", WHOLE_MEMORY if whole else SERVER_MEMORY]
    # Hosts that can load the page can also load the data.
    arguments += ["--cors-allow-origin", f"http://*:{web_port}"]
    name = machine if host == EVERYWHERE else host
    data = quote(f"rerun+http://{name}:{port}/proxy", safe=":/")  # fits a line of a terminal
    return ViewerProcess(blueprint, host, port, arguments), f"http://{name}:{web_port}/?url={data}"


def program() -> Path:
    """Return Rerun's binary. The script of the same name would leave it running when it ends."""
    found = importlib.util.find_spec("rerun_cli")
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).with_name("rerun")


def _as_child() -> None:
    end_with_parent()
    with contextlib.suppress(OSError):
        os.nice(NICENESS)
