# SPDX-License-Identifier: Apache-2.0
"""Cost of 1 to 32 rovers on this machine: `python -m benchmarks.scale`.

Each rover has a planar scanner at 10 Hz, an inertial unit at 400 Hz and encoders at 50 Hz, and
drives in circles by commands on the bus. `groundlink up` runs each fleet with gateway and ROS node.
What a machine cannot do slows sim time down, as the factor shows. Figures are processor time for a
second of sim time, in percent of one core. On a busy machine a slow run (`--set time.factor=0.25`)
leaves each process room; `--set time.mode=fast` measures the work without the sleeps.
"""

import argparse
import json
import math
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks import run
from groundlink.loader.overrides import add_argument, forwarded

from .fleet import MOST, driven, fleet

ROLES = ("physics", "imu", "scanner", "gateway", "udp_bridge_ros2", "router")
"""A word in the name of each process. Encoders share the processes of inertial units; the router
runs in the process of `groundlink up`."""


def role_of(process: str) -> str:
    """Return the role of a process."""
    process = process.replace("groundlink", "router")
    return next(role for role in ROLES if role in process)


def measured(rovers: int, seconds: float, more: list[str]) -> dict[str, Any]:
    """Run a fleet on this machine and measure it; see `by_role`."""
    with tempfile.TemporaryDirectory() as folder:
        file = fleet(Path(folder), rovers)
        return by_role(
            rovers,
            run.measure(
                *(file, seconds, more), lambda bus: driven(bus, run.RUN, rovers), ages=False
            ),
        )


def by_role(rovers: int, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a measurement of `benchmarks.run` with sums over the processes of each role."""
    cores: defaultdict[str, float] = defaultdict(float)
    switches: defaultdict[str, float] = defaultdict(float)
    processes: Counter[str] = Counter()
    for name, figures in found["processes"].items():
        role = role_of(name)
        cores[role] += figures["cpu"]
        switches[role] += figures["voluntary"] + figures["involuntary"]
        processes[role] += 1
    imu = [age for topic, age in found["ages_ms"].items() if topic.endswith("/imu")]
    return {
        "rovers": rovers,
        "real_time_factor": found["real_time_factor"],
        "others_cores": found["others_cores"],
        "left_out": sum(found["left_out"].values()),
        "cores": dict(cores),
        "switches": dict(switches),
        "processes": dict(processes),
        "imu_age_ms": [max(column) for column in zip(*imu, strict=True)] if imu else [],
    }


def exponent(rows: list[dict[str, Any]]) -> float:
    """Return by which power of the number of rovers the cost of all grows, at the large end."""
    last = rows[-1]
    first = min(rows, key=lambda row: abs(row["rovers"] - last["rovers"] / 4))
    growth = math.log(last["rovers"] / first["rovers"])
    return math.log(total(last) / total(first)) / growth if growth else math.nan


def total(row: Mapping[str, Any]) -> float:
    """Return the processor time of all processes."""
    return float(sum(row["cores"].values()))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.scale", description=__doc__)
    parser.add_argument(
        "--rovers", default="1,2,4,8,16,32", metavar="N,N", help=f"at most {MOST} (%(default)s)"
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="wall time of each fleet")
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write the figures")
    add_argument(parser)
    options = parser.parse_args()
    heads = [role.removeprefix("udp_bridge_") for role in ROLES]
    print("| rovers | processes | " + " | ".join(heads), end=" | all | of a rover | switches/s | ")
    print("IMU in ROS p50, p99 | factor | left out | others |")
    print("|---" * (len(ROLES) + 9) + "|")
    rows = []
    for rovers in map(int, options.rovers.split(",")):
        row = measured(rovers, options.seconds, forwarded(options))
        rows.append(row)
        ages = ", ".join(f"{age:.1f} ms" for age in row["imu_age_ms"])
        cells = [
            *(str(rovers), str(sum(row["processes"].values()))),
            *(f"{100 * row['cores'][role]:.0f} %" for role in ROLES),
            *(f"{100 * total(row):.0f} %", f"{100 * total(row) / rovers:.1f} %"),
            *(f"{sum(row['switches'].values()):.0f}", ages),
            *(f"{row['real_time_factor']:.3f}", str(row["left_out"] or "nothing")),
            f"{row['others_cores']:.2f}",
        ]
        print("| " + " | ".join(cells) + " |", flush=True)
    print(f"cost grows with the number of rovers to the power of {exponent(rows):.2f}")
    if options.out:
        options.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
