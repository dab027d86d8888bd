# SPDX-License-Identifier: Apache-2.0
"""Entry points are those that `importlib.metadata` finds."""

import importlib.metadata
import sys
from pathlib import Path

import pytest

from groundlink.scenario.sensor_kinds import InstalledEntry, entry_points


def found_by_python(group: str) -> list[InstalledEntry]:
    found = importlib.metadata.entry_points(group=group)
    return [
        InstalledEntry(entry.name, entry.value, entry.dist.name) for entry in found if entry.dist
    ]


@pytest.mark.parametrize("group", ["groundlink.sensors", "console_scripts", "pytest11", "none"])
def test_this_environment_has_what_python_finds(group: str) -> None:
    assert sorted(entry_points(group)) == sorted(found_by_python(group))


def install(folder: Path, info: str, metadata: str, name: str, entries: str) -> None:
    (folder / info).mkdir(parents=True)
    (folder / info / metadata).write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
    (folder / info / "entry_points.txt").write_text(entries)


def test_the_first_of_several_installed_distributions_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    near, far = tmp_path / "near", tmp_path / "far"
    entries = "[other]\nx = y:z\n\n[group]\n# comment = no:entry\n sonar= sonars : KIND\n[more]\n"
    install(near, "My_Sonars-2.0.dist-info", "METADATA", "my-sonars", entries)
    install(far, "my.sonars.egg-info", "PKG-INFO", "my.sonars", "[group]\nold = sonars:OLD\n")
    install(far, "radars.egg-info", "PKG-INFO", "radars", "[group]\nradar = radars:KIND\n")
    (near / "single_file.egg-info").write_text("Name: single_file\n")
    monkeypatch.setattr(sys, "path", [str(near), str(tmp_path / "missing"), str(far)])
    assert entry_points("group") == [
        InstalledEntry("sonar", "sonars : KIND", "my-sonars"),
        InstalledEntry("radar", "radars:KIND", "radars"),
    ]
    assert sorted(entry_points("group")) == sorted(found_by_python("group"))
