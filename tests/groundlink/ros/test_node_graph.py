# SPDX-License-Identifier: Apache-2.0
"""The graph of ROS nodes: what answers what, and which graphs are refused."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.ros.node_graph import Answer, answers, graph_mistake, origins, publishers
from groundlink.scenario.ros_side import RosNode
from groundlink.scenario.schema import Time

SOURCES = ("/clock", "/odom", "/scan")


def node(name: str, *consumes: str, to: str, every: int = 1, joins: bool = False) -> RosNode:
    return RosNode(
        name=name, consumes=consumes, publishes=tuple(to.split()), every=every, joins=joins
    )


STACK = (
    node("filter", "/odom", to="/filtered", every=2),
    node("planner", "/filtered", "/obstacles", to="/path"),
    node("detector", "/scan", to="/obstacles /image"),
    node("controller", "/path", to="/cmd_vel"),
)


def test_each_output_answers_each_input() -> None:
    assert answers(STACK) == (
        Answer("/filtered", "/odom", 2, False),
        Answer("/path", "/filtered", 1, False),
        Answer("/path", "/obstacles", 1, False),
        Answer("/obstacles", "/scan", 1, False),
        Answer("/image", "/scan", 1, False),
        Answer("/cmd_vel", "/path", 1, False),
    )
    assert graph_mistake(STACK, SOURCES) == ""


def test_the_sources_of_each_topic() -> None:
    found = origins(STACK, SOURCES)
    assert found["/cmd_vel"] == found["/path"] == {"/odom", "/scan"}
    assert found["/image"] == {"/scan"}
    assert list(found).index("/filtered") < list(found).index("/path")


def test_publishers_come_after_the_publishers_of_what_they_consume() -> None:
    found = list(publishers(STACK).items())
    assert found[-2:] == [("/path", "planner"), ("/cmd_vel", "controller")]
    assert dict(found[:-2]) == {
        "/filtered": "filter",
        "/obstacles": "detector",
        "/image": "detector",
    }


@given(st.permutations(STACK))
def test_the_order_of_the_list_does_not_matter(nodes: list[RosNode]) -> None:
    assert graph_mistake(nodes, SOURCES) == ""
    assert origins(nodes, SOURCES) == origins(STACK, SOURCES)


JOINED = node("fusion", "/odom", "/filtered", to="/pose", joins=True)


@pytest.mark.parametrize(
    ("nodes", "mistake"),
    [
        ((node("a", "/odmo", to="/x"),), "`a` consumes /odmo, which no node publishes.*/odom"),
        ((node("a", "/odom", to="/scan"),), "`a` publishes /scan, which the gateway sends"),
        ((node("a", "/odom", to="/x"), node("b", "/scan", to="/x")), "/x is published by several"),
        ((node("a", "/odom", "/y", to="/x"), node("b", "/x", to="/y")), "^/x, /y form a loop"),
        ((node("a", "/x", to="/x"),), "^/x form a loop"),
        (
            (*STACK, node("both", "/scan", "/path", to="/status")),
            "`both` consumes /scan and /path, both caused by /scan, in either order",
        ),
        (
            (*STACK, node("two", "/scan", to="/a"), node("two", "/path", to="/b")),
            "`two` consumes /scan and /path, both caused by /scan",
        ),
    ],
)
def test_graphs_whose_order_is_not_known_are_refused(
    nodes: tuple[RosNode, ...], mistake: str
) -> None:
    assert re.search(mistake, graph_mistake(nodes, SOURCES))


def test_a_node_that_joins_by_stamps_may_get_one_message_on_two_paths() -> None:
    nodes = (*STACK, JOINED)
    assert graph_mistake(nodes, SOURCES) == ""
    assert answers(nodes)[-1] == Answer("/pose", "/filtered", 1, True)


@pytest.mark.parametrize("more", [{"every": 2}, {"consumes": ("/odom",)}])
def test_joining_takes_two_inputs_and_each_of_them(more: dict[str, object]) -> None:
    fields = {"name": "a", "consumes": ("/odom", "/scan"), "publishes": ("/x",), "joins": True}
    with pytest.raises(ValueError, match="`joins` needs at least two topics"):
        RosNode(**fields | more)  # type: ignore[arg-type]


def test_nodes_are_given_instead_of_answers() -> None:
    with pytest.raises(ValueError, match="`answers` and `nodes` are both given"):
        Time(answers={"/cmd_vel": "/odom"}, nodes=STACK)
