# SPDX-License-Identifier: Apache-2.0
"""LiDARs' own datagrams, a device family each: its format in `*_packets`, its stream beside it.

The formats are functions from arrays, instants and constants to bytes. They open no sockets.
"""

from collections.abc import Callable
from functools import partial
from typing import Protocol

from services.sensors.lidar.spec import Lidar
from services.sensors.runtime.model import NativeDevice

from .hesai import HesaiXt32
from .livox import LivoxMid360
from .livox_sdk1 import LivoxAvia
from .livox_sdk1_packets import SPHERICAL
from .ouster import Ouster
from .ouster_packets import LEGACY, RNG19_RFL8_SIG16_NIR16
from .vlp16 import Vlp16


class NativeLidar(NativeDevice, Protocol):
    """Emulation of a LiDAR's network interface."""

    calibration: str
    """Text of the file that decoders of its packets need; empty if they need none."""


FORMATS: dict[str, Callable[[Lidar], NativeLidar]] = {
    "vlp16": Vlp16,
    "hesai_xt32": HesaiXt32,
    "livox_mid360": LivoxMid360,
    "livox_avia": LivoxAvia,
    "livox_avia_spherical": partial(LivoxAvia, formats=SPHERICAL),
    "ouster_legacy": partial(Ouster, profile=LEGACY),
    "ouster_rng19_rfl8_sig16_nir16": partial(Ouster, profile=RNG19_RFL8_SIG16_NIR16),
}
"""Device by the scenario's `native_format`."""


def native_device(model: object, spec: Lidar) -> NativeDevice:
    """Return the device that sends a LiDAR's own datagrams."""
    return FORMATS[spec.native_format](spec)
