# SPDX-License-Identifier: Apache-2.0
"""System tests of a run with credentials: all features work, and access without them fails."""

import datetime
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.credentials import ABOUT, AUTHORITY, CERTIFICATE, KEY, VARIABLE, about_text
from groundlink.bus.inbox import BusInbox
from groundlink.bus.queries import (
    asset_key,
    control_key,
    faults_key,
    history_key,
    journal_key,
    link_key,
    scenario_key,
    world_query_key,
)
from groundlink.bus.session import Bus
from groundlink.bus.topics import FROM_ROS, TOPICS, process_names
from groundlink.deploy.certificates import Authority
from groundlink.loader import load
from groundlink.messages.base import Health
from udp_bridge import Link
from udp_bridge.io.address_guard import open_socket
from udp_bridge.wire.seal import FROM_ROS as FROM_ROS_SIDE

from .rig import LAB, Observer, Rig, rig, wait_for
from .secured import Heard, Secured

pytestmark = pytest.mark.system

RUN = "secured"
ELSEWHERE = "elsewhere"
"""Another run, in which there is nobody whom an intruder could disturb."""

TOUR = LAB.with_name("indoor_lab_tour.yaml")
IN_ROS = ("/points", "/imu", "/wheel_encoders", "/clock")
FIRST_SECONDS = 1.0


class Running(NamedTuple):
    """A run with a driver that all tests of this module look at."""

    secured: Secured
    observer: Observer

    @property
    def rig(self) -> Rig:
        return self.secured.rig


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("secured")
    with rig(folder) as it:
        gateway = f"{{link: {{}}, bind: {it.address(it.bind)}, peer: {it.address(it.peer)}}}"
        tour = TOUR.read_text(encoding="utf-8")
        # A tenth of the pace: what is looked at is who may say what, and not how much.
        more = f"gateway: {gateway}\ntime: {{factor: 0.1}}\n"
        it.scenario.write_text(f"{tour}\n{more}", encoding="utf-8")
        secured = Secured(it)
        secured.start("router", "services.router", "--listen", it.endpoint)
        wait_for(it.is_answered, 30, "the router listens")
        secured.start("physics", "services.physics", str(it.scenario), "--run", RUN)
        for name, module in process_names(load(str(it.scenario))).items():
            if "/" in name:
                secured.start(name, module, "--name", name)
        secured.start("recorder", "services.recorder", "--out", str(folder / "run.mcap"))
        secured.start("gateway", "services.gateway", "--key-file", secured.key_file)
        it.start(
            *("-m", "udp_bridge_ros2", "--bind", it.address(it.peer)),
            *("--key-file", secured.key_file),
            log="node.log",
        )
        observer = Observer(it)
        for topic in IN_ROS:
            observer.wait(topic, beyond=5, seconds=60)
        yield Running(secured, observer)


@pytest.fixture
def operator(running: Running, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bus]:
    """A bus as the operator has it."""
    monkeypatch.setenv(VARIABLE, str(running.secured.of("operator")))
    with Bus(connect=running.rig.endpoint) as bus:
        yield bus


@pytest.fixture
def health(operator: Bus) -> Callable[[str], Health]:
    """Return the next word of a process about itself."""

    def of(process: str) -> Health:
        inbox: BusInbox[Health] = BusInbox(depth=1)
        operator.subscribe(HEALTH.key_in(RUN, process=process), Health, inbox)
        arrived = inbox.get(seconds=30)
        assert arrived, f"{process} is silent"
        return arrived[1]

    return of


def test_everybody_takes_part(running: Running, operator: Bus) -> None:
    inbox: BusInbox[Health] = BusInbox(depth=1000)
    operator.subscribe(HEALTH.key_in(RUN), Health, inbox)
    expected = {*process_names(load(str(running.rig.scenario))), "recorder"}
    said: dict[str, Health] = {}

    def all_spoke() -> bool:
        while arrived := inbox.get(seconds=0):
            said[arrived[1].process] = arrived[1]
        return expected <= said.keys()

    wait_for(all_spoke, 20, "everybody says how it is")
    assert said["recorder"].counters
    assert said["rover/driver"].counters["commands"] > 0
    assert said["physics"].counters["refused"] == 0


