# SPDX-License-Identifier: Apache-2.0
"""World queries change an episode between two ticks, and its journal repeats them to the bit."""

from collections.abc import Callable, Iterator
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.episode.control import WorldChange
from groundlink.episode.journal import dumped, loaded
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import Command, State, decode, floats
from groundlink.scenario import Scenario
from groundlink.scenario.schema import NamedPose, PoseBox, Time
from groundlink.world.actors import Actor, CrateForm, EntityDescription, PathMotion
from services.physics.run.episode import Episode
from services.physics.run.publishers import silent_publishers
from services.physics.run.restore import Restoration
from services.physics.run.world_loading import WorldSource
from services.physics.run.world_queries import WorldQueryAnswers

T = TypeVar("T")
WALKER = Actor(
    name="walker",
    form=CrateForm(material="linoleum"),
    motion=PathMotion(points_m=((-2.0, 1.5), (2.0, 1.5))),
)
PACER = """
name: pacer
materials: {red: {}}
actors:
  - name: pacer
    form: {kind: crate, material: red}
    motion: {kind: along, points_m: [[0, 1], [1, 1]]}
"""

BOX = (
    "name: a\nmaterials: {m: {}}\nsolids: [{name: b, material: m, position_m: [-4.6, 0, 0], shape: "
)
NO_MESH = BOX + "{kind: mesh, file: no.stl}}]"
BLOCKED = BOX + "{kind: box, size_m: [1, 1, 1]}}]"


def scenario() -> Scenario:
    lab = load(SHIPPED / "indoor_lab.yaml")
    world = replace(
        lab.world,
        actors=(WALKER,),
        poses={
            "dock": NamedPose(
                position_m=(1.0, 0.5, 0.0),
                yaw_deg=90.0,
                tags=("parking",),
                box=PoseBox(low_m=(-1.0, -1.0, 0.0), high_m=(1.0, 1.0, 1.0)),
            )
        },
        entities={"rover": EntityDescription(description="under test", tags=("ego",))},
    )
    return replace(lab, world=world, time=Time("fast"))


LAB = scenario()


def episode_of(scenario: Scenario, number: int = 5, epoch: int | None = None) -> Episode:
    made = Episode(
        *(scenario, "run", silent_publishers()),
        required=(),
        wall_nanos=number,
        epoch_nanos=epoch,
    )
    made.begin(number, 0.0)
    return made


class Run:
    """A run without a bus: its episode, and queries of it."""

    def __init__(self) -> None:
        self.episode = episode_of(LAB)
        self.first_scenario = self.as_loaded = LAB
        self.world_source = WorldSource()
        self.is_restoring = False
        self._answers = WorldQueryAnswers(self)

    def refuse_while_restoring(self) -> None:
        if self.is_restoring:
            raise UserError("the run is being restored")

    def between_ticks(self, do: Callable[[], T], *, seconds: float = 0.0) -> T:
        return do()

    def known_worlds(self) -> dict[str, Scenario]:
        return self.episode.worlds

    def load(self, scenario: Scenario, source: WorldSource) -> None:
        self.episode.end()
        self.episode = episode_of(scenario)
        self.as_loaded, self.world_source = scenario, source

    def change(self, command: WorldChange) -> None:
        self.episode.change(command)

    def reset(self) -> None:
        raise AssertionError("the server's")

    def reset_all(self) -> None:
        raise AssertionError("the server's")

    def reset_state(self) -> None:
        self.episode.reset_state()

    def ask(self, query: str, **fields: object) -> dict[str, Any]:
        content = msgspec.json.encode({"query": query, **fields})
        [answer] = self._answers.answer("", content)
        found: dict[str, Any] = msgspec.json.decode(answer)
        return found

    def entity(self, name: str) -> dict[str, Any]:
        [found] = self.ask("entities", name=name)["entities"]
        return dict(found)

    def names(self) -> set[str]:
        return {entity["name"] for entity in self.ask("entities")["entities"]}

    def step(self, ticks: int) -> None:
        for _ in range(ticks):
            self.episode.step()

    def state(self) -> State:
        return decode(self.episode._history[-1], State)


@pytest.fixture
def run() -> Iterator[Run]:
    made = Run()
    yield made
    made.episode.end()


@pytest.fixture(scope="module")
def untouched() -> Iterator[Run]:
    """A run for queries that change nothing."""
    made = Run()
    yield made
    made.episode.end()


