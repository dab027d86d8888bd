# SPDX-License-Identifier: Apache-2.0
"""Every row of lockstep's table: the state is reached, the event happens, the action follows."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import pytest

from groundlink.core.backoff import FIRST_SECONDS
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Ack, State
from groundlink.scenario.schema import Time
from services.gateway.bus_session import RunStatus
from services.gateway.lockstep.states import TRANSITIONS, Action, Event, LockstepState, Machine
from udp_bridge.wire.lockstep import RESTARTED

from .rig import LIFE, RUN, Rig

OVERDUE_SECONDS = 6.0
SKIPPING = Time(mode="fast", lockstep="ros", epoch="zero", overload="skip")


def connect(rig: Rig) -> None:
    rig.turn()


def run(rig: Rig) -> None:
    connect(rig)
    rig.says(-1)
    rig.clock(0)
    rig.followed(0)
    rig.says(0)


def collect(rig: Rig) -> None:
    run(rig)
    rig.clock(4)


def ask(rig: Rig) -> None:
    collect(rig)
    rig.followed(4)


def run_without_ros(rig: Rig) -> None:
    ask(rig)
    rig.turn(OVERDUE_SECONDS)


def collect_without_ros(rig: Rig) -> None:
    run_without_ros(rig)
    rig.clock(8)


REACH: dict[LockstepState, Callable[[Rig], None]] = {
    LockstepState.START: lambda rig: None,
    LockstepState.CONNECTING: connect,
    LockstepState.RUNNING: run,
    LockstepState.COLLECTING: collect,
    LockstepState.ASKING: ask,
    LockstepState.RUNNING_WITHOUT_ROS: run_without_ros,
    LockstepState.COLLECTING_WITHOUT_ROS: collect_without_ros,
}


def still_waiting(rig: Rig) -> None:
    tick = rig.lockstep.tick
    state = State(RUN, LIFE, 0, tick, tick * TICK_NANOS, "", {})
    rig.resumed = RunStatus(Ack(LIFE, -1, -1), state)
    rig.turn(FIRST_SECONDS + 0.1)
    rig.turn()


HAPPEN: dict[Event, Callable[[Rig], None]] = {
    Event.OPENED: lambda rig: rig.turn(),
    Event.CLOCK: lambda rig: rig.clock(rig.lockstep.tick + 4),
    Event.ALL_SENT: lambda rig: rig.followed(rig.lockstep.tick),
    Event.REPLY: lambda rig: rig.says(rig.link.barriers[-1].tick),
    Event.NODE_RESTARTED: lambda rig: rig.says(rig.link.barriers[-1].tick, state=RESTARTED),
    Event.OVERDUE: lambda rig: rig.turn(OVERDUE_SECONDS),
    Event.SILENCE: lambda rig: rig.turn(FIRST_SECONDS + 0.1),
    Event.STILL_WAITING: still_waiting,
}

EFFECTS: dict[Action, set[str]] = {
    Action.SEND_FIRST_BARRIER: {"barriers"},
    Action.SEND_BARRIER: {"barriers"},
    Action.SEND_BARRIER_AND_SKIP: {"barriers", "acknowledgements"},
    Action.RESEND_READINGS: {"barriers"},
    Action.ACKNOWLEDGE: {"acknowledgements"},
    Action.ACKNOWLEDGE_AGAIN: {"acknowledgements"},
    Action.SKIP: {"acknowledgements", "lines"},
    Action.ASK_PHYSICS: {"gateway asked for"},
    Action.ASK_FOR_SENSORS: {"sensors asked for"},
    Action.REPORT_RETURN: {"lines"},
    Action.WAIT: set(),
}


def seen(rig: Rig) -> dict[str, int]:
    by_gateway = rig.asked_for.count("gateway")
    return {
        "barriers": len(rig.link.barriers),
        "acknowledgements": len(rig.acks),
        "lines": len(rig.said),
        "gateway asked for": by_gateway,
        "sensors asked for": len(rig.asked_for) - by_gateway,
    }


@pytest.mark.parametrize(
    ("state", "event"), [(state, event) for state, row in TRANSITIONS.items() for event in row]
)
def test_every_row(state: LockstepState, event: Event) -> None:
    rig = Rig(SKIPPING)
    REACH[state](rig)
    assert rig.lockstep.state is state
    before = seen(rig)
    HAPPEN[event](rig)
    following, action = TRANSITIONS[state][event]
    assert rig.lockstep.state is following
    changed = {name for name, count in seen(rig).items() if count > before[name]}
    # A barrier that was sent long ago is also sent again.
    late = {Event.SILENCE, Event.STILL_WAITING, Event.OVERDUE}
    more = {"barriers", "gateway asked for"} if event in late else set()
    assert EFFECTS[action] <= changed <= EFFECTS[action] | more


def test_an_event_without_a_row_is_refused() -> None:
    for state, event in itertools.product(LockstepState, Event):
        machine = Machine()
        machine.state = state
        assert machine.expects(event) == (event in TRANSITIONS[state])
        if not machine.expects(event):
            with pytest.raises(KeyError):
                machine.take(event)
