# SPDX-License-Identifier: Apache-2.0
"""State machine of lockstep with ROS: every state, every event, and the action that follows.

An event that has no row for a state cannot occur in that state, or is not looked for there.
"""

from enum import Enum, auto


class LockstepState(Enum):
    """Where a run stands between physics and the ROS node."""

    START = auto()
    """Nothing was sent."""

    CONNECTING = auto()
    """The first barrier, which has no tick, was sent; the ROS node has not replied."""

    RUNNING = auto()
    """Physics steps to the next tick at which it waits for the gateway."""

    COLLECTING = auto()
    """Physics waits at a tick; readings of that tick are on their way to ROS."""

    BARRIER_SENT = auto()
    """The barrier of that tick was sent; the ROS node has not replied."""

    RUNNING_WITHOUT_ROS = auto()
    """As `RUNNING`, but the ROS node has missed its deadline and not replied since."""

    COLLECTING_WITHOUT_ROS = auto()
    """As `COLLECTING`, but the ROS node has missed its deadline and not replied since."""


class LockstepEvent(Enum):
    """What can happen."""

    OPENED = auto()
    """The link is open."""

    CLOCK = auto()
    """A clock message of a tick at which physics waits for the gateway."""

    ALL_SENT = auto()
    """All sensors have acknowledged the tick, and the link has sent all their readings."""

    REPLY = auto()
    """The ROS node is done, and its commands are here or their time limit is over."""

    NODE_RESTARTED = auto()
    """The ROS node was restarted and lacks what was sent before the barrier."""

    OVERDUE = auto()
    """No reply within `time.deadline_s`, in a run with `overload: skip`."""

    SILENCE = auto()
    """Nothing has come from the bus for some time: a message may be lost."""

    STILL_WAITING = auto()
    """Physics was asked and still waits for the acknowledgement of the newest known tick."""


class LockstepAction(Enum):
    """What follows from an event."""

    SEND_FIRST_BARRIER = auto()
    SEND_BARRIER = auto()
    SEND_BARRIER_AND_SKIP = auto()
    """Send the barrier, but acknowledge the tick without waiting for the reply."""

    RESEND_READINGS = auto()
    """Send the readings again that the barrier lists, then the barrier."""

    ACKNOWLEDGE = auto()
    """Publish the commands of the reply and acknowledge the tick to physics."""

    ACKNOWLEDGE_AGAIN = auto()
    """Repeat the last acknowledgement with its commands."""

    SKIP = auto()
    """Acknowledge the tick without commands of the ROS node."""

    ASK_PHYSICS = auto()
    """Ask physics where the run stands."""

    ASK_FOR_SENSORS = auto()
    """Ask physics how far those sensors are that the tick still lacks."""

    REPORT_RETURN = auto()
    """Print that the ROS node is responding again."""

    WAIT = auto()
    """Nothing."""


_S, _E, _A = LockstepState, LockstepEvent, LockstepAction

TRANSITIONS: dict[LockstepState, dict[LockstepEvent, tuple[LockstepState, LockstepAction]]] = {
    _S.START: {_E.OPENED: (_S.CONNECTING, _A.SEND_FIRST_BARRIER)},
    _S.CONNECTING: {
        _E.REPLY: (_S.RUNNING, _A.ASK_PHYSICS),
        _E.NODE_RESTARTED: (_S.CONNECTING, _A.RESEND_READINGS),
    },
    _S.RUNNING: {
        _E.CLOCK: (_S.COLLECTING, _A.WAIT),
        _E.SILENCE: (_S.RUNNING, _A.ASK_PHYSICS),
        _E.STILL_WAITING: (_S.RUNNING, _A.ACKNOWLEDGE_AGAIN),
    },
    _S.COLLECTING: {
        _E.CLOCK: (_S.COLLECTING, _A.WAIT),
        _E.ALL_SENT: (_S.BARRIER_SENT, _A.SEND_BARRIER),
        _E.SILENCE: (_S.COLLECTING, _A.ASK_PHYSICS),
        _E.STILL_WAITING: (_S.COLLECTING, _A.ASK_FOR_SENSORS),
    },
    _S.BARRIER_SENT: {
        _E.CLOCK: (_S.COLLECTING, _A.WAIT),
        _E.REPLY: (_S.RUNNING, _A.ACKNOWLEDGE),
        _E.NODE_RESTARTED: (_S.BARRIER_SENT, _A.RESEND_READINGS),
        _E.OVERDUE: (_S.RUNNING_WITHOUT_ROS, _A.SKIP),
    },
    _S.RUNNING_WITHOUT_ROS: {
        _E.CLOCK: (_S.COLLECTING_WITHOUT_ROS, _A.WAIT),
        _E.REPLY: (_S.RUNNING, _A.REPORT_RETURN),
        _E.NODE_RESTARTED: (_S.RUNNING_WITHOUT_ROS, _A.RESEND_READINGS),
        _E.SILENCE: (_S.RUNNING_WITHOUT_ROS, _A.ASK_PHYSICS),
        _E.STILL_WAITING: (_S.RUNNING_WITHOUT_ROS, _A.ACKNOWLEDGE_AGAIN),
    },
    _S.COLLECTING_WITHOUT_ROS: {
        _E.CLOCK: (_S.COLLECTING_WITHOUT_ROS, _A.WAIT),
        _E.ALL_SENT: (_S.RUNNING_WITHOUT_ROS, _A.SEND_BARRIER_AND_SKIP),
        _E.REPLY: (_S.COLLECTING, _A.REPORT_RETURN),
        _E.NODE_RESTARTED: (_S.COLLECTING_WITHOUT_ROS, _A.RESEND_READINGS),
        _E.SILENCE: (_S.COLLECTING_WITHOUT_ROS, _A.ASK_PHYSICS),
        _E.STILL_WAITING: (_S.COLLECTING_WITHOUT_ROS, _A.ASK_FOR_SENSORS),
    },
}

AWAITING_REPLY = frozenset({_S.START, _S.CONNECTING, _S.BARRIER_SENT})
"""States in which the run does not go on before the ROS node replies."""

STEPPING = frozenset({_S.RUNNING, _S.RUNNING_WITHOUT_ROS})
"""States in which physics steps."""

WITHOUT_ROS = frozenset({_S.RUNNING_WITHOUT_ROS, _S.COLLECTING_WITHOUT_ROS})
"""States in which the run goes on although the ROS node does not reply."""


class LockstepMachine:
    """The current state."""

    def __init__(self) -> None:
        self.state = LockstepState.START

    def expects(self, event: LockstepEvent) -> bool:
        """Return whether an event can occur now."""
        return event in TRANSITIONS[self.state]

    def take(self, event: LockstepEvent) -> LockstepAction:
        """Return what follows from an event, in the next state.

        Raises
        ------
        KeyError
            when the event cannot occur in this state.
        """
        self.state, action = TRANSITIONS[self.state][event]
        return action