def test_entities_are_vehicles_actors_and_groups_of_solids(run: Run) -> None:
    run.step(3)
    answer = run.ask("entities")
    assert answer["tick"] == 3
    assert answer["stamp_nanos"] == run.episode.epoch_nanos + 3 * TICK_NANOS
    found = {entity["name"]: entity for entity in answer["entities"]}
    rover, walker, room = found["rover"], found["walker"], found["room"]
    assert (rover["category"], rover["description"], rover["tags"]) == (
        *("robot", "under test"),
        ["ego"],
    )
    assert rover["high_m"][0] - rover["low_m"][0] == pytest.approx(0.99, abs=0.1)
    assert rover["low_m"][2] == pytest.approx(-0.1651, abs=1e-6), "wheels reach the ground"
    assert not rover["is_static"]
    assert (walker["category"], walker["is_static"]) == ("dynamic_object", False)
    assert walker["linear_mps"] == pytest.approx([1.2, 0.0, 0.0], abs=1e-9)
    assert (room["category"], room["is_static"]) == ("static_object", True)
    assert not [name for name in found if name.startswith(("room_", "wall_"))]
    assert len(found) > 20, "furniture and clutter"
    assert rover["linear_mps2"] != [0.0, 0.0, 0.0]


def test_a_spawned_object_is_one_entity_where_it_was_put(run: Run) -> None:
    at = [0.5, 1.0, 0.0]
    turned = [0.0, 0.0, 0.6, 0.8]
    answer = run.ask("spawn", uri="person", name="tom", position_m=at, orientation=turned)
    assert answer == {"tick": 1, "stamp_nanos": answer["stamp_nanos"], "name": "tom"}
    tom = run.entity("tom")
    assert (tom["category"], tom["is_static"]) == ("human", True)
    assert tom["position_m"] == pytest.approx(at)
    assert tom["orientation"] == pytest.approx(turned)
    assert tom["high_m"][2] - tom["low_m"][2] == pytest.approx(1.75, abs=0.02)
    moved = [1.0, -0.5, 0.0]
    assert "error" not in run.ask("place", name="tom", position_m=moved)
    assert run.entity("tom")["position_m"] == pytest.approx(moved)
    assert run.entity("tom")["orientation"] == pytest.approx(turned)
    assert run.entity("tom")["high_m"] == pytest.approx(tom["high_m"])
    assert run.ask("place", name="tom", linear_mps=[1.0, 0.0, 0.0])["code"] == "failed"
    run.ask("remove", name="tom")
    assert run.ask("entities", name="tom")["code"] == "not_found"


def test_removing_an_object_keeps_others_whose_names_begin_alike(run: Run) -> None:
    run.ask("spawn", uri="box", name="box", position_m=[1.0, 0.5, 0.0])
    run.ask("spawn", uri="box", name="box_b", position_m=[2.0, 0.5, 0.0])
    others = run.names() - {"box"}
    run.ask("remove", name="box")
    assert run.names() == others


def test_a_vehicle_is_placed_exactly_and_goes_on_from_there(run: Run) -> None:
    run.step(20)
    x, y, z = run.entity("rover")["position_m"]
    half = sqrt(0.5)
    pose = {"position_m": [x + 1.0, y, z + 0.3], "orientation": [0.0, 0.0, half, half]}
    twist = {"linear_mps": [0.0, 0.5, 0.1], "angular_radps": [0.1, -0.2, 0.3]}
    answer = run.ask("place", name="rover", **pose, **twist)
    assert answer["tick"] == run.episode.tick + 1
    there = run.entity("rover")
    for field, value in {**pose, **twist}.items():
        assert there[field] == pytest.approx(value, abs=1e-9), field
    run.step(1)
    after = run.entity("rover")
    assert after["position_m"] == pytest.approx([x + 1.0, y + 0.5 / 400, z + 0.3], abs=3e-4)
    assert after["linear_mps"][:2] == pytest.approx([0.0, 0.5], abs=5e-3), "nothing holds it"
    speeds = floats(run.state().vehicles["rover"].joint_velocities)
    assert 0.4 * 0.5 / 0.1651 < speeds.min(), "its wheels roll along, though motors brake them"
    run.step(400)
    rest = run.state().vehicles["rover"]
    assert np.isfinite(np.frombuffer(rest.link_poses)).all()
    assert rest.poses()[0][2] == pytest.approx(z, abs=2e-3), "it has landed"


