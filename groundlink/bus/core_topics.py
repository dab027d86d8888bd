# SPDX-License-Identifier: Apache-2.0
"""Topics of every run, whatever its sensors: states, clock, commands, acknowledgements, health.

`topics` adds those of sensors, ground truth and ROS. A process that carries no stream of a sensor
loads this module alone.
"""

from dataclasses import dataclass, replace
from enum import Enum

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.messages.base import Ack, BusMessage, Clock, Command, Health, State, StateBatch

ROOT = "groundlink"

ROUTER_KEY = f"{ROOT}/router"
"""Liveliness token of a router: whoever sees it is reached by the router."""

PHYSICS, GATEWAY, RECORDER = "physics", "gateway", "recorder"
"""Names of processes of which a run has one."""

REPLAY = "replay"
"""The process that stands for physics, sensors and drivers of a recorded run."""

TIME_KEEPERS = (PHYSICS, REPLAY)
"""Processes of which a run has one: it says what time it is."""


class Delivery(Enum):
    """What happens when a receiver cannot keep up."""

    NEWEST = "newest"
    """The sender never waits; the receiver sees a gap in ticks and counts it."""

    ALL = "all"
    """The sender waits for room."""


@dataclass(frozen=True)
class BusTopic:
    """A kind of stream."""

    name: str
    key: str
    """Under `groundlink/<run>/`; words in braces are filled in."""

    message: type[BusMessage]
    publisher: str
    rate: str
    delivery: Delivery
    bulky: bool = False
    """Its messages are so large that small ones should not wait behind them."""

    local: bool = False
    """Processes of one machine pass its messages without the router (see `local_stream`)."""

    def key_in(self, run: str, **names: str) -> str:
        """Return the full key expression in a run; names left out become `*`."""
        fields = {"vehicle": "*", "sensor": "*", "process": "**", "topic": "**"} | names
        return f"{ROOT}/{run}/{self.key.format(**fields)}"


STATE = BusTopic(
    *("state", "state", State, "physics", f"{TICK_RATE_HZ} Hz", Delivery.NEWEST), local=True
)
FREQUENT_HZ = 50.0
"""Rate above which a stream is frequent. In real time, sensors with frequent readings get each
state at once."""


def is_passed_locally(time_mode: str, rate_hz: float, *, bulky: bool) -> bool:
    """Return whether processes of one machine pass readings without the router.

    Where physics waits for others, the router keeps the order of all messages.
    """
    return time_mode == "realtime" and (bulky or rate_hz > FREQUENT_HZ)


BATCH_TICKS = 4
"""Ticks between two batches of states: 10 ms. Half as many would save half as much. Without a wall
clock batches are larger."""

STATE_BATCH = BusTopic(
    # A chunk with an @ matches no wildcard: who subscribes to all keys gets each state once.
    *("state.batch", "state/@batch", StateBatch, "physics"),
    *(f"{TICK_RATE_HZ // BATCH_TICKS} Hz", Delivery.NEWEST),
    local=True,
)
CLOCK = replace(STATE, name="clock", key="clock", message=Clock, rate="time.clock_rate_hz")
COMMAND = BusTopic(
    "command", "{vehicle}/command", Command, "gateway, driver", "as ROS sends, 50 Hz", Delivery.ALL
)
ACK = BusTopic("ack", "ack/{process}", Ack, "every sensor, gateway", "8 Hz", Delivery.ALL)
HEALTH = BusTopic("health", "health/{process}", Health, "every process", "1 Hz", Delivery.ALL)
