# SPDX-License-Identifier: Apache-2.0
"""Every mistake in a scenario is one line that names file, line, field and mend."""

import tomllib
from itertools import pairwise
from pathlib import Path

import pytest

import groundlink
from groundlink.loader import ScenarioError, load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED, load_route
from groundlink.scenario.route import Circle, FigureEight
from services.sensors.imu.spec import InertialUnit
from services.sensors.lidar.spec import Lidar

GOOD = """\
name: test
seed: 3
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    sensors:
      - kind: lidar
        datasheet: sensors/vlp16.yaml
        name: lidar
        topic: /points
        frame: lidar_link
        mount: mast
      - {kind: imu, name: imu, topic: /imu, frame: imu_link, rate_hz: 100}
time:
  mode: fast
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "test.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_references_are_followed_and_defaults_filled_in(tmp_path: Path) -> None:
    scenario = load(write(tmp_path, GOOD))
    lidar, imu = scenario.vehicles[0].sensors
    assert scenario.world.name == "lab"
    assert scenario.vehicles[0].model.name == "rover"
    assert isinstance(lidar, Lidar)
    assert len(lidar.elevations_deg) == 16
    assert lidar.mount == scenario.vehicles[0].model.mounts["mast"]
    assert isinstance(imu, InertialUnit)
    assert imu.rate_hz == 100.0
    assert scenario.time.mode == "fast"
    assert scenario.gateway.datagram == "loopback"


def test_a_scenarios_own_field_wins_over_its_data_sheet(tmp_path: Path) -> None:
    text = GOOD.replace("        name: lidar\n", "        name: lidar\n        max_range_m: 7\n")
    lidar = load(write(tmp_path, text)).vehicles[0].sensors[0]
    assert isinstance(lidar, Lidar)
    assert lidar.max_range_m == 7.0


def test_a_file_beside_the_scenario_wins_over_a_shipped_one(tmp_path: Path) -> None:
    (tmp_path / "vehicles").mkdir()
    rover = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    (tmp_path / "vehicles" / "rover.yaml").write_text(
        rover.replace("name: rover", "name: mine"), encoding="utf-8"
    )
    assert load(write(tmp_path, GOOD)).vehicles[0].model.name == "mine"


MISTAKES = [
    ("seed: 3", "sede: 3", 2, ["unknown key `sede`", "did you mean `seed`?"]),
    ("rate_hz: 100", "rat_hz: 100", 14, ["`vehicles[0].sensors[1].rat_hz`", "`rate_hz`?"]),
    ("  mode: fast", "  mod: fast", 16, ["unknown key `time.mod`", "`mode`?"]),
    ("  mode: fast", "  mode: slow", 16, ["`time.mode`", "slow"]),
    ("seed: 3", "seed: three", 2, ["`seed`", "expected `int`", "'three'"]),
    ("seed: 3", "seed: -1", 2, ["`seed`", ">= 0"]),
    ("rate_hz: 100", "rate_hz: fast", 14, ["`vehicles[0].sensors[1].rate_hz`", "float"]),
    ("rate_hz: 100", "rate_hz: 900", 14, ["rate_hz", "<= 400"]),
    ("sensors/vlp16.yaml", "vlp61", 9, ["sensors/vlp61.yaml", "did you mean"]),
    (
        "world: worlds/lab.yaml",
        "world: {name: w, room: {size_m: [9, 9, 3]},\n  entities: {rom: {}}}",
        4,
        ["`rom`: no such entity", "`room`?"],
    ),
    ("worlds/lab.yaml", "worlds/lap.yaml", 3, ["worlds/lap.yaml", "`lab`?"]),
    ("vehicles/rover.yaml", "rovr", 6, ["vehicles/rovr.yaml", "`rover`?"]),
    ("kind: lidar", "kind: imu", 9, ["data", "lidar", "imu"]),
    ("{kind: imu,", "{kind: imus,", 14, ["unknown kind `imus`", "did you mean `imu`?"]),
    ("{kind: imu,", "{", 14, ["kind", "missing"]),
    ("topic: /imu", "topik: /imu", 14, ["unknown key", "`topic`?"]),
    (", topic: /imu", "", 14, ["`vehicles[0].sensors[1].topic`", "missing"]),
    (
        "{kind: imu, name: imu, ",
        "{kind: wheel_odometry, encoders: wheels, name: imu, ",
        14,
        ["`encoders`: no sensor `wheels` of kind `encoders`; add one"],
    ),
    (
        "{kind: imu, name: imu, topic: /imu, frame: imu_link, rate_hz: 100}",
        "{kind: encoders, name: imu, topic: /imu, frame: x, reversed_wheels: [front_left]}",
        14,
        ["`reversed_wheels`: no wheel `front_left`; did you mean `front_left_wheel`?"],
    ),
    (
        "rate_hz: 100}",
        "gyroscope: {bandwidth_hz: 2}}",
        14,
        ["`bandwidth_hz` is below 5"],
    ),
    ("mount: mast", "mount: most", 13, ["unknown mount `most`", "did you mean `mast`?"]),
    ("name: imu,", "name: lidar,", 14, ["`lidar` is taken"]),
    (
        "rate_hz: 100}\n",
        "rate_hz: 100}\n    streams:\n      - {kind: pose, name: imu, topic: /pose, rate_hz: 1}\n",
        16,
        ["`imu` is taken"],
    ),
    (
        *("topic: /imu", "topic: /points", 14),
        ["`rover/imu`: the topic `/points` is taken by `rover/lidar` (", "test.yaml:11)"],
    ),
    (
        *("topic: /imu", "topic: /ground_truth/wheels", 14),
        ["`/ground_truth/wheels` is taken by `ground_truth` of `rover`", "test.yaml:5)"],
    ),
    ("topic: /imu", "topic: /ground_truth/bodies", 14, ["is taken by `bodies`"]),
    ("frame: imu_link", "frame: imu link", 14, ["[1].frame`: expected a frame without blanks"]),
    ("frame: imu_link", "frame: /imu", 14, ["does not begin with a slash (given: '/imu')"]),
    ("topic: /imu", "topic: imu-1", 14, ["[1].topic`: expected a topic of letters"]),
    ("seed: 3", "gateway: {bind: '0.0.0.0:99999'}", 2, ["`gateway.bind`", "up to 65535"]),
    ("seed: 3", "gateway: {peer: 'ros:65536'}", 2, ["`gateway.peer`", "up to 65535"]),
    ("seed: 3", "gateway: {peers: ['ros:70000']}", 2, ["`gateway.peers[0]`", "HOST or HOST:PORT"]),
    ("rate_hz: 100", "mount: {xyz_m: [0, .nan, 0]}", 14, ["`xyz_m` is nan", "finite"]),
    ("  - name: rover", "  - placement: {x_m: 50}\n    name: rover", 5, ["nothing is below it"]),
    (
        *("  - name: rover", "  - placement: {z_m: 50}\n    name: rover", 5),
        ["50 m above the ground; expected at most 5 m"],
    ),
    ("name: rover", "name: bodies", 5, ["`bodies`: reserved for a key of the bus"]),
    ("name: rover", "name: state", 5, ["`state`: reserved for a key of the bus"]),
    ("name: imu,", "name: command,", 14, ["`command`: reserved for a key of the bus"]),
    ("name: rover", "name: My Rover", 5, ["`vehicles[0].name`", "My Rover"]),
    ("seed: 3", "seed: 3\nseed: 4", 3, ["`seed`: duplicate key"]),
    ("mode: fast", "mode: fast\n  window_ticks: 7", 17, ["`time.window_ticks`", ">= 8"]),
    (
        "mode: fast",
        "mode: fast\n  clock_rate_hz: 4\n  window_ticks: 99",
        18,
        ["99 is less than a period of the clock"],
    ),
    ("mode: fast", "mode: fast\n  window_ticks: 983", 17, ["`lidar`", "expected 982 or less"]),
    ("mode: fast", "mode: lockstep\n  window_ticks: 983", 17, ["expected 982 or less"]),
    ("mode: fast", "mode: lokstep", 16, ["unknown value `lokstep`", "did you mean `lockstep`?"]),
    ("mode: fast", "overload: slov", 16, ["`time.overload`", "did you mean `slow`?"]),
    ("mode: fast", "deadline_s: 0", 16, ["`time.deadline_s`", "> 0"]),
    ("mode: fast", "deadline_s: .inf", 16, ["`deadline_s` is inf; expected a finite number"]),
    ("mode: fast", "deadline_s: .nan", 16, ["`deadline_s` is nan"]),
    ("mode: fast", "factor: .inf", 16, ["`factor` is inf; expected a finite number"]),
    ("mode: fast", "lockstep: ros", 15, ["`mode: realtime` never waits", "`mode: lockstep`"]),
    (
        "mode: fast",
        "mode: fast\n  lockstep: ros\n  clock_rate_hz: 30",
        15,
        ["`clock_rate_hz` that divides 400"],
    ),
    (
        "rate_hz: 100}\ntime:\n",
        "rate_hz: 100}\n"
        "      - {kind: camera, name: eye, topic: /eye, frame: eye, rate_hz: 5.0,\n"
        "         imager: {exposure_s: 0.1, readout_s: 0.1, poses: 4},\n"
        "         faults: [{kind: delay, delay_s: 0.5}, {kind: delay, delay_s: 1.0}]}\n"
        "time:\n  window_ticks: 600\n",
        19,
        ["600 and a measurement of `eye`", "expected 542 or less"],
    ),
    (
        "{kind: imu, name: imu, topic: /imu, frame: imu_link, rate_hz: 100}",
        "{kind: gnss, name: gnss, topic: /fix, frame: gnss_link}",
        14,
        ["`gnss` receives satellites, but `world.datum` is missing", "latitude_deg"],
    ),
    ("{kind: imu,", "{kind: gnss,", 14, ["rate_hz", "<= 20"]),
    ("{kind: imu,", "{kind: range, max_range_m: 2, radiation: sound,", 14, ["radiation", "sound"]),
    (
        "{kind: imu,",
        "{kind: range, radiation: infrared, field_of_view_deg: 5, min_range_m: 2, max_range_m: 1,",
        14,
        ["`min_range_m` is 2; expected less than `max_range_m`, 1"],
    ),
    ("rover.yaml", "rover.yaml\n    route: {kind: spiral}", 7, ["unknown kind `spiral`"]),
    ("rover.yaml", "rover.yaml\n    route: {kind: circel}", 7, ["did you mean `circle`?"]),
    ("rover.yaml", "rover.yaml\n    route: {kind: square, side: 2}", 7, ["`side_m`?"]),
    ("rover.yaml", "rover.yaml\n    route: {kind: circle, radius_m: 0}", 7, ["radius_m", "> 0"]),
    ("rover.yaml", "rover.yaml\n    route: {kind: waypoints}", 7, ["route.points", "missing"]),
    (
        "rover.yaml",
        "rover.yaml\n    route: {kind: waypoints, laps: 2, points: [{x_m: 1, y_m: 2}]}",
        7,
        ["`laps` needs `closed: true`"],
    ),
    (
        "rover.yaml",
        "rover.yaml\n    route: {kind: circle, speed_mps: 2}",
        7,
        ["`vehicles[0].route.speed_mps`: 2 m/s is more than the 1.50 m/s that `rover` can drive"],
    ),
    ("rover.yaml", "rover.yaml\n    route: tour", 7, ["no file `routes/tour.yaml`"]),
    ("model:", "vehicle:", 6, ["`vehicles[0].vehicle`; did you mean `model`, which is missing?"]),
    ("model:", "urdf:", 6, ["`vehicles[0].urdf`; did you mean `model`, which is missing?"]),
    ("model:", "modle:", 6, ["`vehicles[0].modle`; did you mean `model`?"]),
    ("rover.yaml", "rover.yaml\n    urdf: a.urdf", 7, ["`vehicles[0].urdf`; expected one of"]),
    (
        "seed: 3",
        "expect:\n  - kind: rate\n    topic: /point\n    at_least_hz: 1",
        4,
        ["`expect[0].topic`: no topic `/point`; did you mean `/points`?"],
    ),
    ("seed: 3", "expect: [{kind: reaches}]", 2, ["`expect[0].place` is missing"]),
    (
        "seed: 3",
        "expect: [{kind: touches}]",
        2,
        ["unknown kind `touches`; did you mean `never_touches`?"],
    ),
    ("seed: 3", "seed: [3", 3, ["not valid YAML"]),
    ("vehicles:", "vehicels:", 4, ["unknown key `vehicels`", "`vehicles`?"]),
]


@pytest.mark.parametrize(("right", "wrong", "line", "words"), MISTAKES)
def test_a_mistake_is_one_line_with_its_place(
    tmp_path: Path, right: str, wrong: str, line: int, words: list[str]
) -> None:
    assert right in GOOD
    file = write(tmp_path, GOOD.replace(right, wrong, 1))
    with pytest.raises(ScenarioError) as caught:
        load(file)
    text = str(caught.value)
    assert "\n" not in text
    assert text.startswith(f"{file}:{line}: "), text
    for word in words:
        assert word in text


@pytest.mark.parametrize("window", [40, 982, 983])
def test_a_window_is_as_wide_as_what_is_kept_for_a_restart(tmp_path: Path, window: int) -> None:
    """1024 states, less the two around an instant and the 40 of a revolution at 10 Hz."""
    file = write(tmp_path, GOOD + f"  window_ticks: {window}\n")
    if window <= 982:
        assert load(file).time.window_ticks == window
    else:
        with pytest.raises(ScenarioError, match="expected 982 or less"):
            load(file)


def test_a_mistake_in_a_referenced_file_names_that_file(tmp_path: Path) -> None:
    (tmp_path / "vehicles").mkdir()
    mine = tmp_path / "vehicles" / "mine.yaml"
    rover = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    mine.write_text(rover.replace("mass_kg:", "mas_kg:", 1), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"mine\.yaml:\d+: .*did you mean `mass_kg`"):
        load(write(tmp_path, GOOD.replace("vehicles/rover.yaml", "mine")))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "no such file"),
        (b"", "the file is empty"),
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"- 1\n- 2\n", "expected `object`"),
        (b"just words", "expected `object`"),
        (b"name: x\nvehicles: []\nworld: lab\n", "at least one"),
        (b"a: \x01", "not valid YAML"),
    ],
)
def test_files_that_are_no_scenario(tmp_path: Path, content: bytes | None, words: str) -> None:
    file = tmp_path / "odd.yaml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(ScenarioError) as caught:
        load(file)
    assert words in str(caught.value)
    assert str(file) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_material_is_named_with_its_nearest(tmp_path: Path) -> None:
    (tmp_path / "worlds").mkdir()
    lab = (SHIPPED / "worlds" / "lab.yaml").read_text(encoding="utf-8")
    (tmp_path / "worlds" / "odd.yaml").write_text(
        lab + "\nsolids:\n  - {name: x, shape: {kind: sphere, radius_m: 1.0}, material: wod}\n",
        encoding="utf-8",
    )
    with pytest.raises(ScenarioError, match=r"odd\.yaml:\d+: .*`wod`.*`wood`"):
        load(write(tmp_path, GOOD.replace("worlds/lab.yaml", "worlds/odd.yaml")))


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*.yaml")), ids=lambda file: file.stem)
def test_every_shipped_scenario_is_valid(file: Path) -> None:
    assert load(file).name == file.stem


@pytest.mark.parametrize(
    ("name", "more", "drives"),
    [("indoor_lab", ["rover/camera"], False), ("indoor_lab_tour", [], True)],
)
def test_the_laboratory_has_its_sensors_and_the_tour_a_route(
    name: str, more: list[str], drives: bool
) -> None:
    scenario = load(name)
    assert scenario.sensor_names() == ["rover/lidar", "rover/imu", "rover/encoders", *more]
    assert (scenario.vehicles[0].route is not None) is drives


def test_the_yard_is_valid_and_is_somewhere_on_the_earth() -> None:
    scenario = load("yard")
    assert scenario.sensor_names()[:4] == [
        f"rover/{name}" for name in ("gnss", "gnss_cheap", "sonar", "tof")
    ]
    assert scenario.world.datum is not None
    assert scenario.world.datum.latitude_deg == 52.254


def test_a_route_of_its_own_is_a_file_or_a_figure(tmp_path: Path) -> None:
    vehicle = load("indoor_lab").vehicles[0]
    assert load_route("figure_eight", vehicle) == FigureEight()
    file = tmp_path / "path.yaml"
    file.write_text("kind: circle\nradius_m: 2\n", encoding="utf-8")
    assert load_route(str(file), vehicle) == Circle(radius_m=2.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("kind: circle\nradius: 2\n", ["path.yaml:2: unknown key `route.radius`", "`radius_m`?"]),
        ("kind: circle\nspeed_mps: 9\n", ["path.yaml:2: `route.speed_mps`: 9 m/s is more than"]),
        ("kind: ring\n", ["path.yaml:1: `route.kind`: unknown kind `ring`", "circle"]),
        ("- 1\n", ["path.yaml:1: `route`: expected `object`"]),
    ],
)
def test_a_mistake_in_a_route_of_its_own(tmp_path: Path, content: str, words: list[str]) -> None:
    file = tmp_path / "path.yaml"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(ScenarioError) as caught:
        load_route(str(file), load("indoor_lab").vehicles[0])
    for word in words:
        assert word in str(caught.value)


def test_an_unknown_figure_is_answered_with_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match="no figure `cirle`; did you mean `circle`"):
        load_route("cirle", load("indoor_lab").vehicles[0])


def test_a_shipped_scenario_is_found_by_its_name_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert load("indoor_lab").name == "indoor_lab"
    with pytest.raises(ScenarioError, match=r"indor_lab: no such file .* `indoor_lab`\?"):
        load("indor_lab")
    (tmp_path / "indoor_lab").write_text("seed: 1\n", encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"^indoor_lab:1: "):  # A file comes first.
        load("indoor_lab")


@pytest.mark.parametrize(
    "text",
    [
        "a: &a [x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in pairwise("abcdefghi")),
        "a: " + "[" * 5000 + "]" * 5000,
        "{a: " * 3000,
        "".join(" " * depth + "a:\n" for depth in range(500)),
        "a: &a [*a]",
    ],
)
def test_a_file_that_grows_or_goes_down_without_end_is_one_line(tmp_path: Path, text: str) -> None:
    file = write(tmp_path, text)
    with pytest.raises(ScenarioError, match=r"test\.yaml:\d+: .*(50 deep|100000 values)") as caught:
        read(file)
    assert len(str(caught.value)) < 300


def test_an_alias_stands_for_what_was_written(tmp_path: Path) -> None:
    document = read(write(tmp_path, "a: &a {b: [1, 2]}\nc: *a\n"))
    assert document.value == {"a": {"b": [1, 2]}, "c": {"b": [1, 2]}}


TWO_ROVERS = """\
name: test
world:
  name: nowhere
  materials: {{{listed}}}
  solids:
    - name: floor
      shape: {{kind: box, size_m: [40, 40, 1]}}
      material: rubber
      position_m: [0, 0, -0.5]
