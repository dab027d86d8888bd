# SPDX-License-Identifier: Apache-2.0
"""Definitions of entities: whole ones, and broken ones.

They are in the formats that the standard names, or in that of a file of the user.
"""

from collections.abc import Sequence
from pathlib import Path

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

BROKEN = "\n{[: <broken off"
"""Text that is well-formed in no format."""


class Definitions:
    """Definitions that a simulator can parse, and some that it can't.

    Parameters
    ----------
    formats
        Those that the simulator announces, as spawn_formats.
    file
        A whole definition in a format of the simulator's own, or None.
    """

    def __init__(self, formats: Sequence[str], file: Path | None) -> None:
        self._formats = formats
        self._file = file

    def whole(self) -> str:
        """Return the user's definition, or one in the first supported format that is known."""
        if self._file:
            return self._file.read_text(encoding="utf-8")
        return WELL_FORMED[self._known(WELL_FORMED)]

    def broken(self) -> tuple[str, str]:
        """Return a file name suffix and a broken definition of that format."""
        if self._file:
            text = self.whole()
            return self._file.suffix, text[: len(text) // 2] + BROKEN
        known = self._known(MALFORMED)
        return f".{SUFFIXES.get(known, known)}", MALFORMED[known]

    def _known(self, texts: dict[str, str]) -> str:
        for name in self._formats:
            if name in texts:
                return name
        listed = ", ".join(texts)
        not_tested(f"spawn_formats has none of {listed}; name a file with --definition")
