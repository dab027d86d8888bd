# SPDX-License-Identifier: Apache-2.0
"""A gateway in lockstep, between a bus and a ROS node that the test plays."""

from dataclasses import dataclass, field
from typing import Any

from msgspec.structs import replace

from groundlink.bus.inbox import BusInbox
from groundlink.core.clock import TICK_NANOS
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Ack, BusMessage, Clock, WheelEncoders, encode
from groundlink.scenario.schema import Time
from services.gateway.bus_session import RunStatus
from services.gateway.gateway import Gateway
from services.gateway.lockstep.lockstep import LIMIT_MS, Lockstep
from services.gateway.lockstep.reply_mailbox import ReplyMailbox
from udp_bridge.wire import control
from udp_bridge.wire.lockstep import DONE, Barrier, BarrierReply
from udp_bridge.wire.message import Message as WireMessage
from udp_bridge.wire.types import CONTROL, type_number

PEER = ("127.0.0.1", 7511)
RUN = "lab"
TWIST, CLOCK, ENCODERS, JOINTS = map(type_number, ("Twist", "Clock", "WheelEncoders", "JointState"))
COMMAND_KEY = "groundlink/lab/rover/command"
LAB = load(SHIPPED / "indoor_lab.yaml")
SENSORS = ("rover/lidar", "rover/imu", "rover/encoders", "rover/camera")
EPISODE = 77


class StandIn:
    """A link that keeps what it is given."""

    def __init__(self) -> None:
        self.sent: list[tuple[int, str, int, bytes]] = []
        self.counts: dict[tuple[int, str], int] = {}
        self.is_busy = False

    def send(self, msg_type: int, topic: str, _: str, stamp: int, body: Any, to: Any) -> None:
        assert to == PEER
        self.sent.append((msg_type, topic, stamp, bytes(body)))
        self.counts[msg_type, topic] = self.counts.get((msg_type, topic), 0) + 1

    def sent_counts(self, to: Any) -> dict[tuple[int, str], int]:
        return dict(self.counts)

    def flush(self, seconds: float) -> bool:
        assert 0 < seconds <= LIMIT_MS / 1e3, "the run stands still meanwhile"
        return not self.is_busy

    @property
    def barriers(self) -> list[Barrier]:
        found = [control.parse(body) for kind, _, _, body in self.sent if kind == CONTROL]
        return [said for said in found if isinstance(said, Barrier)]


@dataclass
class Rig:
    """A gateway in lockstep, between a bus and ROS that the test plays."""

    time: Time = field(default_factory=lambda: Time(mode="fast", lockstep="ros", epoch="zero"))
    resumed: RunStatus | None = None
    heard_of_sensors: Ack = field(default_factory=lambda: Ack(EPISODE, -1, -1))

    def __post_init__(self) -> None:
        scenario = replace(LAB, time=self.time)
        self.link: Any = StandIn()
        self.replies = ReplyMailbox()
        self.published: list[tuple[str, BusMessage]] = []
        self.acks: list[Ack] = []
        self.said: list[str] = []
        self.asked_for: list[str] = []
        self.now = 100.0
        self.gateway = Gateway(
            scenario,
            RUN,
            peer=PEER,
            publish=lambda key, message: self.published.append((key, message)),
            replies=self.replies,
        )
        self.lockstep = Lockstep(
            *(scenario, self.gateway, self.link, self.replies),
            acknowledge=self.acks.append,
            resume=self.resume,
            say=self.said.append,
        )
        self.inbox: BusInbox[BusMessage] = BusInbox(depth=64)

    def resume(self, process: str) -> RunStatus | None:
        self.asked_for.append(process)
        if process == "gateway" or self.resumed is None:
            return self.resumed
        return RunStatus(self.heard_of_sensors, self.resumed.state)

    def turn(self, seconds: float = 0.0) -> None:
        self.now += seconds
        if arrived := self.lockstep.listen(self.inbox):
            self.lockstep.handle(*arrived)
        self.lockstep.turn(self.now)

    def hear(self, key: str, message: BusMessage) -> None:
        self.inbox.put(f"groundlink/{RUN}/{key}", encode(message), type(message))
        self.turn()

    def clock(self, tick: int, episode: int = EPISODE) -> None:
        self.hear("clock", Clock(tick * TICK_NANOS, 0, tick, episode))

    def followed(self, tick: int, *names: str, episode: int = EPISODE) -> None:
        for name in names or SENSORS:
            self.hear(f"ack/{name}", Ack(episode, tick, tick))

    def measured(self, tick: int) -> None:
        reading = WheelEncoders(
            stamp_nanos=tick * TICK_NANOS, frame="base", names=("a",) * 4, ticks=(1,) * 4
        )
        self.hear("rover/encoders", reading)

    def says(self, tick: int, *, state: int = DONE, topic: str = "", **more: Any) -> None:
        episode = 0 if tick < 0 else more.pop("episode", EPISODE)
        self.gateway.on_message(
            self.of_ros(BarrierReply(episode, tick, state, **more), topic), PEER
        )
        self.turn()

    @staticmethod
    def of_ros(reply: BarrierReply, topic: str = "") -> WireMessage:
        return WireMessage(CONTROL, topic, "", 0, 0, reply.pack())

    def commands(self, number: int) -> None:
        twist = b"\0\1\0\0" + bytes(48)
        self.gateway.on_message(WireMessage(TWIST, "/cmd_vel", "", 5, number, twist), PEER)
