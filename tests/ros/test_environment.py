# SPDX-License-Identifier: Apache-2.0
import pytest

from udp_bridge_ros2.environment import PROFILE, apply_defaults, describe

OWN = str(PROFILE)


@pytest.mark.parametrize(
    ("given", "added"),
    [
        (
            {},
            {"FASTDDS_DEFAULT_PROFILES_FILE": OWN, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        ),
        (
            {"ROS_DISTRO": "jazzy", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"},
            {"FASTRTPS_DEFAULT_PROFILES_FILE": OWN},
        ),
        (
            {"FASTRTPS_DEFAULT_PROFILES_FILE": "/my.xml", "ROS_LOCALHOST_ONLY": "1"},
            {},
        ),
        (
            {"FASTDDS_DEFAULT_PROFILES_FILE": "/my.xml"},
            {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        ),
    ],
)
def test_only_what_is_not_set_is_set(given: dict[str, str], added: dict[str, str]) -> None:
    environment = dict(given)
    apply_defaults(environment)
    assert environment == given | added


def test_description() -> None:
    environment = {"ROS_DOMAIN_ID": "5"}
    apply_defaults(environment)
    assert describe(environment) == (
        f"ROS domain 5, discovery LOCALHOST, Fast DDS profile {OWN} (the package's own)"
    )


def test_the_profile_lies_beside_the_package() -> None:
    assert "<segment_size>67108864</segment_size>" in PROFILE.read_text()
