# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.lidar.native SCENARIO VEHICLE/SENSOR``.

Print the calibration file that decoders of a LiDAR's packets need. The process joins no run.
"""

import argparse
import sys
import threading
from collections.abc import Sequence

from groundlink.core.errors import UserError
from groundlink.loader.scenario_files import load
from groundlink.process import runner as process
from services.sensors.lidar.spec import Lidar

from . import FORMATS

PROCESS = "sensors.lidar.native"


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Print the file.

    Raises
    ------
    UserError
        when there is no such LiDAR, or its format needs no file.
    """
    parser = argparse.ArgumentParser(prog=PROCESS, description="Print a LiDAR's calibration file.")
    parser.add_argument("scenario", metavar="SCENARIO")
    parser.add_argument("name", metavar="VEHICLE/SENSOR", help="as in rover/lidar")
    options = parser.parse_args(arguments)
    found = load(options.scenario).sensor(options.name)
    spec = found and found[1]
    if not isinstance(spec, Lidar):
        raise UserError(f"the scenario has no LiDAR `{options.name}`")
    if not (text := FORMATS[spec.native_format](spec).calibration):
        raise UserError(f"decoders of `native_format: {spec.native_format}` need no file")
    sys.stdout.write(text)


if __name__ == "__main__":
    process.run(PROCESS, main)
