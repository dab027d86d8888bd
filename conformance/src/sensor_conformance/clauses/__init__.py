# SPDX-License-Identifier: Apache-2.0
"""The clauses, a module for each family, and the table of them all.

A clause knows readings and signals; it reads no file and draws nothing.
"""

from types import ModuleType

from . import (
    camera,
    cloud_noise,
    clouds,
    covariances,
    frames,
    gnss,
    hesai,
    imu,
    joints,
    livox,
    odometry,
    packets,
    pictures,
    scans,
    stamps,
    turning,
)
from .clause import Clause

FAMILIES: tuple[ModuleType, ...] = (
    stamps,
    frames,
    imu,
    odometry,
    turning,
    joints,
    covariances,
    gnss,
    camera,
    pictures,
    scans,
    clouds,
    cloud_noise,
    packets,
    hesai,
    livox,
)
"""Modules of clauses, in the order of reports."""

TABLE: tuple[Clause, ...] = tuple(
    value for family in FAMILIES for value in vars(family).values() if isinstance(value, Clause)
)
"""All clauses. A clause is in the table as soon as its module defines it."""
