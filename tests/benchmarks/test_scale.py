# SPDX-License-Identifier: Apache-2.0
"""The model of hosts: queues, cables, and the fit of its costs."""

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from benchmarks.scale.costs import READINGS_HZ, STATES_HZ, Costs, fitted
from benchmarks.scale.fleet import MOST, fleet
from benchmarks.scale.model import (
    IMU_BYTES,
    OTHER_STATE_BYTES,
    SCAN_BYTES,
    STATE_BYTES,
    Run,
    most_rovers,
)
from groundlink.loader import load

MICRO = 1e-6
LITTLE = Costs(*[MICRO] * (len(Costs.__struct_fields__) - 1))
ROVERS = 4


def test_the_yard_has_room_for_the_largest_fleet(tmp_path: Path) -> None:
    assert len(load(str(fleet(tmp_path, MOST))).vehicles) == MOST


@pytest.mark.parametrize("hosts", [0, 2])
def test_a_run_of_little_work_keeps_to_real_time(hosts: int) -> None:
    found = Run(LITTLE, ROVERS, hosts, cores=2).go()
    assert found.holds
    assert found.factor == pytest.approx(1.0, abs=0.002)
    assert found.cores["physics"] == pytest.approx(400 * (1 + ROVERS) * MICRO, rel=0.01)
    assert found.ages_ms[1] < 1.0


def test_physics_slower_than_its_period_slows_sim_time_down() -> None:
    found = Run(replace(LITTLE, tick=5e-3), ROVERS, 0, cores=2).go()
    assert found.factor == pytest.approx(0.5, abs=0.01)
    assert found.bottleneck == "physics"


def test_sensors_slower_than_the_states_slow_sim_time_down_until_they_have_more_hosts() -> None:
    costs = replace(LITTLE, state_of_own=1e-3)
    assert Run(costs, ROVERS, 1, cores=2).go().factor == pytest.approx(2.5 / 4, abs=0.05)
    assert Run(costs, ROVERS, 2, cores=2).go().holds


def test_a_gateway_that_gets_more_than_it_can_send_is_behind() -> None:
    seconds = 1.0 / (READINGS_HZ * ROVERS)
    assert Run(replace(LITTLE, reading_to_ros=0.9 * seconds), ROVERS, 0, cores=2).go().holds
    late = Run(replace(LITTLE, reading_to_ros=1.3 * seconds), ROVERS, 0, cores=2).go()
    assert late.behind == ("gateway",)
    assert late.factor > 0.98


def test_processes_share_the_cores_of_their_host() -> None:
    costs = replace(LITTLE, tick=1.5e-3, state_of_own=1.5e-3 / ROVERS)
    assert Run(costs, ROVERS, 1, cores=1).go().holds
    assert Run(costs, ROVERS, 0, cores=1).go().factor == pytest.approx(2.5 / 3, abs=0.05)


def test_cables_carry_states_and_readings() -> None:
    hosts = 2
    found = Run(replace(LITTLE, framing=1.5), ROVERS, hosts, cores=2).go()
    states = hosts * 2 * 400 * (STATE_BYTES + OTHER_STATE_BYTES * ROVERS)
    readings = ROVERS * (450 * IMU_BYTES + 10 * SCAN_BYTES)
    assert found.network_bytes == pytest.approx(1.5 * (states + readings), rel=0.02)


def test_the_largest_run_that_holds_is_found() -> None:
    assert most_rovers(lambda count: count <= 37) == 37
    assert most_rovers(lambda count: False) == 0


def row(costs: Costs, rovers: int, hosts: int = 1) -> dict[str, Any]:
    """Return what would be measured with these costs."""
    processes = min(2, rovers) if hosts == 1 else hosts - 1
    own = READINGS_HZ * rovers

    def shared(first: float, other: float, each: float) -> float:
        return processes * (first + other * rovers) + each * rovers

    routed = 0.0 if hosts == 1 else costs.routed * (own + (hosts - 1) * STATES_HZ)
    cores = {
        "physics": 400 * (costs.tick + costs.tick_of_rover * rovers),
        "imu": 400 * shared(costs.state, costs.state_of_other, costs.state_of_own),
        "scanner": 100 * shared(costs.batch, costs.batch_of_other, costs.batch_of_own),
        "gateway": 400 * costs.gateway_tick + own * costs.reading_to_ros,
        "udp_bridge_ros2": 400 * costs.node_tick + own * costs.reading_in_ros,
        "router": 400 * (costs.router_tick + costs.router_of_rover * rovers) + routed,
    }
    return {
        "rovers": rovers,
        "hosts": hosts,
        "cores": cores,
        "processes": {"imu": processes, "scanner": processes},
    }


def test_the_fit_finds_the_costs_that_were_measured() -> None:
    names = [name for name in Costs.__struct_fields__ if name != "framing"]
    costs = Costs(*[(3 + index) * MICRO for index in range(len(names))])
    found = fitted(
        [row(costs, rovers) for rovers in (1, 2, 4, 8, 16)],
        [row(costs, 8, hosts) for hosts in (1, 2, 3)],
    )
    for name in names:
        assert getattr(found, name) == pytest.approx(getattr(costs, name), rel=1e-6), name
