# SPDX-License-Identifier: Apache-2.0
"""A cart as a URDF: two wheels whose frames lie on their sides, a caster and a camera on a mast."""

from pathlib import Path

from groundlink.loader import load
from groundlink.scenario.schema import Vehicle

FOLDER = Path(__file__).parent

CART = (FOLDER / "cart.urdf").read_text(encoding="utf-8")
LINKS = CART[CART.index("  <link") : CART.index("  <joint")]
JOINTS = CART[CART.index("  <joint") : CART.index("</robot>")]

TURRET = CART.replace(
    "</robot>\n",
    (FOLDER / "turret.urdf").read_text(encoding="utf-8").partition("\n")[2],
)
"""The cart with a turret, on it a gun that goes up, on this a ram that goes out."""

MODEL = (FOLDER / "cart.yaml").read_text(encoding="utf-8")
SCENARIO = (FOLDER / "cart_scenario.yaml").read_text(encoding="utf-8")


def scenario(folder: Path, urdf: str | bytes = CART, model: str = MODEL) -> Path:
    """Write a scenario with a cart, and return its file."""
    (folder / "cart.urdf").write_bytes(urdf if isinstance(urdf, bytes) else urdf.encode())
    (folder / "cart.yaml").write_text(model, encoding="utf-8")
    file = folder / "test.yaml"
    file.write_text(SCENARIO, encoding="utf-8")
    return file


def vehicle(folder: Path, urdf: str | bytes = CART, model: str = MODEL) -> Vehicle:
    """Return the vehicle of that scenario."""
    return load(scenario(folder, urdf, model)).vehicles[0]
