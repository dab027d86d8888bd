# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.bridge [--quick] [--only PART] [--figure FILE] [--json FILE] [--check]`.

Everything runs on this host over loopback, without privileges. Times depend on the machine, so the
documents claim ratios; the last lines tell which of them hold.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim, Row, add_options, judge

from . import callback, cpp, latency, resending, throughput
from . import contention as crowded
from .processes import drop_privileges

PARTS: dict[str, Callable[[bool, Path], BenchmarkResult]] = {
    "latency": latency.run,
    "callback": callback.run,
    "throughput": throughput.run,
    "cpp": cpp.run,
    "processes": crowded.processes,
    "thread": crowded.thread,
    "resending": resending.run,
}

_LABELS = {
    "UDP Bridge": "UDP Bridge, from send",
    "from the bus": "UDP Bridge, from the sensor's publish on the bus",
    "by a router": "the same by Zenoh and its router, as from another host",
    "C program": "C program, until the message is whole",
    "ROS# way": "ROS# way (rosbridge's calls, read by the leanest server)",
    "rosbridge": "the same calls, read by rosbridge itself",
}


def main(arguments: Sequence[str]) -> int:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bridge")
    parser.add_argument("--quick", action="store_true", help="few messages of fewer sizes")
    parser.add_argument("--only", choices=PARTS, help="measure one part only")
    parser.add_argument(
        "--rosbridge",
        metavar="PROGRAM",
        type=Path,
        help="measure the latency of a real rosbridge beside: its rosbridge_websocket",
    )
    parser.add_argument(
        "--ros-tcp-endpoint",
        metavar="FOLDER",
        type=Path,
        help="measure until a callback by a real ROS-TCP-Endpoint beside: a checkout for ROS 2",
    )
    parser.add_argument("--figure", metavar="FILE", type=Path, help="draw the paper's Figure 9")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the results as JSON")
    add_options(parser)
    options = parser.parse_args(arguments)
    if options.figure is not None and options.only not in (None, "latency"):
        parser.error("--figure draws the part `latency`; leave out --only or name that one")
    drop_privileges()
    began = time.monotonic()
    load, cores = os.getloadavg()[0], os.cpu_count()
    print(f"{cores} cores, load {load:.1f}, Python {sys.version.split()[0]}", flush=True)
    if options.rosbridge is not None and not options.rosbridge.is_file():
        parser.error(f"--rosbridge: there is no file {options.rosbridge}")
    endpoint = options.ros_tcp_endpoint
    if endpoint is not None and not (endpoint / "ros_tcp_endpoint").is_dir():
        parser.error(f"--ros-tcp-endpoint: {endpoint} has no folder ros_tcp_endpoint")
    runs = dict(PARTS)
    runs["latency"] = partial(latency.run, rosbridge=options.rosbridge)
    runs["callback"] = partial(callback.run, rosbridge=options.rosbridge, ros_tcp_endpoint=endpoint)
    parts: dict[str, BenchmarkResult] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in [options.only] if options.only else PARTS:
            parts[name] = runs[name](options.quick, Path(folder))
    claims: list[Claim] = [claim for part in parts.values() for claim in part.claims]
    code = judge(claims, options)
    print(f"\n{time.monotonic() - began:.0f} s")
    if options.json is not None:
        options.json.write_text(json.dumps({n: part.rows for n, part in parts.items()}, indent=1))
    if options.figure is not None:
        draw(options.figure, parts["latency"].rows)
        print(f"drawn to {options.figure}")
    return code


def draw(file: Path, rows: Sequence[Row]) -> None:
    """Write a PNG; `rows` are those of `latency`."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(7, 4.5))
    for name in rows[0]["ms"]:
        megabytes, took = [r["bytes"] / 1e6 for r in rows], [r["ms"][name] for r in rows]
        axes.plot(megabytes, took, "o-", label=_LABELS.get(name, name))
    axes.set(xscale="log", yscale="log", xlabel="message, MB", ylabel="ms until ROS's publish call")
    axes.grid(True, which="major", alpha=0.4)
    axes.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(file, dpi=150)
    pyplot.close(figure)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
