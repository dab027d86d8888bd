# SPDX-License-Identifier: Apache-2.0
"""Simulation state, steps and reset, and the features that the node reports."""

from typing import Any

import pytest

from udp_bridge.wire.run_commands import PAUSED, RUNNING

from .conftest import Served

STOPPED, PLAYING, PAUSE = range(3)
NO_WORLD = 4
UNSUPPORTED, OK, INCORRECT_STATE, FAILED = 0, 1, 3, 4
ALREADY, ERROR, INCORRECT = 101, 102, 103


def state(served: Served) -> int:
    return int(served.call("get_simulation_state").state.state)


def test_features_are_those_of_the_services(served: Served, monkeypatch: Any) -> None:
    features = served.call("get_simulator_features").features
    assert list(features.features) == [
        *(*range(15), 20, *range(22, 27), 31, 32, 33, *range(40, 46), 50),
    ]
    assert features.spawn_formats == ["groundlink_yaml"]
    assert len(served.services) == 22

    from simulation_interfaces import action, srv

    monkeypatch.delattr(srv, "SpawnEntities")  # as before version 2.1
    monkeypatch.delattr(srv, "GetNamedPoseBounds")
    monkeypatch.delattr(action, "SimulateSteps")
    older = Served(served.simulator)
    left = set(features.features) - set(older.call("get_simulator_features").features.features)
    assert left == {3, 33, 50}
    assert served.services.keys() - older.services.keys() == {
        "spawn_entities",
        "get_named_pose_bounds",
    }
    assert older.actions == {}


def test_states_follow_the_requests(served: Served) -> None:
    def set_state(wanted: int) -> int:
        return served.result("set_simulation_state", state__state=wanted)[0]

    simulator = served.simulator
    assert (state(served), set_state(PLAYING)) == (PLAYING, ALREADY)
    assert (set_state(PAUSE), state(served), set_state(PAUSE)) == (OK, PAUSE, ALREADY)
    assert simulator.queries == []
    assert (set_state(STOPPED), state(served), set_state(STOPPED)) == (OK, STOPPED, ALREADY)
    resets = [query for query in simulator.queries if query["query"] == "reset"]
    assert resets == [{"query": "reset", "scopes": ["time", "state", "spawned"]}]
    assert (simulator.state, simulator.tick) == (PAUSED, 0)
    assert (set_state(PAUSE), state(served)) == (OK, PAUSE)
    assert (set_state(STOPPED), set_state(PLAYING), state(served)) == (OK, OK, PLAYING)
    assert (set_state(STOPPED), simulator.state) == (OK, PAUSED)
    simulator.tick = 1  # somebody else stepped the run
    assert state(served) == PAUSE
    simulator.tick = 0
    assert state(served) == PAUSE
    assert [set_state(number) for number in (3, 4, 5, 9)] == [
        UNSUPPORTED,
        INCORRECT,
        INCORRECT,
        UNSUPPORTED,
    ]
    simulator.fail("reset")
    assert served.result("set_simulation_state", state__state=STOPPED) == (
        ERROR,
        "no gateway found",
    )
    assert state(served) == PAUSE


def test_steps_need_a_paused_run(served: Served) -> None:
    assert served.result("step_simulation", steps=5)[0] == FAILED
    served.result("set_simulation_state", state__state=STOPPED)
    code, reason = served.result("step_simulation", steps=5)
    assert (code, reason) == (FAILED, "the simulation is stopped. Fix: pause it first")
    served.result("set_simulation_state", state__state=PAUSE)
    assert served.result("step_simulation", steps=5) == (OK, "")
    assert served.result("step_simulation") == (OK, "")
    assert served.simulator.tick == 6
    assert served.result("step_simulation", steps=0)[0] == FAILED


def test_nothing_goes_on_without_a_world(served: Served) -> None:
    simulator = served.simulator
    simulator.state, simulator.tick = PAUSED, 0
    simulator.refuse("world", "no_world")
    assert state(served) == NO_WORLD
    for wanted in (STOPPED, PLAYING, PAUSE):
        result = served.result("set_simulation_state", state__state=wanted)
        assert result == (INCORRECT, "no world is loaded. Fix: load one")
    assert served.result("step_simulation", steps=1)[0] == INCORRECT_STATE
    goal = Goal(3)
    assert served.actions["simulate_steps"](goal).result.result == INCORRECT_STATE
    assert (goal.ended, simulator.tick) == ("aborted", 0)


class Goal:
    """A goal of SimulateSteps, as rclpy hands it over."""

    def __init__(self, steps: int) -> None:
        self.request = type("Request", (), {"steps": steps})
        self.is_cancel_requested = False
        self.is_active = True
        self.ended = ""
        self.feedback: list[tuple[int, int]] = []

    def publish_feedback(self, message: Any) -> None:
        self.feedback.append((message.completed_steps, message.remaining_steps))

    def _end(self, how: str) -> None:
        self.ended, self.is_active = how, False

    def succeed(self) -> None:
        self._end("succeeded")

    def abort(self) -> None:
        self._end("aborted")


def test_the_action_needs_a_paused_run_too(served: Served) -> None:
    simulate = served.actions["simulate_steps"]
    for run_state, code, ended in ((RUNNING, FAILED, "aborted"), (PAUSED, OK, "succeeded")):
        served.simulator.state = run_state
        goal = Goal(3)
        assert (simulate(goal).result.result, goal.ended) == (code, ended)
        assert goal.feedback == ([(1, 2), (2, 1), (3, 0)] if code == OK else [])
    assert served.simulator.tick == 43
    served.result("set_simulation_state", state__state=STOPPED)
    assert simulate(Goal(3)).result.result == FAILED


@pytest.mark.parametrize(
    ("scope", "scopes"),
    [
        (0, ["time", "state", "spawned"]),
        (255, ["time", "state", "spawned"]),
        (7, ["time", "state", "spawned"]),
        (3, ["time", "state"]),
        (2, ["state"]),
        (4, ["spawned"]),
    ],
)
def test_scopes_of_a_reset(served: Served, scope: int, scopes: list[str]) -> None:
    assert served.result("reset_simulation", scope=scope) == (OK, "")
    assert served.simulator.queries == [{"query": "reset", "scopes": scopes}]


def test_a_scope_that_is_not_supported(served: Served) -> None:
    assert served.result("reset_simulation", scope=9)[0] == UNSUPPORTED
    assert served.simulator.queries == []
    served.simulator.refuse("reset", "unsupported", "time cannot be reset alone")
    assert served.result("reset_simulation", scope=1) == (
        UNSUPPORTED,
        "time cannot be reset alone",
    )
