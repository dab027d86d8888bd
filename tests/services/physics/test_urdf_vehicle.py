# SPDX-License-Identifier: Apache-2.0
"""A vehicle that came as a URDF drives like any other."""

from pathlib import Path

import numpy as np
import pytest

from services.physics.trials.track import drive, put
from tests.groundlink.loader.urdf.carts import CART, vehicle
from tests.groundlink.loader.urdf.test_model import BOX, MESH, stl


@pytest.mark.parametrize("body", [BOX, MESH.format("part.stl", "0.5 0.1 0.03")])
def test_it_stands_and_drives_and_turns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str
) -> None:
    monkeypatch.setenv("GROUNDLINK_ASSETS", str(tmp_path / "assets"))
    (tmp_path / "part.stl").write_bytes(stl())
    with put(vehicle(tmp_path, CART.replace(BOX, body)).model) as simulation:
        stood = drive(simulation, 1.0)
        driven = drive(simulation, 4.0, (0.5, 0.0))
        turned = drive(simulation, 4.0, (0.0, 0.5))
    np.testing.assert_allclose(stood.pose[-1, :3], (0, 0, 0.1), atol=1e-3)
    assert driven.velocity[-1, 0] == pytest.approx(0.5, rel=0.01)
    assert abs(driven.pose[-1, 1]) < 0.01
    assert turned.velocity[-1, 5] == pytest.approx(0.5, rel=0.01)
