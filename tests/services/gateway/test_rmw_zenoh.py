# SPDX-License-Identifier: Apache-2.0
"""Keys, tokens and attachments by rmw_zenoh's own examples; then a session in a node's place."""

import struct
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh
import zenoh.ext
from msgspec.structs import replace

from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.loader import load as load_scenario
from groundlink.loader.scenario_files import SHIPPED
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario.ros_side import RmwZenoh
from services.gateway.carrier import rmw_zenoh as native_of
from services.gateway.gateway import Gateway
from services.gateway.rmw_zenoh import (
    QOS,
    QOS_LATCHED,
    SUBSCRIBER,
    NoRmwZenohBridge,
    RmwZenohBridge,
    attachment,
    data_key,
    endpoint_token,
    node_token,
    type_hash_of,
)
from tests.udp_bridge.vectors import load
from udp_bridge import Message, Reassembler

STRING = "std_msgs/msg/String"
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
SESSION = "aac3178e146ba6f1fc6e6a4085e77f21"
IMU, TF_STATIC, CMD_VEL = (2, "/rover/imu"), (35, "/tf_static"), (9, "/rover/cmd_vel")


def test_keys_are_those_of_the_design_document() -> None:
    assert type_hash_of(STRING) == STRING_HASH
    key = f"0/chatter/std_msgs::msg::dds_::String_/{STRING_HASH}"
    assert data_key(0, "/chatter", STRING, STRING_HASH) == key
    assert data_key(7, "/a/b", STRING, "*") == "7/a/b/std_msgs::msg::dds_::String_/*"


def test_tokens_are_those_of_the_design_document() -> None:
    node = f"@ros2_lv/2/{SESSION}/0/0/NN/%/%/listener"
    assert node_token(2, SESSION, "listener") == node
    token = endpoint_token(
        2, SESSION, 10, SUBSCRIBER, "/chatter", STRING, STRING_HASH, node="listener"
    )
    assert token == (
        f"@ros2_lv/2/{SESSION}/0/10/MS/%/%/listener/%chatter/"
        f"std_msgs::msg::dds_::String_/{STRING_HASH}/::,10:,:,:,,"
    )


def test_an_attachment_is_what_zenoh_makes_of_the_three() -> None:
    gid = bytes(range(16))
    three = zenoh.ext.Int64(1), zenoh.ext.Int64(-2), gid
    assert attachment(1, -2, gid) == zenoh.ext.z_serialize(three).to_bytes()
    assert len(attachment(1, 2, gid)) == 33


@pytest.fixture
def router() -> Iterator[str]:
    """A router in the place of rmw_zenohd."""
    endpoint = free_endpoint()
    with Bus(listen=endpoint):
        yield endpoint


@pytest.fixture
def node(router: str) -> Iterator[zenoh.Session]:
    """A session as a node of rmw_zenoh has it."""
    configuration = zenoh.Config()
    configuration.insert_json5("mode", '"client"')
    configuration.insert_json5("connect/endpoints", f'["{router}"]')
    configuration.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(configuration)
    yield session
    session.close()  # type: ignore[no-untyped-call]


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def tokens(node: zenoh.Session, key: str) -> list[str]:
    """Return the liveliness keys that are there."""
    replies = node.liveliness().get(key, timeout=5.0)
    return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)


