# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.ros.streams import outgoing
from groundlink.scenario.every_sensor import Repair, RepairBy
from services.gateway.streams import queue_limits, repair_table
from udp_bridge.sender.repair import Fec, Mode, Resend


@pytest.mark.parametrize(
    ("said", "mode"),
    [
        ("none", None),
        ("resend", Resend(500_000_000)),
        (RepairBy(resend=0.2), Resend(200_000_000)),
        (RepairBy(fec=0.25), Fec(0.25)),
    ],
)
def test_repair_of_the_scenario_reaches_the_link(said: Repair, mode: Mode | None) -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    (vehicle,) = scenario.vehicles
    sensors = (replace(vehicle.sensors[0], repair=said), *vehicle.sensors[1:])
    changed = replace(scenario, vehicles=(replace(vehicle, sensors=sensors),))
    expected = {(1, "/points"): mode} if mode else {}
    assert repair_table(outgoing(changed, "run")) == expected


@pytest.mark.parametrize("block_deg", [0.0, 15.0])
def test_blocks_of_one_revolution_may_wait_and_nothing_else(block_deg: float) -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    (vehicle,) = scenario.vehicles
    lidar = replace(vehicle.sensors[0], block_deg=block_deg)
    changed = replace(scenario, vehicles=(replace(vehicle, sensors=(lidar, *vehicle.sensors[1:])),))
    table = queue_limits(outgoing(changed, "run"))
    points = 3600 * 16 * 22
    assert list(table) == ([(1, "/points")] if block_deg else [])
    assert all(points < most < 1.01 * points for most in table.values())


def test_labeled_blocks_of_one_revolution_may_wait() -> None:
    scenario = load(SHIPPED / "indoor_lab.yaml")
    (vehicle,) = scenario.vehicles
    lidar = replace(vehicle.sensors[0], block_deg=15.0, labels=("points",))
    changed = replace(scenario, vehicles=(replace(vehicle, sensors=(lidar,)),))
    most = queue_limits(outgoing(changed, "run"))[1, "/points/labels/points"]
    assert 3600 * 16 * 26 < most < 1.01 * 3600 * 16 * 26


@pytest.mark.parametrize("said", ["{fec: 0}", "{fec: 0.1, resend: 1}", "{}", "fec", "{rs: 1}"])
def test_invalid_repair_is_a_user_error(tmp_path: Path, said: str) -> None:
    text = (SHIPPED / "indoor_lab.yaml").read_text()
    assert "name: lidar," in text
    for folder in ("worlds", "vehicles", "sensors"):
        (tmp_path / folder).symlink_to(SHIPPED / folder)
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(text.replace("name: lidar,", f"name: lidar, repair: {said},"))
    with pytest.raises(UserError, match=r"repair"):
        load(wrong)
    right = tmp_path / "right.yaml"
    right.write_text(text.replace("name: lidar,", "name: lidar, repair: {fec: 0.2},"))
    assert load(right).vehicles[0].sensors[0].repair == RepairBy(fec=0.2)
