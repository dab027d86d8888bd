# SPDX-License-Identifier: Apache-2.0
"""Every row of lockstep's table: the state is reached, the event happens, the action follows."""

import itertools
from collections.abc import Callable

import pytest

from groundlink.core.backoff import FIRST_SECONDS
from groundlink.core.clock import TICK_NANOS
from groundlink.messages.base import Ack, State
from groundlink.scenario.schema import Time
from services.gateway.bus_session import RunStatus
from services.gateway.lockstep.states import (
    TRANSITIONS,
    LockstepAction,
    LockstepEvent,
    LockstepMachine,
    LockstepState,
)
from udp_bridge.wire.lockstep import RESTARTED

from .rig import EPISODE, RUN, Rig

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
    LockstepState.BARRIER_SENT: ask,
    LockstepState.RUNNING_WITHOUT_ROS: run_without_ros,
    LockstepState.COLLECTING_WITHOUT_ROS: collect_without_ros,
}


def still_waiting(rig: Rig) -> None:
    tick = rig.lockstep.tick
    state = State(RUN, EPISODE, 0, tick, tick * TICK_NANOS, "", {})
    rig.resumed = RunStatus(Ack(EPISODE, -1, -1), state)
    rig.turn(FIRST_SECONDS + 0.1)
    rig.turn()


HAPPEN: dict[LockstepEvent, Callable[[Rig], None]] = {
    LockstepEvent.OPENED: lambda rig: rig.turn(),
    LockstepEvent.CLOCK: lambda rig: rig.clock(rig.lockstep.tick + 4),
    LockstepEvent.ALL_SENT: lambda rig: rig.followed(rig.lockstep.tick),
    LockstepEvent.REPLY: lambda rig: rig.says(rig.link.barriers[-1].tick),
    LockstepEvent.NODE_RESTARTED: lambda rig: rig.says(rig.link.barriers[-1].tick, state=RESTARTED),
    LockstepEvent.OVERDUE: lambda rig: rig.turn(OVERDUE_SECONDS),
    LockstepEvent.SILENCE: lambda rig: rig.turn(FIRST_SECONDS + 0.1),
    LockstepEvent.STILL_WAITING: still_waiting,
}

EFFECTS: dict[LockstepAction, set[str]] = {
    LockstepAction.SEND_FIRST_BARRIER: {"barriers"},
    LockstepAction.SEND_BARRIER: {"barriers"},
    LockstepAction.SEND_BARRIER_AND_SKIP: {"barriers", "acknowledgements"},
    LockstepAction.RESEND_READINGS: {"barriers"},
    LockstepAction.ACKNOWLEDGE: {"acknowledgements"},
    LockstepAction.ACKNOWLEDGE_AGAIN: {"acknowledgements"},
    LockstepAction.SKIP: {"acknowledgements", "lines"},
    LockstepAction.ASK_PHYSICS: {"gateway asked for"},
    LockstepAction.ASK_FOR_SENSORS: {"sensors asked for"},
    LockstepAction.REPORT_RETURN: {"lines"},
    LockstepAction.WAIT: set(),
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
def test_every_row(state: LockstepState, event: LockstepEvent) -> None:
    rig = Rig(SKIPPING)
    REACH[state](rig)
    assert rig.lockstep.state is state
    before = seen(rig)
    HAPPEN[event](rig)
    following, action = TRANSITIONS[state][event]
    assert rig.lockstep.state is following
    changed = {name for name, count in seen(rig).items() if count > before[name]}
    # A barrier that was sent long ago is also sent again.
    late = {LockstepEvent.SILENCE, LockstepEvent.STILL_WAITING, LockstepEvent.OVERDUE}
    more = {"barriers", "gateway asked for"} if event in late else set()
    assert EFFECTS[action] <= changed <= EFFECTS[action] | more


def test_an_event_without_a_row_is_refused() -> None:
    for state, event in itertools.product(LockstepState, LockstepEvent):
        machine = LockstepMachine()
        machine.state = state
        assert machine.expects(event) == (event in TRANSITIONS[state])
        if not machine.expects(event):
            with pytest.raises(KeyError):
                machine.take(event)
