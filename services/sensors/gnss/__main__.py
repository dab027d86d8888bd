# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.gnss --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from groundlink.scenario.sensors import Gnss
from services.sensors.shell import run

from .model import GnssModel

if __name__ == "__main__":
    run(Gnss, GnssModel, native=lambda model, _: model)