def test_native_node_discovers_receives_and_is_received(router: str, node: zenoh.Session) -> None:
    imu = Reassembler().receive(load("imu").datagrams[0], "", 0)
    assert imu is not None
    cdr = memoryview(bytes(imu.body))
    came: list[zenoh.Sample] = []
    latched: list[bytes] = []
    imu_key = data_key(3, IMU[1], "sensor_msgs/msg/Imu", type_hash_of("sensor_msgs/msg/Imu"))
    tf_type = "tf2_msgs/msg/TFMessage"
    tf_key = data_key(3, TF_STATIC[1], tf_type, type_hash_of(tf_type))
    node.declare_subscriber(imu_key, came.append)
    with Bus(connect=router, foreign=True) as bus:
        bridge = RmwZenohBridge(
            bus, RmwZenoh(connect=router, domain_id=3), [IMU, TF_STATIC], [CMD_VEL], [TF_STATIC]
        )
        assert bridge.offers(IMU)
        assert not bridge.offers(CMD_VEL)
        bridge.publish((1, "/points"), 5, cdr)  # goes elsewhere
        for _ in range(3):
            bridge.publish(TF_STATIC, 5, memoryview(b"the transforms"))

        def heard() -> bool:
            bridge.publish(IMU, 5, cdr)
            return len(came) >= 2

        wait_for(heard)
        first, second = came[:2]
        assert first.payload.to_bytes() == cdr
        assert first.attachment is not None
        assert second.attachment is not None
        sequence, stamp, size, gid = struct.unpack("<qqB16s", first.attachment.to_bytes())
        assert (stamp, size) == (5, 16)
        assert second.attachment.to_bytes() == attachment(sequence + 1, 5, gid)

        zenoh.ext.declare_advanced_subscriber(  # who comes late
            node,
            tf_key,
            lambda sample: latched.append(sample.payload.to_bytes()),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1),
        )
        wait_for(lambda: latched)
        assert latched == [b"the transforms"]

        rows = [(IMU, "sensor_msgs/msg/Imu", "MP", QOS), (TF_STATIC, tf_type, "MP", QOS_LATCHED)]
        rows += [(CMD_VEL, "geometry_msgs/msg/Twist", "MS", QOS)]
        assert tokens(node, "@ros2_lv/3/**") == sorted(
            [node_token(3, bus.identity)]
            + [
                endpoint_token(3, bus.identity, i, kind, place[1], of, type_hash_of(of), qos=qos)
                for i, (place, of, kind, qos) in enumerate(rows, 1)
            ]
        )

        twist = "3/rover/cmd_vel/geometry_msgs::msg::dds_::Twist_/TypeHashNotSupported"
        arrived: list[Message] = []

        def is_heard() -> bool:
            node.put(twist, b"a twist", attachment=attachment(1, 0, gid))
            arrived.extend(bridge.arrived())
            return bool(arrived)

        wait_for(is_heard)
        assert (arrived[0].msg_type, arrived[0].topic) == CMD_VEL
        assert arrived[0].body == b"a twist"


def test_humble_has_no_hashes(router: str, node: zenoh.Session) -> None:
    with Bus(connect=router, foreign=True) as bus:
        RmwZenohBridge(bus, RmwZenoh(connect=router, type_hashes=False), [IMU], [])
        wait_for(lambda: tokens(node, "@ros2_lv/0/*/0/1/**"))
        (token,) = tokens(node, "@ros2_lv/0/*/0/1/**")
    assert token.split("/")[-2] == "TypeHashNotSupported"


def test_without_the_option_nothing_is_there() -> None:
    stand_in = NoRmwZenohBridge()
    stand_in.publish(IMU, 0, memoryview(b""))
    assert not stand_in.offers(IMU)
    assert not list(stand_in.arrived())


def test_a_scenario_has_it_or_not(router: str) -> None:
    def native(settings: RmwZenoh | None) -> type:
        shipped = load_scenario(SHIPPED / "indoor_lab.yaml")
        scenario = replace(shipped, gateway=replace(shipped.gateway, rmw_zenoh=settings))
        gateway = Gateway(scenario, "lab", peer=("127.0.0.1", 1), publish=lambda *_: None)
        with native_of(scenario, gateway):
            assert gateway.native.offers((2, "/imu")) == (settings is not None)
        return type(gateway.native)

    assert native(None) is NoRmwZenohBridge
    assert native(RmwZenoh(connect=router)) is RmwZenohBridge
    with pytest.raises(UserError, match=r"`gateway.rmw_zenoh.connect`: `here`: not an endpoint"):
        native(RmwZenoh(connect="here"))
