# SPDX-License-Identifier: Apache-2.0
"""How far sim time drifts from the wall clock in real time: `python -m benchmarks.drift`.

Physics steps the default scenario at 400 Hz, and this process receives each state. The least age of
a state's stamp over some seconds is its transport time, which does not grow; its growth from the
first seconds to the last is the drift. Time may not stretch (`overload: skip`): otherwise it would
on a busy machine, and that is no drift.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path

from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.core.clock import NANOS, TICK_RATE_HZ
from groundlink.messages.base import State
from groundlink.monitor.process_commands import free_endpoint

from .claims import Claim, add_options, judge

SCENARIO = Path(__file__).parents[1] / "scenarios" / "indoor_lab.yaml"
RUN = "drift"
SECONDS = 600.0
LEAST_OVER_SECONDS = 5.0
MOST_MS = 10.0


def ages_ms(endpoint: str, seconds: float) -> list[float]:
    """Return the least age of a state in each few seconds of a run, in ms.

    Raises
    ------
    RuntimeError
        when a state is missing, since it might have been the youngest.
    """
    states: BusInbox[State] = BusInbox(depth=4096)
    ages: list[float] = []
    least, tick = float("inf"), -1
    ticks = round(LEAST_OVER_SECONDS * TICK_RATE_HZ)
    with Bus(listen=endpoint) as bus:
        bus.subscribe(STATE.key_in(RUN), State, states)
        mode = ("--mode", "realtime", "--overload", "skip")
        command = ("-m", "services.physics", str(SCENARIO), *mode)
        physics = subprocess.Popen([sys.executable, *command, "--run", RUN, "--connect", endpoint])
        try:
            while len(ages) * LEAST_OVER_SECONDS < seconds:
                arrived = states.get(seconds=30)
                if arrived is None or arrived[1].tick != tick + 1:
                    raise RuntimeError(f"the state after tick {tick} is missing")
                least = min(least, (time.time_ns() - arrived[1].stamp_nanos) / NANOS * 1e3)
                tick += 1
                if tick % ticks == ticks - 1:
                    ages.append(least)
                    least = float("inf")
        finally:
            physics.terminate()
            physics.wait()
    return ages


def main() -> int:
    """Measure, print, and with --check compare."""
    parser = argparse.ArgumentParser(prog="benchmarks.drift", description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="to run (%(default)g)")
    add_options(parser)
    options = parser.parse_args()
    ages = ages_ms(free_endpoint(), options.seconds)
    drift = ages[-1] - ages[0]
    print(
        f"{len(ages) * LEAST_OVER_SECONDS:g} s at {TICK_RATE_HZ} Hz: sim time is {drift:+.3f} ms "
        f"behind the wall clock, at most {max(ages) - ages[0]:+.3f} ms"
    )
    what = f"drift of sim time from the wall clock over {options.seconds:g} s, in ms"
    return judge([Claim(what, abs(drift), MOST_MS, is_at_least=False)], options)


if __name__ == "__main__":
    sys.exit(main())