def test_a_pose_in_the_ground_is_raised_and_one_in_a_wall_refused(run: Run) -> None:
    run.ask("place", name="rover", position_m=[0.0, 0.0, 0.0])
    assert run.entity("rover")["position_m"] == pytest.approx([0.0, 0.0, 0.1651], abs=1e-6)
    for at in ([6.0, 0.0, 0.2], [50.0, 0.0, 0.2], [1e7, 0.0, 0.0]):
        refusal = run.ask("place", name="rover", position_m=at)
        assert refusal["code"] == "invalid_pose", at
        assert "Fix: " in refusal["error"]
        assert "\n" not in refusal["error"]
    assert run.ask("place", name="rover", orientation=[0, 0, 0, 0])["code"] == "invalid_pose"
    same = run.entity("rover")
    assert "error" not in run.ask(
        "place", name="rover", position_m=same["position_m"], orientation=same["orientation"]
    )


def test_a_pose_may_be_relative_to_an_entity(run: Run) -> None:
    run.ask("spawn", uri="crate", name="crate", position_m=[0.0, 1.0, 0.0])
    run.ask("place", name="crate", position_m=[1.5, 0.0, -0.1651], frame="rover")
    rover, crate = run.entity("rover"), run.entity("crate")
    ahead = np.subtract(crate["position_m"], rover["position_m"])
    assert ahead == pytest.approx([1.5, 0.0, -0.1651], abs=1e-6)


@pytest.mark.parametrize(
    ("query", "fields", "code"),
    [
        ("place", {"name": "walker", "position_m": [0, 0, 0]}, "failed"),
        ("place", {"name": "room", "position_m": [0, 0, 0]}, "failed"),
        ("place", {"name": "nobody"}, "not_found"),
        ("remove", {"name": "nobody"}, "not_found"),
        ("remove", {"name": "rover"}, "failed"),
        ("remove", {"name": "room"}, "failed"),
        ("describe", {"name": "nobody"}, "not_found"),
        ("reset", {"scopes": ["time"]}, "unsupported"),
        ("spawn", {}, "no_resource"),
        ("spawn", {"uri": "rovr"}, "not_found"),
        ("spawn", {"uri": "/tmp/no_such_file.yaml"}, "not_found"),
        ("spawn", {"uri": "model.sdf"}, "unsupported_format"),
        ("spawn", {"text": "<sdf/>"}, "unsupported_format"),
        ("spawn", {"text": "name: [1"}, "parse_error"),
        ("spawn", {"text": "drive: {kind: hover}"}, "parse_error"),
        ("spawn", {"uri": "box", "name": "My Box"}, "name_invalid"),
        ("spawn", {"uri": "box", "name": "clock"}, "name_invalid"),
        ("spawn", {"uri": "box", "name": "rover"}, "name_taken"),
        ("spawn", {"uri": "rover", "name": "b", "namespace": "a b"}, "namespace_invalid"),
        ("spawn", {"uri": "crate", "position_m": [6.0, 0, 0]}, "invalid_pose"),
        ("spawn", {"uri": "crate", "orientation": [0, 0, 0, 0]}, "invalid_pose"),
        ("spawn", {"uri": "crate", "frame": "nobody"}, "not_found"),
        ("spawn", {"text": PACER, "orientation": [0.0, 0.6, 0.0, 0.8]}, "failed"),
        ("load_world", {}, "no_resource"),
        ("load_world", {"uri": "yrd"}, "not_found"),
        ("load_world", {"uri": "/tmp/no_such_file.yaml"}, "not_found"),
        ("load_world", {"uri": "world.sdf"}, "unsupported_format"),
        ("load_world", {"text": "<sdf/>"}, "unsupported_format"),
        ("load_world", {"text": "name: [1"}, "parse_error"),
        ("load_world", {"text": "name: a\nmaterials: {red: {colour: 1}}"}, "parse_error"),
        ("load_world", {"text": NO_MESH}, "missing_assets"),
        ("load_world", {"uri": str(SHIPPED / "vehicles" / "rover.yaml")}, "parse_error"),
        ("load_world", {"text": BLOCKED}, "failed"),
        ("load_world", {"text": "name: a\nmaterials: {}"}, "failed"),
        ("dance", {}, "unsupported"),
        ("remove", {}, "failed"),
    ],
)
def test_refusals_have_a_code_and_one_line(
    untouched: Run, query: str, fields: dict[str, object], code: str
) -> None:
    before = untouched.names()
    refusal = untouched.ask(query, **fields)
    assert refusal["code"] == code, refusal
    assert "\n" not in refusal["error"]
    assert "/tmp/tmp" not in refusal["error"]
    assert untouched.names() == before


def test_nothing_changes_while_a_run_is_restored(run: Run) -> None:
    run.is_restoring = True
    assert run.ask("remove", name="walker")["code"] == "incorrect_state"
    assert run.ask("spawn", uri="box")["code"] == "incorrect_state"
    assert "walker" in run.names()


