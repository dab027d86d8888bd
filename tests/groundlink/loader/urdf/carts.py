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

MODEL = """\
urdf: cart.urdf
wheels:
  left_wheel_joint: {friction: 0.9}
  right_wheel_joint:
  caster_joint: {caster: true, friction: 0.02}
drive: {kind: differential, max_wheel_torque_nm: 2.0, max_wheel_speed_radps: 10.0}
"""

SCENARIO = """\
name: test
world:
  name: floor
  materials: {floor: {friction: 1.0}}
  solids:
    - name: floor
      shape: {kind: box, size_m: [40, 40, 1]}
      material: floor
      position_m: [0, 0, -0.5]
vehicles:
  - name: cart
    model: cart.yaml
    sensors:
      - {kind: imu, name: imu, topic: /imu, frame: imu_link, mount: camera}
"""


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
