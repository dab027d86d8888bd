# SPDX-License-Identifier: Apache-2.0
"""DDS environment variables, with defaults for large messages on one host.

Variables that the user has set stay unchanged. This module does not import rclpy: DDS reads the
environment when rclpy starts, so `apply_defaults` must run first.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from pathlib import Path

PROFILE = Path(__file__).resolve().with_name("fastdds_profile.xml")
"""Fast DDS profile with 64 MiB of shared memory. With the default of 512 KiB, best effort loses
every cloud of 1.3 MB."""

PROFILE_VARIABLE = "FASTDDS_DEFAULT_PROFILES_FILE"
PROFILE_VARIABLE_2 = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Variable of Fast DDS 2. Fast DDS 3 also reads it, with a warning."""
FAST_DDS_2_DISTRIBUTIONS = ("humble", "iron", "jazzy")

RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LEGACY_RANGE_VARIABLE = "ROS_LOCALHOST_ONLY"


def apply_defaults(environment: MutableMapping[str, str]) -> None:
    """Set the Fast DDS profile, and discovery on this host only, unless already set."""
    if not _profile(environment):
        is_2 = environment.get("ROS_DISTRO") in FAST_DDS_2_DISTRIBUTIONS
        environment[PROFILE_VARIABLE_2 if is_2 else PROFILE_VARIABLE] = str(PROFILE)
    if not environment.get(RANGE_VARIABLE) and not environment.get(LEGACY_RANGE_VARIABLE):
        environment[RANGE_VARIABLE] = "LOCALHOST"


def describe(environment: Mapping[str, str]) -> str:
    """Return the DDS environment in one line."""
    profile = _profile(environment)
    own = " (the package's own)" if profile == str(PROFILE) else ""
    return (
        f"ROS domain {environment.get('ROS_DOMAIN_ID') or 0}, "
        f"discovery {environment.get(RANGE_VARIABLE) or 'as ROS_LOCALHOST_ONLY says'}, "
        f"Fast DDS profile {profile}{own}"
    )


def _profile(environment: Mapping[str, str]) -> str | None:
    return environment.get(PROFILE_VARIABLE) or environment.get(PROFILE_VARIABLE_2)