@pytest.mark.parametrize(
    "words",
    [
        "pause",
        "step",
        "resume",
        "save {folder}/saved.json",
        "fault rover/imu drop share=0.5 --for 0.2",
        f"link --run {RUN} --set to_ros.delay_ms=1",
        "top --once",
        "spawn box --at 3.5,0.4",  # a meter from the way of the rover
    ],
)
def test_the_operator_may_do_all(running: Running, words: str) -> None:
    done = running.secured.say("groundlink", *words.format(folder=running.rig.folder).split())
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_viewer_looks_on(running: Running) -> None:
    pytest.importorskip("rerun")
    file = running.rig.folder / "seen.rrd"
    running.secured.start("view", "services.view", "--save", str(file))
    wait_for(lambda: "view/" in running.rig.log("router.log"), 40, "the viewer is there")
    wait_for(lambda: file.exists() and file.stat().st_size > 10_000, 30, "it has seen something")


def of_another_authority(running: Running) -> Path:
    """Return a folder for the IMU by an authority that the run does not know."""
    folder = running.rig.folder / "another"
    folder.mkdir(exist_ok=True)
    authority = Authority(datetime.datetime.now(datetime.UTC))
    pem = authority.certify("rover/imu")
    (folder / AUTHORITY).write_bytes(authority.certificate)
    (folder / CERTIFICATE).write_bytes(pem.certificate)
    (folder / KEY).write_bytes(pem.key)
    (folder / ABOUT).write_text(about_text("rover/imu"))
    return folder


def of_another_sensor(running: Running) -> Path:
    return running.secured.of("rover/lidar")


@pytest.mark.parametrize(
    ("credentials", "said"),
    [
        (None, "certificate"),
        (of_another_authority, "certificate"),
        (of_another_sensor, "expected `rover/imu`, got `rover/lidar`"),
    ],
)
def test_denied_sensor_gives_one_line(
    running: Running, credentials: Callable[[Running], Path] | None, said: str
) -> None:
    own = credentials(running) if credentials else ""
    done = running.secured.say("services.sensors.imu", "--name", "rover/imu", own=own)
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize(
    ("process", "words"),
    [
        ("rover/imu", "services.sensors.imu --name rover/imu"),
        ("gateway", "services.gateway --bind 127.0.0.1:0"),
        ("physics", f"services.physics {TOUR} --run {RUN}"),
    ],
)
def test_duplicate_process_names_the_other_and_ends(
    running: Running, process: str, words: str
) -> None:
    done = running.secured.say(*words.split(), own=running.secured.of(process))
    assert done.returncode == 2, done.stderr
    assert f"run `{RUN}`: another `{process}` runs on " in done.stderr
    assert len(done.stderr.splitlines()) == 1, done.stderr


COMMANDS = {
    "rover/command",
    "rover/command/wheels",
    "rover/command/joints",
    "rover/command/joints/**",
}
FROM_ROS_KEYS = {row.key_in("", vehicle="rover").split("/", 2)[2] for row in FROM_ROS.values()}
OWN: dict[str, set[str]] = {
    "rover/imu": {"rover/imu", "faults/rover/imu", "gaps/rover/imu"},
    "rover/driver": {"rover/command"},
    "gateway": COMMANDS | FROM_ROS_KEYS | {"rover/from_ros/topics/**"},
    "view": set(),
    "operator": COMMANDS,
}
"""What holders of a certificate may say, beside how they are."""


@pytest.mark.parametrize("holder", OWN)
def test_certificate_permits_own_topics_only(running: Running, operator: Bus, holder: str) -> None:
    processes = ["physics", "rover/lidar", *OWN]
    sensors = ("imu", "lidar")
    tried = {
        row.key_in(ELSEWHERE, vehicle="rover", sensor=sensor, process=process)
        for row in TOPICS
        for sensor in sensors
        for process in processes
    }
    own = OWN[holder] | {f"health/{holder}", f"ack/{holder}"}
    if holder == "operator":  # any number of them may be there, each under a name of its own
        own = OWN[holder]
    permitted = {key for key in tried if key.split("/", 2)[2] in own}
    with running.secured.session("operator") as ears, running.secured.session(holder) as mouth:
        heard = Heard(ears, f"groundlink/{ELSEWHERE}/**")

        def all_permitted_are_heard() -> bool:
            for key in tried:
                mouth.put(key, b"intruder")
            return permitted <= {*heard.keys}

        wait_for(all_permitted_are_heard, 30, "the own topics are heard")
        came = set(heard.wait(FIRST_SECONDS))
    assert came == permitted


