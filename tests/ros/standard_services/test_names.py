# SPDX-License-Identifier: Apache-2.0
"""Where the services are, by the parameter `services_namespace`."""

from typing import Any

import pytest


class Names:
    """Stands in for a node named /rig/bridge, whose names nobody remaps."""

    def resolve_service_name(self, name: str) -> str:
        if " " in name:
            raise RuntimeError("no name")
        return name.replace("~", "/rig/bridge") if name[0] in "/~" else f"/rig/{name}"


@pytest.mark.parametrize(
    ("namespace", "full_name", "place"),
    [
        ("/", "/spawn_entity", "/"),
        ("", "/spawn_entity", "/"),
        ("/lab/", "/lab/spawn_entity", "/lab/"),
        ("lab", "/rig/lab/spawn_entity", "/rig/lab/"),
        ("~", "/rig/bridge/spawn_entity", "/rig/bridge/"),
    ],
)
def test_namespace_stands_before_a_name(namespace: str, full_name: str, place: str) -> None:
    services = pytest.importorskip("udp_bridge_ros2.services", reason="no ROS 2 here")
    node: Any = Names()
    assert services.full_service_name(node, namespace, "spawn_entity") == full_name
    assert services.full_service_name(node, namespace, "") == place


def test_what_is_no_namespace_is_refused() -> None:
    services = pytest.importorskip("udp_bridge_ros2.services", reason="no ROS 2 here")
    node: Any = Names()
    with pytest.raises(ValueError, match=r"services_namespace 'a b': no name"):
        services.full_service_name(node, "a b", "")
