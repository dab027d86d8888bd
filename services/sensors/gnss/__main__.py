# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.gnss --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from services.sensors.gnss import KIND
from services.sensors.runtime.process import run

if __name__ == "__main__":
    run(KIND)
