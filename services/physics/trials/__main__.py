# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.physics.trials VEHICLE``: print the trials of a vehicle as JSON.

The process joins no run. `groundlink try` starts it.
"""

import argparse
import sys
import threading
from collections.abc import Sequence

import msgspec

from groundlink.cli.files.try_vehicle import add_trial_arguments
from groundlink.core.errors import UserError
from groundlink.core.extras import process_needs
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.process import runner as process
from groundlink.scenario.running_gear import Towed

PROCESS = "try"

with process_needs(PROCESS, "physics"):
    from .maneuvers import all_trials


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Print the trials of a vehicle."""
    parser = argparse.ArgumentParser(prog="groundlink try", description="Try a vehicle.")
    add_trial_arguments(parser)
    options = parser.parse_args(arguments)
    kind, scenario = load_partial(options.vehicle, warn=_warn)
    if kind is not FileKind.VEHICLE:
        raise UserError(f"{options.vehicle}: is a {kind.value}. Fix: pass a vehicle's file or name")
    if isinstance(scenario.vehicles[0].model.drive, Towed):
        raise UserError(f"{options.vehicle}: is towed; expected a vehicle that drives")
    trials = []
    for trial in all_trials(scenario.vehicles[0].model, climb_deg=options.slope):
        if stop.is_set():
            return
        trials.append(trial)
    print(msgspec.json.encode(trials).decode())


def _warn(line: str) -> None:
    print(f"groundlink: warning: {line}", file=sys.stderr)


if __name__ == "__main__":
    process.run(PROCESS, main)
