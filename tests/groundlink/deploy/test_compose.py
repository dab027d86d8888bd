# SPDX-License-Identifier: Apache-2.0
"""What `groundlink compose` writes."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from groundlink.bus.topics import process_names
from groundlink.core.errors import UserError
from groundlink.deploy.access_control import grants
from groundlink.deploy.compose import CHECKS_HZ, MAIN, Deployment
from groundlink.loader import load

ROOT = Path(__file__).parents[3]
DEFAULT = ROOT / "scenarios/indoor_lab.yaml"


def deployment(file: Path = DEFAULT) -> Deployment:
    return Deployment(load(file), file, sources="..", router="tcp/sim.example:7447")


def services(text: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load(text)["services"]
    return found


@pytest.fixture
def spread(tmp_path: Path) -> Deployment:
    """The default scenario with its camera on another machine."""
    text = DEFAULT.read_text().replace("name: camera,", "name: camera, host: gpu,")
    file = tmp_path / "spread.yaml"
    for folder in ("worlds", "vehicles", "sensors"):
        (tmp_path / folder).symlink_to(ROOT / "scenarios" / folder)
    file.write_text(text)
    return deployment(file)


def test_the_file_that_is_shipped_is_that_of_the_default_scenario() -> None:
    shipped = (ROOT / "deploy/compose.yaml").read_text()
    file = Path("../scenarios/indoor_lab.yaml")
    made = Deployment(load(DEFAULT), file, sources="..", overload="skip").compose()
    assert made == shipped, "make it anew as is done here"


@pytest.mark.parametrize(("told", "expected"), [(None, "slow"), ("skip", "skip")])
def test_what_gives_way_is_as_told_or_as_the_scenario_says(told: str | None, expected: str) -> None:
    made = Deployment(load(DEFAULT), DEFAULT, sources=".", overload=told).compose()
    command = services(made)["physics"]["command"]
    assert command[-2:] == ["--overload", f"${{GROUNDLINK_OVERLOAD:-{expected}}}"]


def test_one_variable_names_another_scenario_of_the_same_processes() -> None:
    physics = services(deployment().compose())["physics"]
    assert physics["command"][0] == "/scenario/${GROUNDLINK_SCENARIO:-indoor_lab.yaml}"
    assert physics["volumes"] == [f"{DEFAULT.parent}:/scenario:ro"]


def test_every_process_of_a_run_has_a_container_and_its_walls() -> None:
    found = services(deployment().compose())
    for process in process_names(load(DEFAULT)):
        assert process.replace("/", "-") in found
    for name, service in found.items():
        assert service["read_only"], name
        assert service["init"], name
        assert service["pids_limit"] <= 1024, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert service["healthcheck"]["test"], name
        assert service["healthcheck"]["start_period"] == "60s", f"{name}: cores may be busy"
        assert service["mem_limit"], name
        assert service["user"].endswith("65532:65532}"), name
        assert (ROOT / service["build"]["dockerfile"]).is_file(), name


@pytest.mark.parametrize("name", ["indoor_lab", "two_rovers"])
def test_the_engine_looks_at_three_containers_a_second_and_at_two_that_others_wait_for(
    name: str,
) -> None:
    found = services(deployment(ROOT / f"scenarios/{name}.yaml").compose())
    intervals_s = {n: int(s["healthcheck"]["interval"][:-1]) for n, s in found.items()}
    assert sum(1 / seconds for seconds in intervals_s.values()) <= CHECKS_HZ + 1
    assert intervals_s["router"] == intervals_s["physics"] == 2


def test_what_is_published_is_published_to_this_machine_alone() -> None:
    for name, service in services(deployment().compose()).items():
        for port in service.get("ports", ()):
            assert port.replace("${GROUNDLINK_PUBLISH:-127.0.0.1}", "127.0.0.1").startswith(
                "127."
            ), name


def test_ros_sees_the_gateway_and_not_the_bus() -> None:
    found = services(deployment().compose())
    on_both = [n for n, service in found.items() if set(service["networks"]) == {"bus", "ros"}]
    assert on_both == ["gateway"]
    assert found["ros2"]["networks"] == ["ros"]


def test_sensors_go_to_the_host_of_their_label(spread: Deployment) -> None:
    assert spread.hosts() == [MAIN, "gpu"]
    assert "rover-camera" not in services(spread.compose())
    there = services(spread.compose("gpu"))
    assert list(there) == ["rover-camera"]
    environment = there["rover-camera"]["environment"]
    assert environment["GROUNDLINK_ROUTER"] == "tcp/sim.example:7447"
    assert "depends_on" not in there["rover-camera"]


def test_a_host_without_sensors_is_named(spread: Deployment) -> None:
    with pytest.raises(UserError, match=r"no sensor has `host: gpy`.*gpu"):
        spread.compose("gpy")


def test_credentials_are_laid_over_every_container_of_the_bus() -> None:
    over = services(deployment().secured("/etc/run"))
    for name, service in services(deployment().compose()).items():
        if "bus" in service["networks"]:
            assert over[name]["environment"]["GROUNDLINK_ROUTER"] == "tls/router:7447"
            assert f"/etc/run/{name}:/run/credentials:ro" in over[name]["volumes"]
    made = {"router", *(process.replace("/", "-") for process, _ in grants(load(DEFAULT)))}
    mounted = [v for service in over.values() for v in service["volumes"] if "credentials" in v]
    assert {volume.split("/")[3].partition(":")[0] for volume in mounted} <= made
    assert over["router"]["command"][-1] == "tls/0.0.0.0:7447"
    for name in ("gateway", "ros2"):
        assert over[name]["command"][-2:] == ["--key-file", "/run/bridge.key"]