def test_names_are_made_up_where_that_is_allowed(run: Run) -> None:
    given = {"uri": "crate", "position_m": [0.0, 1.0, 0.0], "allow_renaming": True}
    assert run.ask("spawn", name="rover", **given)["name"] == "rover_2"
    given["position_m"] = [1.5, 1.0, 0.0]
    assert run.ask("spawn", name="My-Crate 7", **given)["name"] == "my_crate_7"


def test_a_vehicle_is_spawned_from_text_under_a_namespace(run: Run) -> None:
    text = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    answer = run.ask("spawn", text=text, name="b", namespace="team", position_m=[1.0, 0.0, 0.1651])
    assert answer["name"] == "b"
    assert run.entity("b")["position_m"] == pytest.approx([1.0, 0.0, 0.1651], abs=1e-6)
    assert run.episode.scenario.vehicles[-1].command_topic == "/team/cmd_vel"


def test_a_body_may_be_spawned_leaning(run: Run) -> None:
    leaning = [0.0, sin(0.2), 0.0, cos(0.2)]
    run.ask("spawn", uri="crate", position_m=[0.0, 1.0, 0.5], orientation=leaning)
    assert run.entity("crate")["orientation"] == pytest.approx(leaning)
    assert run.entity("crate")["position_m"] == pytest.approx([0.0, 1.0, 0.5])


def test_files_and_worlds_are_listed(untouched: Run, tmp_path: Path) -> None:
    rover = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(rover, encoding="utf-8")
    sources = [tmp_path.as_uri(), "https://example.org/models"]
    answer = untouched.ask("spawnables", sources=sources)
    found = {one["uri"]: one for one in answer["spawnables"]}
    assert {"rover", "car", "crate", "person", str(tmp_path / "mine.yaml")} <= found.keys()
    assert found["crate"]["low_m"] == pytest.approx([-0.2, -0.2, 0.0])
    assert answer["unknown"] == sources[1:]
    known = {one["uri"]: one for one in untouched.ask("worlds")["worlds"]}
    assert {"indoor_lab", "worlds/lab", "worlds/yard"} <= known.keys()
    assert known["indoor_lab"]["tags"] == known["worlds/lab"]["tags"] == ["indoor"]
    assert untouched.ask("world")["world"] == known["worlds/lab"]


def test_named_poses_are_those_of_the_world_and_the_starts(untouched: Run) -> None:
    dock, start = untouched.ask("named_poses")["poses"]
    assert dock["orientation"] == pytest.approx([0.0, 0.0, sqrt(0.5), sqrt(0.5)])
    assert (dock["low_m"], dock["tags"]) == ([-1.0, -1.0, 0.0], ["parking"])
    assert start["name"] == "rover_start"
    assert start["position_m"] == pytest.approx(untouched.entity("rover")["position_m"], abs=1e-6)


def test_a_reset_of_states_keeps_time_and_what_was_spawned(run: Run) -> None:
    began = run.entity("rover")["position_m"]
    run.ask("spawn", uri="box", position_m=[0.0, 1.0, 0.0])
    run.ask("place", name="box", position_m=[1.0, 1.0, 0.0])
    run.ask("place", name="rover", position_m=[1.0, 0.0, 0.2], linear_mps=[1.0, 0.0, 0.0])
    run.step(10)
    run.ask("reset", scopes=["state"])
    assert run.episode.tick == 10
    assert run.entity("rover")["position_m"] == pytest.approx(began)
    assert run.entity("rover")["linear_mps"] == [0.0, 0.0, 0.0]
    assert run.entity("box")["position_m"] == pytest.approx([0.0, 1.0, 0.0])


def test_a_reset_of_what_was_spawned_keeps_the_rest(run: Run) -> None:
    began = run.names()
    run.ask("spawn", uri="person", position_m=[0.0, 1.0, 0.0])
    run.ask("spawn", uri="crate", position_m=[1.0, 0.5, 0.0])
    run.ask("describe", name="rover", category="object", tags=["seen"])
    assert run.entity("rover")["tags"] == ["seen"]
    run.ask("reset", scopes=["spawned"])
    assert run.names() == began
    assert run.entity("rover")["tags"] == ["ego"]


OPEN = """
name: open
materials: {floor: {}}
solids:
  - name: floor
    material: floor
    position_m: [0, 0, -0.5]
    shape: {kind: box, size_m: [20, 20, 1]}
poses: {gate: {position_m: [1, 0, 0]}}
"""


