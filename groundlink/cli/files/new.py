# SPDX-License-Identifier: Apache-2.0
"""`groundlink new SCENARIO`: write a minimal scenario that runs, as a starting point."""

import argparse
from pathlib import Path

import msgspec

from groundlink.cli import Subparsers
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.every_sensor import Name

SCHEMA = SHIPPED / "schemas" / "scenario.json"

TEMPLATE = """\
# yaml-language-server: $schema={schema}
# A scenario: a world, and vehicles with sensors. To check it, and to run it with a viewer:
#
#     groundlink check {file}
#     groundlink up {file} --view
#
# A field that is left out has its default. `groundlink explain lidar` lists the fields of a
# sensor, `groundlink explain world.room` those of a room. Axes are x east, y north, z up, in
# meters.
name: {name}
seed: 1

# A world of its own. `world: lab` takes a shipped one; others are rural, scanned_room, track,
# valley and yard. Materials such as linoleum and wood come from the library of materials.
world:
  name: {name}
  room:
    size_m: [8.0, 6.0, 3.0]
    floor_material: linoleum
    wall_material: plaster
  furniture:
    - {{kind: table, at_m: [-2.0, 2.3]}}
    - {{kind: cabinet, at_m: [3.4, 2.0], yaw_deg: 90.0}}
    - {{kind: shelf, at_m: [0.5, -2.7], yaw_deg: 180.0}}
    - {{kind: pillar, at_m: [3.0, -2.0]}}

vehicles:
  - name: rover
    model: rover # or car, tank, mecanum_base, rocker_bogie, decontamination_robot, your file
    placement: {{x_m: -2.5, y_m: 0.0, yaw_deg: 0.0}}
    sensors:
      # `groundlink sensors` lists the data sheets; a field here overrides that of the sheet.
      - kind: lidar
        datasheet: vlp16
        name: lidar
        topic: /points
        frame: lidar_link
        mount: mast
      - {{kind: imu, datasheet: imu_mti1, name: imu, topic: /imu, frame: imu_link, mount: imu}}
      - {{kind: encoders, name: encoders, topic: /wheel_encoders, frame: base_link}}
    # The rover drives by itself. Without a route it obeys /cmd_vel, and `groundlink drive`.
    route:
      kind: waypoints
      speed_mps: 0.6
      closed: true
      laps: 20
      points:
        - {{x_m: 0.0, y_m: -1.0}}
        - {{x_m: 2.0, y_m: 0.0}}
        - {{x_m: 0.0, y_m: 1.0}}
        - {{x_m: -2.5, y_m: 0.0}}
"""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("new", help="write a minimal scenario that runs")
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO[.yaml]", help="name or path of the new file"
    )
    parser.set_defaults(command=new)


def new(options: argparse.Namespace) -> int:
    """Write the file and print the next steps."""
    file = options.scenario.with_suffix(".yaml")
    try:
        msgspec.convert(file.stem, Name)
    except msgspec.ValidationError:
        raise UserError(
            f"`{file.stem}`: expected lower case letters, digits and underscores, a letter first"
        ) from None
    check_new_file("new", file)
    text = TEMPLATE.format(name=file.stem, file=file, schema=SCHEMA)
    with write_atomically(file) as part:
        part.write_text(text, encoding="utf-8")
    print(f"{file}: written. Next: groundlink up {file} --view")
    return 0
