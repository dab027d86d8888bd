# SPDX-License-Identifier: Apache-2.0
"""Steps a second of the Gymnasium environment on one core: `python -m benchmarks.environment`.

The rover of `indoor_2d` drives in steps of 0.1 s: observed are its state alone, or also a 2D scan
(UTM-30LX, 40 scans of 1081 rays a second). All processes of the run share one core. A reset and the
learning are not in the figure.
"""

import argparse
import os
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from groundlink.sim.navigation_env import NavigationEnv

SCENARIOS = Path(__file__).parents[1] / "scenarios"
GOAL_M = (3.0, 0.0)
PERIOD_S = 0.1
REPEATS = 3


def scenario(folder: Path, sensors: tuple[str, ...]) -> Path:
    """Write the scenario with some of its sensors and without its route."""
    whole: dict[str, Any] = yaml.safe_load((SCENARIOS / "indoor_2d.yaml").read_text("utf-8"))
    (rover,) = whole["vehicles"]
    del rover["route"]
    rover["sensors"] = [one for one in rover["sensors"] if one["name"] in sensors]
    for one in rover["sensors"]:
        one["datasheet"] = str(SCENARIOS / one["datasheet"])
    rover["model"] = str(SCENARIOS / rover["model"])
    whole["world"] = str(SCENARIOS / whole["world"])
    file = folder / "navigation.yaml"
    file.write_text(yaml.safe_dump(whole), encoding="utf-8")
    return file


def steps_per_second(file: Path, scan: str | None, steps: int) -> float:
    """Return the rate of the environment's steps, resets left out."""
    env = NavigationEnv(file, goals_m=[GOAL_M], scan=scan, period_s=PERIOD_S)
    try:
        env.reset(seed=0)
        action = np.array([0.5, 0.2], np.float32)
        begun = time.perf_counter()
        for _ in range(steps):
            env.step(action)
        return steps / (time.perf_counter() - begun)
    finally:
        env.close()


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="benchmarks.environment", description=__doc__)
    parser.add_argument("--steps", type=int, default=300, help="in a repeat (%(default)s)")
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    for name, scan in (("state only", None), ("2D scan", "scanner")):
        with tempfile.TemporaryDirectory() as folder:
            file = scenario(Path(folder), (scan,) if scan else ())
            rates = [steps_per_second(file, scan, options.steps) for _ in range(REPEATS)]
        print(
            f"{name:10} {statistics.median(rates):6.1f} steps/s "
            f"({min(rates):.1f} to {max(rates):.1f}), {statistics.median(rates) * PERIOD_S:.1f} x "
            "real time, on one core"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
