# SPDX-License-Identifier: Apache-2.0
"""Pictures of docs/pictures: ``python -m tools.pictures [NAME ...]``.

Without names it lists each picture with its commands. With names it runs these commands in the
repository's folder and stores the pictures, with fewer colors where that makes a file small.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "docs" / "pictures"

PYTHON = ".venv/bin/python"
GROUNDLINK = ".venv/bin/groundlink"


@dataclass(frozen=True)
class Recipe:
    """How a picture is made."""

    commands: tuple[str, ...]
    """Lines for a shell in the repository's folder; OUT is the picture."""

    colors: int | None = None
    """Number of colors of the stored picture; none: as the commands leave it."""

    needs: str = ""
    """Requirements beyond the environment."""

    by_hand: bool = False
    """Whether somebody has to run the commands: in another folder, or before a screenshot."""


def world(name: str) -> Recipe:
    """Return the recipe of a world's portrait."""
    return Recipe((f"{GROUNDLINK} world show {name} --size 720x480 --out OUT",), colors=128)


def vehicle(name: str) -> Recipe:
    """Return the recipe of a vehicle's portrait."""
    return Recipe((f"{GROUNDLINK} world show {name} --size 640x480 --out OUT",), colors=128)


def tutorial(words: str) -> Recipe:
    """Return the recipe of a picture that the tutorial of worlds makes."""
    return Recipe(
        (f"groundlink world show {words} --out OUT",),
        needs="the files of docs/tutorials/your-own-world.md; in their folder",
        by_hand=True,
    )


def panels(name: str) -> Recipe:
    """Return the recipe of a sheet of camera pictures."""
    return Recipe((f"{PYTHON} -m tools.pictures.panels {name} OUT",), colors=200)


RECIPES = {
    "moving.webp": Recipe((f"{PYTHON} -m tools.pictures.moving OUT",)),
    "bridge.png": Recipe((f"{PYTHON} -m benchmarks.bridge --only latency --figure OUT",)),
    "freshness.png": Recipe(
        (f"{PYTHON} -m benchmarks.freshness --seconds 15 --picture OUT",),
        needs="the right to create network namespaces",
    ),
    "scale.png": Recipe((f"{PYTHON} -m benchmarks.scale.model --picture OUT",)),
    **{f"{name}.png": panels(name) for name in ("camera", "camera_effects", "camera_rural")},
    **{f"{name}.png": panels(name) for name in ("depth", "meadow", "terrain")},
    "labels.png": Recipe((f"{PYTHON} -m tools.pictures.labels OUT",), colors=128),
    "ruts.png": Recipe((f"{PYTHON} -m tools.pictures.ruts OUT",), colors=128),
    **{f"world_{name}.png": world(name) for name in ("lab", "rural", "track", "valley", "yard")},
    **{
        f"vehicle_{name}.png": vehicle(name)
        for name in "car decontamination_robot mecanum_base rocker_bogie rover tank trailer".split()
    },
    "tutorial_cart.png": tutorial("cart.yaml --from 60,20"),
    "tutorial_ride.png": tutorial("ride.yaml --from 160,35"),
    "report.png": Recipe(
        (
            f"{GROUNDLINK} record outdoor_paper --out build/pictures/report.mcap --duration 21.5",
            f"{GROUNDLINK} report build/pictures/report.mcap",
            "chromium --headless --no-sandbox --hide-scrollbars --screenshot=OUT"
            " --window-size=1040,3000 build/pictures/report.html",
        ),
        colors=200,
        needs="Chromium",
    ),
    "trials.png": Recipe(
        (
            f"{GROUNDLINK} try car --out build/pictures/trials.html",
            "chromium --headless --no-sandbox --hide-scrollbars --screenshot=OUT"
            " --window-size=1040,1500 build/pictures/trials.html",
        ),
        colors=64,
        needs="Chromium",
    ),
    "view.png": Recipe(
        (
            f"{GROUNDLINK} record indoor_lab_tour --out build/pictures/view.mcap --duration 27",
            f"{GROUNDLINK} view build/pictures/view.mcap --save build/pictures/view.rrd",
            f"{PYTHON} -m tools.pictures.screenshot build/pictures/view.rrd OUT 27",
        ),
        colors=128,
    ),
    "rviz.png": Recipe(
        (
            f"{GROUNDLINK} up --no-ros indoor_lab",
            "roslaunch udp_bridge_ros1 bridge.launch bind:=127.0.0.1:7511 peer:=127.0.0.1:7510"
            " rviz:=true",
        ),
        needs="ROS 1, RViz and a screen; each command in a terminal of its own, then a screenshot",
        by_hand=True,
    ),
}
"""Recipes by file. `processes.svg` is drawn by hand; `python -m tools.plots` makes `models/`."""


def make(name: str) -> Path:
    """Make a picture; return its file."""
    recipe, out = RECIPES[name], PICTURES / name
    (ROOT / "build" / "pictures").mkdir(parents=True, exist_ok=True)
    for command in recipe.commands:
        subprocess.run(command.replace("OUT", str(out)).split(), cwd=ROOT, check=True)
    if recipe.colors is not None:
        reduced(out, recipe.colors)
    return out


def reduced(file: Path, colors: int) -> None:
    """Store a picture again with a palette."""
    with Image.open(file) as picture:
        smaller = picture.convert("RGB").quantize(
            colors, method=Image.Quantize.MAXCOVERAGE, kmeans=2
        )
    smaller.save(file, optimize=True)


def main(arguments: Sequence[str]) -> None:
    """List the pictures, or make some."""
    parser = argparse.ArgumentParser(prog="python -m tools.pictures", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="such as moving.webp")
    names = parser.parse_args(arguments).names
    runnable = {name for name, recipe in RECIPES.items() if not recipe.by_hand}
    if unknown := set(names) - runnable:
        parser.error(
            f"no commands to run for {', '.join(sorted(unknown))}; expected one of "
            f"{', '.join(sorted(runnable))}"
        )
    for name in names:
        print(make(name).relative_to(ROOT), flush=True)
    if not names:
        for name, recipe in RECIPES.items():
            print(f"{name}{f'  (needs {recipe.needs})' if recipe.needs else ''}")
            print("".join(f"    {command}\n" for command in recipe.commands), end="")


if __name__ == "__main__":
    main(sys.argv[1:])