def test_a_world_of_text_has_the_runs_vehicles_and_nothing_that_was_spawned(run: Run) -> None:
    run.ask("spawn", uri="box", position_m=[0.0, 1.0, 0.0])
    start = run.entity("rover")["position_m"]
    answer = run.ask("load_world", text=OPEN)
    told = {"name": "open", "uri": "", "description": "", "tags": [], "text": OPEN}
    assert (answer["tick"], answer["world"]) == (0, told)
    assert run.ask("world")["world"] == told
    assert run.names() == {"rover", "floor"}
    assert run.entity("rover")["position_m"] == pytest.approx(start, abs=1e-6)
    assert run.entity("rover")["tags"] == [], "the tags of the lab's rover are the lab's"
    assert [pose["name"] for pose in run.ask("named_poses")["poses"]] == ["gate", "rover_start"]
    run.ask("spawn", uri="box", position_m=[0.0, 1.0, 0.0])
    run.ask("reset", scopes=["spawned"])
    assert run.names() == {"rover", "floor"}


def test_a_scenario_brings_starts_and_nothing_else_of_its_vehicles(run: Run) -> None:
    world = run.ask("load_world", uri="yard")["world"]
    assert (world["name"], world["uri"]) == ("yard", "yard")
    assert run.entity("rover")["position_m"][:2] == pytest.approx([-8.0, -4.0])
    scenario = run.episode.scenario
    assert (scenario.name, scenario.seed, scenario.time) == (LAB.name, LAB.seed, LAB.time)
    assert scenario.sensor_names() == LAB.sensor_names()
    assert run.ask("load_world", uri="worlds/lab")["world"]["uri"] == "worlds/lab"
    assert run.entity("rover")["position_m"][:2] == pytest.approx([-4.6, 0.0]), "its own start"


def test_worlds_that_differ_in_what_no_hash_covers_have_other_hashes(run: Run) -> None:
    hashes = []
    for visibility in ("50.0", "80.0", "50.0"):
        run.ask("load_world", text=OPEN + f"weather: {{fog_visibility_m: {visibility}}}\n")
        hashes.append(run.episode.world_hash)
    run.ask("load_world", text=OPEN)
    assert hashes[0] != hashes[1]
    assert run.episode.world_hash not in hashes[1:]


def test_without_a_world_nothing_is_listed_or_changed_until_one_is_loaded(run: Run) -> None:
    assert run.ask("unload_world")["tick"] == 0
    assert {run.ask(query)["code"] for query in ("world", "unload_world")} == {"no_world"}
    assert run.names() == set()
    assert run.ask("named_poses")["poses"] == []
    for query, fields in {
        "entities": {"name": "rover"},
        "remove": {"name": "rover"},
        "place": {"name": "rover"},
        "describe": {"name": "rover"},
        "spawn": {"uri": "box"},
        "reset": {"scopes": ["time", "state", "spawned"]},
    }.items():
        refusal = run.ask(query, **fields)
        assert refusal["code"] == "incorrect_state", query
        assert refusal["error"] == "no world is loaded. Fix: load one"
    run.ask("load_world", uri="indoor_lab")
    assert "rover" in run.names()


def lives(run: Run) -> None:
    """Have an episode live through every change that a tool can make."""
    run.step(5)
    run.ask("spawn", uri="person", name="tom", position_m=[0.5, 1.0, 0.0])
    run.ask("spawn", uri="crate", position_m=[1.0, 0.0, 0.0])
    now = run.episode.epoch_nanos + 9 * TICK_NANOS
    run.episode.command("rover", Command(now, (0.5, 0.0, 0.0), (0.0, 0.0, 0.0)))
    run.step(40)
    run.ask("place", name="tom", position_m=[1.5, 1.0, 0.0])
    run.ask("place", name="crate", position_m=[0.0, 0.5, 0.5], angular_radps=[1.0, 2.0, 3.0])
    run.ask("place", name="rover", position_m=[-2.0, 0.3, 0.3], linear_mps=[0.4, 0.0, 0.0])
    run.ask("describe", name="crate", category="object", tags=["load"])
    run.step(60)
    run.ask("spawn", uri="box", position_m=[3.0, 0.0, 0.0])
    run.ask("remove", name="box")
    run.ask("reset", scopes=["state"])
    run.step(30)


def test_a_restored_episode_is_the_same_to_the_bit(run: Run) -> None:
    lives(run)
    saved = loaded(dumped(run.episode.journal()), "here")
    again = Restoration(saved, episode_of(saved.scenario, 9, saved.epoch_nanos))
    assert again.advance(10**6)
    assert again.difference() == ""
    assert again.episode.journal().entries == saved.entries
    told = run.ask("entities")
    run.episode, before = again.episode, run.episode
    assert run.ask("entities") == told
    assert {"load"} == set(run.entity("crate")["tags"])
    before.end()
