# SPDX-License-Identifier: Apache-2.0
"""Assets over the bus, between two stores: whole, unchanged, and nothing but what is named."""

import threading
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.bus.queries import asset_key, scenario_key
from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.process import asset_exchange
from groundlink.process.joining import join_world
from groundlink.scenario import Scenario
from groundlink.world import assets
from groundlink.world.assets import VARIABLE
from groundlink.world.mesh_asset import encode_mesh
from groundlink.world.solids import Mesh, Solid
from groundlink.world.terrain import Terrain

RUN = "one"


@pytest.fixture
def stores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, Path]:
    """The stores of two machines; the first is in use until a test changes to the other."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "theirs"))
    return tmp_path / "theirs", tmp_path / "ours"


def with_assets(heights: bytes) -> Scenario:
    """Return the laboratory with terrain and a mesh, whose assets are in the store."""
    mesh = assets.put(encode_mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32)))
    shape = Mesh(asset=mesh, low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 1.0))
    scenario = load("indoor_lab")
    world = scenario.world
    ground = Terrain(
        heights=assets.put(heights),
        surface=assets.put(b"surface"),
        cell_m=1.0,
        at_m=(0.0, 0.0, 0.0),
        low_m=(0.0, 0.0, 0.0),
        high_m=(0.0, 0.0, 0.0),
        materials=("wood",),
    )
    solid = Solid("thing", shape, "wood", (50.0, 0.0, 0.0))
    return replace(scenario, world=replace(world, terrain=ground, solids=(solid, solid)))


SIZES = [
    0,
    asset_exchange.PART_BYTES - 1,
    asset_exchange.PART_BYTES,
    2 * asset_exchange.PART_BYTES + 17,
]


@pytest.mark.parametrize("size", SIZES)
def test_missing_asset_is_fetched_completely(
    endpoint: str,
    stores: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
    size: int,
) -> None:
    scenario = with_assets(np.random.default_rng(size).bytes(size))
    needed = asset_exchange.needed(scenario)
    assert len(needed) == 3
    server = _Server(endpoint, scenario, stores[0])
    with server, Bus(connect=endpoint) as bus:
        monkeypatch.setenv(VARIABLE, str(stores[1]))
        assert assets.missing(needed) == needed
        name, joined = join_world(bus, None, threading.Event())
        assert (name, joined) == (RUN, scenario)
        assert assets.missing(needed) == []
        asked = server.asked
        join_world(bus, None, threading.Event())
        assert server.asked == asked  # What is there is not asked for again.


def test_only_what_the_scenario_names_is_served(
    endpoint: str,
    stores: tuple[Path, Path],
) -> None:
    scenario = with_assets(b"heights")
    secret = assets.put(b"secret")
    with _Server(endpoint, scenario, stores[0]), Bus(connect=endpoint) as bus:
        for asked in (f"{secret}/0", "../../etc/passwd/0", f"{scenario.world.terrain}/0", "", "x"):
            assert bus.query(asset_key(RUN), asked, seconds=2.0) == {}


def test_what_has_another_digest_is_refused(
    endpoint: str,
    stores: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scenario = with_assets(b"heights")
    assert scenario.world.terrain is not None
    digest = scenario.world.terrain.heights
    (stores[0] / digest).write_bytes(b"other heights")
    with _Server(endpoint, scenario, stores[0]), Bus(connect=endpoint) as bus:
        monkeypatch.setenv(VARIABLE, str(stores[1]))
        with pytest.raises(UserError, match=f"asset {digest[:12]}: content has digest"):
            asset_exchange.fetch(bus, RUN, scenario)
        assert not assets.has(digest)
        (stores[0] / digest).unlink()
        with pytest.raises(UserError, match=f"asset {digest[:12]}: not served"):
            asset_exchange.fetch(bus, RUN, scenario)


class _Server:
    """Serves a run's scenario and assets from a store of its own, as physics does."""

    def __init__(self, endpoint: str, scenario: Scenario, store: Path) -> None:
        self._bus = Bus(connect=endpoint)
        self._scenario = scenario
        self._store = store
        self.asked = 0

    def __enter__(self) -> "_Server":
        serve = self._bus.serve

        def counted(key: str, answer) -> None:  # type: ignore[no-untyped-def]
            def of_this_store(parameters: str) -> list[bytes]:
                self.asked += 1
                with pytest.MonkeyPatch.context() as patch:
                    patch.setattr(assets, "folder", lambda: self._store)
                    result: list[bytes] = answer(parameters)
                return result

            serve(key, of_this_store)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(self._bus, "serve", counted)
            asset_exchange.serve(self._bus, RUN, lambda: self._scenario)
        serve(scenario_key(RUN), lambda _: [msgspec.msgpack.encode(self._scenario)])
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()
