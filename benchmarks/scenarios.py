# SPDX-License-Identifier: Apache-2.0
"""Repeats scenarios of scenario-execution: `python -m benchmarks.scenarios FILE.osc --times 100`.

Each repetition is a program of its own. A line for each scenario has the number of repetitions that
passed, the number of different recordings, and the mean time of a repetition. Exit code 0: all
passed with equal recordings.
"""

import argparse
import hashlib
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PROGRAM = Path(sys.executable).with_name("scenario_execution")
SIMULATION = "groundlink.sim.osc:GroundlinkSimulation"


def recording_of(scenario: Path, out: Path) -> str | None:
    """Run a scenario; return the sha256 of its recording, or None if the scenario failed."""
    command = [str(PROGRAM), str(scenario), "--simulation", SIMULATION, "-o", str(out)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode != 0:
        print(done.stdout + done.stderr, file=sys.stderr)
        return None
    return hashlib.sha256((out / "run.mcap").read_bytes()).hexdigest()


def main() -> int:
    """Repeat and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.scenarios", description=__doc__)
    parser.add_argument("scenarios", nargs="+", type=Path, metavar="FILE.osc")
    parser.add_argument("--times", type=int, default=100, help="repetitions (%(default)s)")
    options = parser.parse_args()
    are_equal = True
    for scenario in options.scenarios:
        begun = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            found = [recording_of(scenario, Path(folder, "out")) for _ in range(options.times)]
        seconds = (time.perf_counter() - begun) / options.times
        passed = [recording for recording in found if recording is not None]
        are_equal &= len(passed) == options.times and len(set(passed)) == 1
        print(
            f"{scenario.name}: passed {len(passed)} of {options.times}, "
            f"different recordings: {len(set(passed))} ({', '.join(h[:12] for h in set(passed))}), "
            f"{seconds:.1f} s each",
            flush=True,
        )
    return 0 if are_equal else 1


if __name__ == "__main__":
    sys.exit(main())