QUERIES = {
    key: key(ELSEWHERE)
    for key in (
        *(scenario_key, asset_key, history_key, journal_key),
        *(control_key, world_query_key, link_key),
    )
} | {faults_key: faults_key(ELSEWHERE, "rover/lidar")}


def test_sensor_answers_only_its_own_queries(running: Running, operator: Bus) -> None:
    own = faults_key(ELSEWHERE, "rover/imu")
    with running.secured.session("rover/imu") as intruder:

        def answer(query: object) -> None:
            with query as asked:  # type: ignore[attr-defined]
                asked.reply(f"{str(asked.key_expr).removesuffix('/**')}/0", b"intruder")

        for key in (own, *QUERIES.values()):
            intruder.declare_queryable(f"{key}/**", answer)
        time.sleep(FIRST_SECONDS)
        assert operator.query(own, seconds=20)
        for key in QUERIES.values():
            assert not operator.query(key, seconds=0.5), key


def test_a_sensor_may_send_no_queries(running: Running) -> None:
    """It may ask for the world and not for a pause, which the gateway may for ROS."""
    with running.secured.session("gateway") as gateway:
        assert [r for r in gateway.get(f"{control_key(RUN)}/**", timeout=3) if r.ok]
    with running.secured.session("rover/imu") as intruder:
        assert list(intruder.get(f"{scenario_key(RUN)}/**", timeout=3))
        refused = (
            faults_key(RUN, "rover/lidar"),
            *(key(RUN) for key in (control_key, world_query_key, link_key)),
        )
        for key in refused:
            assert not [r for r in intruder.get(f"{key}/**", timeout=0.5) if r.ok], key


def test_liveliness_under_another_name_is_denied(running: Running, operator: Bus) -> None:
    with running.secured.session("rover/imu") as intruder:
        tokens = [
            intruder.liveliness().declare_token(HEALTH.key_in(ELSEWHERE, process=process))
            for process in ("physics", "gateway", "rover/lidar", "rover/imu")
        ]
        time.sleep(FIRST_SECONDS)
        there = operator.present(HEALTH.key_in(ELSEWHERE), seconds=1.0)
        assert there == {HEALTH.key_in(ELSEWHERE, process="rover/imu")}
        del tokens


@pytest.mark.parametrize(("secret", "why"), [(None, "unsealed"), (bytes(32), "bad_tag")])
def test_datagrams_without_key_are_dropped_and_reported_once(
    running: Running, health: Callable[[str], Health], secret: bytes | None, why: str
) -> None:
    before = health("gateway").counters.get(f"wire_refused_{why}", 0)
    bind = ("127.0.0.1", 0)
    around = open_socket(bind, secret=secret, sends=FROM_ROS_SIDE) if secret else None
    with Link(bind, running.rig.bind, socket=around) as stranger:
        for _ in range(2):
            stranger.send(8, "/clock", "", 1, bytes(12))
            assert stranger.flush(5)

    def is_counted() -> bool:
        return health("gateway").counters.get(f"wire_refused_{why}", 0) > before + 1

    wait_for(is_counted, 30, "it is counted")
    lines = running.rig.log("gateway.log").splitlines()
    assert len([line for line in lines if f"refuses datagrams as {why}: " in line]) == 1


def test_secrets_stay_in_their_files(running: Running) -> None:
    """Neither logs nor lists of processes tell them, and only their owner reads them."""
    folder = running.secured.folder
    secrets = [folder / "bridge.key", *folder.glob("*/key.pem")]
    told = "".join(file.read_text(errors="replace") for file in running.rig.folder.glob("*.log"))
    for process in running.rig.started:
        for what in ("cmdline", "environ"):
            told += Path(f"/proc/{process.pid}/{what}").read_text(errors="replace")
    for file in secrets:
        assert file.stat().st_mode & 0o077 == 0, file
        assert file.parent.stat().st_mode & 0o077 == 0, file
        secret = max(file.read_text().splitlines(), key=len)
        assert secret not in told, file
