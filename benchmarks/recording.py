# SPDX-License-Identifier: Apache-2.0
"""Cost of recording: processor time compared with the LiDAR's, and of a commit after an hour.

Processor time is that of the kernel's accounting; that of a commit is the thread's clock.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from groundlink.recording.mcap_file import McapFile

SCENARIO = Path(__file__).resolve().parents[1] / "scenarios" / "indoor_lab.yaml"
ENDPOINT = "tcp/127.0.0.1:7448"

SECONDS = 10.0
"""Measured time of the run, after `START_SECONDS`."""

START_SECONDS = 6.0

HOUR_CHUNKS = 18_000
"""Chunks of an hour of the default scenario: two with each commit."""

CHANNELS = 12


def main() -> None:
    """Print both."""
    with tempfile.TemporaryDirectory() as folder:
        _beside_the_lidar(Path(folder))
        _after_an_hour(Path(folder))


def _beside_the_lidar(folder: Path) -> None:
    out = folder / "run.mcap"
    record = subprocess.Popen(
        [
            *(sys.executable, "-m", "groundlink", "record", str(SCENARIO), "--realtime"),
            *("--out", str(out), "--duration", str(START_SECONDS + SECONDS + 2)),
            *("--listen", ENDPOINT),
        ],
        stdout=subprocess.DEVNULL,
    )
    time.sleep(START_SECONDS)
    processes = _children_of(record.pid)
    begin = {pid: processor_seconds(pid) for pid in processes}
    size = out.stat().st_size
    time.sleep(SECONDS)
    took = {name: processor_seconds(pid) - begin[pid] for pid, name in processes.items()}
    per_minute = (out.stat().st_size - size) * 60 / SECONDS / 1e6
    record.wait()
    for name, seconds in sorted(took.items()):
        print(f"{name:32} {100 * seconds / SECONDS:5.1f} % of a core")
    ratio = took["services.recorder"] / took["services.sensors.lidar"]
    print(f"recorder / lidar {ratio:.2f}; the file grows by {per_minute:.0f} MB a minute")


def _after_an_hour(folder: Path) -> None:
    file = McapFile(folder / "hour.mcap", profile="ros2", library="benchmark")
    schema = file.add_schema("pkg/msg/Type", "ros2msg", b"")
    channels = [file.add_channel(f"/{i}", schema, "cdr", {}) for i in range(CHANNELS)]
    for number in range(HOUR_CHUNKS):
        for channel in channels:
            file.write(channel, number, number, b"body")
        file.close_chunk()
    file.commit("topics", {})
    begin = time.thread_time()
    for channel in channels:
        file.write(channel, HOUR_CHUNKS, 0, b"body")
    file.commit("topics", {})
    seconds = time.thread_time() - begin
    file.close()
    print(f"a commit after {HOUR_CHUNKS} chunks: {1e3 * seconds:.1f} ms")


def _children_of(pid: int) -> dict[int, str]:
    """Return the modules that a process has started, by process id."""
    found = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                stat = (entry / "stat").read_text(encoding="utf-8", errors="replace")
                words = (entry / "cmdline").read_bytes().decode().split("\0")
            except OSError:
                continue
            if int(stat.rpartition(")")[2].split()[1]) == pid and "-m" in words:
                found[int(entry.name)] = words[words.index("-m") + 1]
    return found


def processor_seconds(pid: int) -> float:
    """Return the processor time that a process has taken, of all its threads."""
    stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
