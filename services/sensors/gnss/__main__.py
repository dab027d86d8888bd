# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.sensors.gnss --name VEHICLE/SENSOR [--native HOST:PORT]``."""

from groundlink.scenario.sensors import Gnss
from services.sensors.runtime.kinds import Kind, run

from .model import GnssModel

KIND = Kind(Gnss, GnssModel, native=lambda model, _: model, sees_world=True)

if __name__ == "__main__":
    run(KIND)
