# SPDX-License-Identifier: Apache-2.0
"""Repetition and cost of lockstep with a graph of ROS nodes: `python -m benchmarks.ros_graph`.

First, runs of the stack with random delays of its nodes and packet loss between the hosts; each is
compared with the first one. Executors of every tenth run have several threads. Then pairs of runs
without delays and loss: one waits for the whole graph (`time.nodes`), the other for a command after
each IMU message (`time.answers`), while its nodes run freely.
"""

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

from benchmarks.claims import Claim, add_options, judge
from groundlink.core.clock import TICK_SECONDS
from groundlink.recording.traces import compare_traces, read_trace

from .runs import TRACE, run_stack, steady_pace

FREE = ("time.nodes=[]", "time.answers={/cmd_vel: /imu}")
COST_SECONDS = 6.0
MOST_COST = 0.3
"""A free run works on several messages at once, which a run in lockstep with the graph does not."""


def equal_runs(folder: Path, times: int, seconds: float) -> int:
    """Run the stack several times; return how many runs are equal to the first, and it."""
    first, equal = None, 0
    for number in range(times):
        threads = 1 if number % 10 else 3
        factor = run_stack(folder / f"run_{number}", seconds=seconds, threads=threads)
        trace = read_trace(folder / f"run_{number}" / TRACE, round(seconds / TICK_SECONDS))
        first = first or trace
        rows = compare_traces(first, trace, {})
        is_equal = not any(row.difference for row in rows)
        equal += is_equal
        count = sum(row.equal for row in rows)
        print(
            f"run {number + 1}: {'equal' if is_equal else rows[0]}, {count} messages, "
            f"{factor:.2f} x real time",
            flush=True,
        )
    return equal


def cost(folder: Path, pairs: int) -> float:
    """Return the share of time that waiting for the graph adds to a free run."""
    kinds = [("nodes", ()), ("answers", FREE)]
    costs = []
    for number in range(pairs):
        paces = {}
        for name, settings in kinds:
            at = folder / f"{name}_{number}"
            run_stack(
                at,
                seconds=COST_SECONDS,
                loss=0.0,
                longest_delay_s=0.0,
                threads=1,
                settings=settings,
            )
            paces[name] = steady_pace(at)
        kinds.reverse()  # the load of the machine changes
        held, free = paces["nodes"], paces["answers"]
        print(f"{held:.2f} x real time with `nodes`, {free:.2f} with `answers`", flush=True)
        costs.append(free / held - 1)
    return statistics.median(costs)


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.ros_graph", description=__doc__)
    parser.add_argument("--times", type=int, default=100, help="runs to compare (%(default)s)")
    parser.add_argument("--seconds", type=float, default=2.0, help="sim time of each (%(default)g)")
    parser.add_argument("--pairs", type=int, default=5, help="runs of each kind (%(default)s)")
    add_options(parser)
    options = parser.parse_args()
    claims = []
    with tempfile.TemporaryDirectory() as folder:
        if options.times:
            equal = equal_runs(Path(folder), options.times, options.seconds)
            what = f"equal runs of {options.times} with a graph of five nodes, 5 % loss"
            claims.append(Claim(what, equal, options.times))
        if options.pairs:
            share = cost(Path(folder), options.pairs)
            what = "share of time that waiting for a graph adds to `answers`"
            claims.append(Claim(what, share, MOST_COST, is_at_least=False))
    return judge(claims, options)


if __name__ == "__main__":
    sys.exit(main())
