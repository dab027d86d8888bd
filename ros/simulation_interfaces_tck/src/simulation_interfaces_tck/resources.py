# SPDX-License-Identifier: Apache-2.0
"""Definitions of entities in the formats that the standard names: whole ones, and broken ones."""

from collections.abc import Sequence

from .client import not_tested

WELL_FORMED = {
    "urdf": """<?xml version="1.0"?>
<robot name="tck">
  <link name="base_link">
    <inertial>
      <mass value="1.0"/>
      <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/>
    </inertial>
    <visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual>
    <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision>
  </link>
</robot>
""",
    "sdf": """<?xml version="1.0"?>
<sdf version="1.9">
  <model name="tck">
    <link name="base_link">
      <visual name="v"><geometry><box><size>0.2 0.2 0.2</size></box></geometry></visual>
      <collision name="c"><geometry><box><size>0.2 0.2 0.2</size></box></geometry></collision>
    </link>
  </model>
</sdf>
""",
    "mjcf": """<mujoco model="tck">
  <worldbody>
    <body name="base_link"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
  </worldbody>
</mujoco>
""",
}
"""A box of 20 cm in each format."""

MALFORMED = {
    "urdf": '<?xml version="1.0"?>\n<robot name="tck"><link name="base_link">',
    "sdf": '<?xml version="1.0"?>\n<sdf version="1.9"><model name="tck">',
    "mjcf": '<mujoco model="tck"><worldbody>',
    "usd": "#usda 1.0\ndef Xform {{{",
}
"""What breaks off in the middle."""

SUFFIXES = {"mjcf": "xml", "usd": "usda"}
"""File name suffixes that differ from the names of the formats."""


def well_formed(formats: Sequence[str]) -> str:
    """Return a definition in the first supported format that is known."""
    return WELL_FORMED[_known(formats, WELL_FORMED)]


def malformed(formats: Sequence[str]) -> tuple[str, str]:
    """Return a file name suffix and a broken definition in the first known format."""
    known = _known(formats, MALFORMED)
    return SUFFIXES.get(known, known), MALFORMED[known]


def _known(formats: Sequence[str], texts: dict[str, str]) -> str:
    for name in formats:
        if name in texts:
            return name
    not_tested(f"spawn_formats has none of {', '.join(texts)}")
