# SPDX-License-Identifier: Apache-2.0
"""A receiver's own datagrams: NMEA 0183 sentences or UBX messages of its published fixes."""

from collections.abc import Callable

import numpy as np

from groundlink.messages.base import floats
from groundlink.messages.navigation import NavSatFix
from services.sensors.runtime.model import Datagram, NativeDevice

from . import ubx
from .model import Details, GnssModel
from .multipath import range_errors_m
from .reception import Path, strengths_dbhz
from .spec import Gnss


class NmeaReceiver:
    """A receiver that sends NMEA 0183, a sentence in each datagram (a `ModelDevice`)."""

    def __init__(self, model: GnssModel, spec: Gnss) -> None:
        self.follow(model)

    def follow(self, model: GnssModel) -> None:
        """Use another model."""
        self._model = model

    def datagrams(self, fix: NavSatFix, epoch_nanos: int) -> list[Datagram]:
        """Return the sentences of a published fix."""
        return self._model.datagrams(fix, epoch_nanos)


class UbxReceiver:
    """A receiver that sends UBX, a message in each datagram (a `ModelDevice`)."""

    def __init__(self, model: GnssModel, spec: Gnss) -> None:
        self.follow(model)
        self._speed_stddev_mps = spec.velocity_stddev_mps
        self._multipath = spec.multipath

    def follow(self, model: GnssModel) -> None:
        """Use another model."""
        self._model = model

    def datagrams(self, fix: NavSatFix, epoch_nanos: int) -> list[Datagram]:
        """Return NAV-DOP, NAV-PVT, NAV-HPPOSLLH and NAV-SAT of a published fix."""
        details = self._model.details(fix)
        epoch = details.epoch
        geometry = None if details.solved is None else details.solved.geometry
        east, north, up = np.sqrt(floats(fix.position_covariance_m2)[::4]).tolist()
        motion = ubx.Motion(details.up_mps, (east, north, up), self._speed_stddev_mps)
        messages = (
            ubx.nav_dop(epoch, geometry),
            ubx.nav_pvt(epoch, geometry, motion),
            ubx.nav_hpposllh(epoch, motion),
            ubx.nav_sat(epoch, self._signals(details)),
        )
        return [Datagram(message) for message in messages]

    def _signals(self, details: Details) -> list[ubx.SatelliteSignal]:
        """Return the satellites above the horizon. Residuals are the errors by reflections."""
        signals = details.signals
        direct = signals.path == Path.DIRECT
        residuals, used = np.zeros(len(direct)), np.zeros(len(direct), np.bool_)
        if self._multipath is not None:
            residuals = range_errors_m(signals.detour_m, direct, self._multipath, by_carrier=False)
        if details.solved is not None:
            used = details.solved.used
        east, north, up = signals.towards
        columns = (
            np.degrees(np.arctan2(east, north)) % 360,
            np.degrees(np.arcsin(np.clip(up, -1.0, 1.0))),
            strengths_dbhz(signals, self._multipath),
            residuals,
            direct,
            used,
        )
        rows = zip(self._model.satellites, *(column.tolist() for column in columns), strict=True)
        return [
            ubx.SatelliteSignal(satellite.system, satellite.number, *row)
            for satellite, *row in rows
            if row[1] > 0
        ]


FORMATS: dict[str, Callable[[GnssModel, Gnss], NativeDevice]] = {
    "nmea": NmeaReceiver,
    "ubx": UbxReceiver,
}
"""Device by the scenario's `native_format`."""


def native_device(model: GnssModel, spec: Gnss) -> NativeDevice:
    """Return the device that sends a receiver's own datagrams."""
    return FORMATS[spec.native_format](model, spec)
