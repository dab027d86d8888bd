# SPDX-License-Identifier: Apache-2.0
"""Cost of a fleet on 1 to 4 emulated hosts: `unshare --net python -m benchmarks.scale.namespaces`.

Each host is a network namespace; the first is this program's own. It has router, physics, gateway
and ROS node, the others have the sensors of an equal share of the rovers. All share the processors
of this machine, so only processor time and bytes on the cables mean something. Needs root.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from benchmarks import run
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.overrides import add_argument, forwarded
from groundlink.monitor.process_commands import joining, sensor_processes
from groundlink.monitor.supervisor import end_with_parent

from .__main__ import by_role, total
from .fleet import driven, fleet

PORT = 7447
HOLD = "mount -t tmpfs none /dev/shm && echo && exec sleep infinity"
"""With the same /dev/shm Zenoh would pass large messages beside the cable."""


def start(*words: str, quiet: bool = True) -> subprocess.Popen[bytes]:
    """Start a program that ends with this one."""
    output = subprocess.DEVNULL if quiet else None
    return subprocess.Popen(
        words, stdin=subprocess.DEVNULL, stdout=output, stderr=output, preexec_fn=end_with_parent
    )


def end(processes: Sequence[subprocess.Popen[bytes]]) -> None:
    """End programs, the last one first."""
    for process in reversed(processes):
        process.kill()
        process.wait()


def ip(*words: str) -> None:
    """Run `ip`.

    Raises
    ------
    CalledProcessError
        when it fails.
    """
    subprocess.run(["ip", *words], check=True, timeout=10)


@contextmanager
def host(number: int) -> Iterator[Sequence[str]]:
    """Make a host with the address 10.88.0.<number>; yield the words that run a command on it."""
    anchor = subprocess.Popen(
        [*"unshare --net --mount sh -c".split(), HOLD],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        preexec_fn=end_with_parent,
    )
    try:
        assert anchor.stdout is not None
        with anchor.stdout as said:
            if not said.readline():
                raise UserError("cannot make a network namespace. Fix: run this as root")
        there = (
            "nsenter",
            f"--target={anchor.pid}",
            "--net",
            "--mount",
            f"--wd={Path.cwd()}",
            "--",
        )
        name, peer = f"cable{number}", str(anchor.pid)
        ip("link", "add", name, "type", "veth", "peer", "name", "eth0", "netns", peer)
        ip("link", "set", name, "master", "switch", "up")
        for words in (
            f"address add 10.88.0.{number}/24 dev eth0",
            "link set eth0 up",
            "link set lo up",
        ):
            subprocess.run([*there, "ip", *words.split()], check=True, timeout=10)
        yield there
    finally:
        anchor.kill()
        anchor.wait()


def cable_bytes() -> int:
    """Return the bytes that all cables have carried so far, both ways."""
    lines = Path("/proc/net/dev").read_text(encoding="utf-8").splitlines()
    columns = [line.replace(":", " ").split() for line in lines if "cable" in line]
    return sum(int(one[1]) + int(one[9]) for one in columns)


def measured(rovers: int, hosts: int, seconds: float, more: Sequence[str]) -> dict[str, Any]:
    """Return the processor time by role and the bytes on the cables for a second of sim time."""
    with ExitStack() as opened:
        file = fleet(Path(opened.enter_context(tempfile.TemporaryDirectory())), rovers)
        scenario = load(str(file))
        there = [opened.enter_context(host(number)) for number in range(2, hosts + 1)]
        here = f"tcp/127.0.0.1:{PORT}"
        python = (sys.executable, "-m")
        started = [start(*python, "services.router", "--listen", f"tcp/0.0.0.0:{PORT}")]
        opened.callback(end, started)
        bus = opened.enter_context(run.joined(here, time.monotonic() + 20))
        for service in ("services.physics", "services.gateway", "udp_bridge_ros2"):
            words = {"services.physics": [str(file), *more]}.get(service, [])
            joined = ["--bind", scenario.gateway.peer, "--peer", scenario.gateway.bind]
            if service != "udp_bridge_ros2":
                joined = joining(run.RUN, here)
            started.append(start(*python, service, *words, *joined))
        names = scenario.sensor_names()
        places = (
            [((), here)] if hosts == 1 else [(words, f"tcp/10.88.0.1:{PORT}") for words in there]
        )
        for place, (through, endpoint) in enumerate(places):
            own = [
                name
                for name in names
                if int(name.partition("/")[0][1:]) * len(places) // rovers == place
            ]
            # One process of each kind on a host, as with one core.
            for command in sensor_processes(scenario, own, cores=1).values():
                words = [sys.executable, *command, *joining(run.RUN, endpoint)]
                started.append(start(*through, *words))
        reports = run.HealthReports(bus)
        with driven(bus, run.RUN, rovers):
            deadline = time.monotonic() + run.START_SECONDS
            while not reports.everything_arrives:
                reports.update(0.2)
                if time.monotonic() > deadline:
                    raise RuntimeError("not everything arrives in ROS")
            reports.update(run.SETTLE_SECONDS)
            carried, begun = cable_bytes(), time.monotonic()
            found = run.costs([process.pid for process in started], reports, seconds)
            rate = (cable_bytes() - carried) / (time.monotonic() - begun)
    row = by_role(rovers, found)
    return row | {"hosts": hosts, "cable_bytes": rate / found["real_time_factor"]}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.scale.namespaces", description=__doc__)
    parser.add_argument("--rovers", type=int, default=8)
    parser.add_argument("--hosts", default="1,2,3,4", metavar="H,H", help="(%(default)s)")
    parser.add_argument("--seconds", type=float, default=10.0, help="wall time of each")
    add_argument(parser)
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the figures")
    options = parser.parse_args()
    ip("link", "set", "lo", "up")
    ip("link", "add", "switch", "type", "bridge")
    ip("address", "add", "10.88.0.1/24", "dev", "switch")
    ip("link", "set", "switch", "up")
    rows = []
    for hosts in map(int, options.hosts.split(",")):
        row = measured(options.rovers, hosts, options.seconds, forwarded(options))
        rows.append(row)
        shares = ", ".join(f"{role} {100 * cores:.0f} %" for role, cores in row["cores"].items())
        print(
            f"{hosts} hosts: {shares}; all {100 * total(row):.0f} %; cables "
            f"{row['cable_bytes'] / 1e6:.2f} MB/s; factor {row['real_time_factor']:.3f}; left out "
            f"{row['left_out']}",
            flush=True,
        )
    if options.out:
        options.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