vehicles:
  - {{name: first, model: first.yaml, placement: {{x_m: -9}}}}
  - {{name: second, model: second.yaml, placement: {{x_m: 9}}}}
"""
RUBBER = "  rubber: {reflectivity: 0.05,"


def write_two(folder: Path, *, listed: str = "", second: str = RUBBER) -> Path:
    """Write a scenario with two rovers, whose rubber may differ."""
    rover = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    assert RUBBER in rover
    (folder / "first.yaml").write_text(rover, encoding="utf-8")
    (folder / "second.yaml").write_text(rover.replace(RUBBER, second), encoding="utf-8")
    file = folder / "test.yaml"
    file.write_text(TWO_ROVERS.format(listed=listed), encoding="utf-8")
    return file


def test_a_world_needs_none_of_a_vehicles_materials(tmp_path: Path) -> None:
    scenario = load(write_two(tmp_path))
    assert scenario.world.materials["rubber"].reflectivity == 0.05
    assert scenario.world.materials == scenario.vehicles[1].model.materials


def test_a_worlds_own_materials_win(tmp_path: Path) -> None:
    other = "  rubber: {reflectivity: 0.1,"
    scenario = load(write_two(tmp_path, listed="rubber: {reflectivity: 0.7}", second=other))
    assert scenario.world.materials["rubber"].reflectivity == 0.7


def test_two_vehicles_may_not_mean_different_things(tmp_path: Path) -> None:
    file = write_two(tmp_path, second="  rubber: {reflectivity: 0.1,")
    with pytest.raises(ScenarioError) as caught:
        load(file)
    text = str(caught.value)
    assert text.startswith(f"{tmp_path / 'second.yaml'}:")
    assert f"another `rubber` is defined by the vehicle at {tmp_path / 'first.yaml'}:" in text


def test_material_mistake_has_its_place(tmp_path: Path) -> None:
    file = write_two(tmp_path)
    for name in ("first", "second"):
        model = tmp_path / f"{name}.yaml"
        model.write_text(model.read_text().replace(RUBBER, "  rubber: {reflectivity: 5,"))
    with pytest.raises(ScenarioError, match=r"first\.yaml:\d+: `world\.materials.*<= 1"):
        load(file)


def test_all_shipped_vehicles_agree_on_what_they_are_made_of(tmp_path: Path) -> None:
    vehicles = "\n".join(
        f"  - {{name: {file.stem}, model: {file.stem}, placement: {{x_m: {20 * i}}}}}"
        for i, file in enumerate(sorted((SHIPPED / "vehicles").glob("*.yaml")))
    )
    file = tmp_path / "test.yaml"
    world = TWO_ROVERS.partition("vehicles:")[0].format(listed="").replace("40, 40", "400, 40")
    file.write_text(f"{world}vehicles:\n{vehicles}\n", encoding="utf-8")
    assert len(load(file).vehicles) >= 4


PACKAGE = Path(groundlink.__file__).parent
PYPROJECT = PACKAGE.parent / "pyproject.toml"


def test_an_installed_package_has_all_that_is_shipped() -> None:
    tables = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    patterns = tables["tool"]["setuptools"]["package-data"]["groundlink"]
    packed = {file.resolve() for pattern in patterns for file in PACKAGE.glob(pattern)}
    assert SHIPPED == PACKAGE.parent / "scenarios"
    assert packed == {file for file in SHIPPED.rglob("*") if file.is_file()}
