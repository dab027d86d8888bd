# SPDX-License-Identifier: Apache-2.0
"""What DDS reads from the environment, with defaults for big messages on one host.

Rule: nothing that the user has set is touched. It imports no rclpy, as DDS reads all of this when
rclpy starts; so `apply_defaults` has to come first.
"""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping
from pathlib import Path

PROFILE = Path(__file__).resolve().with_name("fastdds_profile.xml")
"""Shared memory of 64 MiB: with the default of 512 KiB, best effort loses every cloud of 1.3 MB."""

PROFILE_VARIABLE = "FASTDDS_DEFAULT_PROFILES_FILE"
PROFILE_VARIABLE_2 = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""What Fast DDS 2 reads instead; Fast DDS 3 reads it, too, and warns."""
FAST_DDS_2_DISTRIBUTIONS = ("humble", "iron", "jazzy")

RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LEGACY_RANGE_VARIABLE = "ROS_LOCALHOST_ONLY"


def apply_defaults(environment: MutableMapping[str, str]) -> None:
    """Set what is not set: the Fast DDS profile, and discovery on this host only."""
    if not _profile(environment):
        is_2 = environment.get("ROS_DISTRO") in FAST_DDS_2_DISTRIBUTIONS
        environment[PROFILE_VARIABLE_2 if is_2 else PROFILE_VARIABLE] = str(PROFILE)
    if not environment.get(RANGE_VARIABLE) and not environment.get(LEGACY_RANGE_VARIABLE):
        environment[RANGE_VARIABLE] = "LOCALHOST"


def describe(environment: Mapping[str, str]) -> str:
    """Return in one line what DDS was told."""
    profile = _profile(environment)
    own = " (the package's own)" if profile == str(PROFILE) else ""
    return (
        f"ROS domain {environment.get('ROS_DOMAIN_ID') or 0}, "
        f"discovery {environment.get(RANGE_VARIABLE) or 'as ROS_LOCALHOST_ONLY says'}, "
        f"Fast DDS profile {profile}{own}"
    )


def _profile(environment: Mapping[str, str]) -> str | None:
    return environment.get(PROFILE_VARIABLE) or environment.get(PROFILE_VARIABLE_2)
