# SPDX-License-Identifier: Apache-2.0
"""A cart as a URDF: two wheels whose frames lie on their sides, a caster and a camera on a mast."""

from pathlib import Path

from groundlink.loader import load
from groundlink.scenario.schema import Vehicle

LINKS = """\
  <link name="base_footprint"/>
  <link name="base_link">
    <inertial>
      <origin xyz="0 0 0.05"/>
      <mass value="10"/>
      <inertia ixx="0.2" iyy="0.3" izz="0.4" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>
      <origin xyz="0 0 0.05"/>
      <geometry><box size="0.5 0.3 0.1"/></geometry>
      <material name="orange"/>
    </visual>
    <collision>
      <origin xyz="0 0 0.05"/>
      <geometry><box size="0.5 0.3 0.1"/></geometry>
    </collision>
  </link>
  <link name="left_wheel">
    <inertial><mass value="1"/><inertia ixx="0.003" iyy="0.003" izz="0.005"/></inertial>
    <visual>
      <geometry><cylinder radius="0.1" length="0.04"/></geometry>
      <material name="black"><color rgba="0.1 0.1 0.1 1"/></material>
    </visual>
    <collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>
  </link>
  <link name="right_wheel">
    <inertial><mass value="1"/><inertia ixx="0.003" iyy="0.003" izz="0.005"/></inertial>
    <collision><geometry><cylinder radius="0.1" length="0.04"/></geometry></collision>
  </link>
  <link name="caster">
    <collision><geometry><sphere radius="0.05"/></geometry></collision>
  </link>
  <link name="mast">
    <inertial>
      <origin xyz="0 0 0.1"/>
      <mass value="2"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.001"/>
    </inertial>
  </link>
  <link name="camera"/>
"""

JOINTS = """\
  <joint name="base_joint" type="fixed">
    <parent link="base_footprint"/>
    <child link="base_link"/>
    <origin xyz="0 0 0.1"/>
  </joint>
  <joint name="left_wheel_joint" type="continuous">
    <parent link="base_link"/>
    <child link="left_wheel"/>
    <origin xyz="0 0.2 0" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>
  <joint name="right_wheel_joint" type="continuous">
    <parent link="base_link"/>
    <child link="right_wheel"/>
    <origin xyz="0 -0.2 0" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>
  <joint name="caster_joint" type="fixed">
    <parent link="base_link"/>
    <child link="caster"/>
    <origin xyz="0.2 0 -0.05"/>
  </joint>
  <joint name="pan" type="revolute">
    <parent link="base_link"/>
    <child link="mast"/>
    <origin xyz="0.2 0 0.1"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="tilt" type="fixed">
    <parent link="mast"/>
    <child link="camera"/>
    <origin xyz="0 0 0.2" rpy="0 0.1 0"/>
  </joint>
"""

CART = f"""\
<?xml version="1.0"?>
<robot name="cart">
  <material name="orange"><color rgba="1 0.5 0 1"/></material>
{LINKS}{JOINTS}</robot>
"""

TURRET = CART.replace(
    "</robot>",
    """\
  <link name="turret">
    <inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial>
    <visual><geometry><cylinder radius="0.1" length="0.1"/></geometry></visual>
    <collision><geometry><cylinder radius="0.1" length="0.1"/></geometry></collision>
  </link>
  <link name="gun">
    <inertial><mass value="0.2"/><inertia ixx="0.001" iyy="0.001" izz="0.001"/></inertial>
    <visual><origin xyz="0.25 0 0"/><geometry><box size="0.5 0.02 0.02"/></geometry></visual>
  </link>
  <link name="ram">
    <inertial><mass value="0.1"/><inertia ixx="0.001" iyy="0.001" izz="0.001"/></inertial>
  </link>
  <joint name="turret" type="continuous">
    <parent link="base_link"/>
    <child link="turret"/>
    <origin xyz="0 0 0.1" rpy="0 0 0.5"/>
    <axis xyz="0 0 2"/>
    <limit effort="9" velocity="0.5"/>
  </joint>
  <joint name="gun" type="revolute">
    <parent link="turret"/>
    <child link="gun"/>
    <origin xyz="0.2 0 0.1" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 -1"/>
    <limit lower="-0.1" upper="0.4" effort="9" velocity="0.2"/>
    <!-- gun -->
  </joint>
  <joint name="ram" type="prismatic">
    <parent link="gun"/>
    <child link="ram"/>
    <origin xyz="0.3 0 0"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" effort="9" velocity="0.1"/>
  </joint>
</robot>""",
)
"""A cart with a turret, on it a gun that goes up, on this a ram that goes out."""

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
