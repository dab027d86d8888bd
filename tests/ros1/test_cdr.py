# SPDX-License-Identifier: Apache-2.0
"""CDR and ROS 1's bytes of every type of the wire, against rosbags, which does it another way."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype

from groundlink.recording.ros1 import NOETIC, to_ros1
from groundlink.ros.types import STORE
from udp_bridge.wire.types import NUMBER_OF_ROS_TYPE
from udp_bridge_ros1.cdr import ConversionPlan, MalformedMessage

TYPES = sorted(NUMBER_OF_ROS_TYPE)
PLANS = {name: ConversionPlan(NOETIC.generate_msgdef(name, ros_version=1)[0]) for name in TYPES}
ADDED_BYTES = {"sensor_msgs/msg/Range": 4}
"""What ROS 2 has at a type's end and ROS 1 has not."""
INTEGERS = {f"{u}int{bits}": (u, bits) for u in ("", "u") for bits in (8, 16, 32, 64)}
TEXTS = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=12)


@cache
def primitives(name: str) -> st.SearchStrategy[Any]:
    if name == "string":
        return TEXTS
    if name == "bool":
        return st.booleans()
    if name.startswith("float"):
        return st.floats(width=int(name[5:]), allow_nan=False)
    unsigned, bits = INTEGERS[name]
    return (
        st.integers(0, 2**bits - 1)
        if unsigned
        else st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    )


def numbers(name: str, draw: st.DrawFn, count: int) -> Any:
    dtype = np.dtype(name)
    data = draw(st.binary(min_size=count * dtype.itemsize, max_size=count * dtype.itemsize))
    if name == "bool":
        data = bytes(byte & 1 for byte in data)
    return np.frombuffer(data, dtype)


@cache
@st.composite
def messages(draw: st.DrawFn, name: str) -> Any:
    """Return any message of a type of ROS 2."""
    values = {}
    for field, (kind, what) in STORE.fielddefs[name][1]:
        if kind in (Nodetype.BASE, Nodetype.NAME):
            values[field] = draw(one(kind, what))
            continue
        (inner, element), count = what
        if kind == Nodetype.SEQUENCE:
            count = draw(st.integers(0, 3))
        if inner == Nodetype.BASE and element[0] != "string":
            values[field] = numbers(element[0], draw, count)
        else:
            values[field] = [draw(one(inner, element)) for _ in range(count)]
    return STORE.types[name](**values)


@cache
def one(kind: Nodetype, what: Any) -> st.SearchStrategy[Any]:
    if kind == Nodetype.BASE:
        return primitives(what[0])
    if what in ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
        return st.builds(STORE.types[what], sec=primitives("int32"), nanosec=primitives("uint32"))
    return messages(what)


@pytest.mark.parametrize("name", TYPES)
@settings(max_examples=25)
@given(data=st.data())
def test_both_ways_are_rosbags_to_the_byte(name: str, data: st.DataObject) -> None:
    cdr = bytes(STORE.serialize_cdr(data.draw(messages(name)), name))
    ros1 = bytes(to_ros1(name, cdr))
    plan = PLANS[name]
    assert b"".join(plan.to_ros1(cdr)) == ros1
    back = plan.to_cdr(ros1)
    assert cdr.startswith(back)
    assert len(cdr) - len(back) == ADDED_BYTES.get(name, 0)
    for cut in (len(back) - 1, len(back) // 2, 5):
        with pytest.raises(MalformedMessage):
            plan.to_ros1(cdr[:cut])
    for wrong in (ros1[:-1], ros1 + b"\0"):
        with pytest.raises(MalformedMessage):
            plan.to_cdr(wrong)
