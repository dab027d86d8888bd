# SPDX-License-Identifier: Apache-2.0
"""The registry of sensor kinds: entry points, names, and what importing it loads."""

import subprocess
import sys
import tomllib
from importlib.util import find_spec
from pathlib import Path

import pytest

from groundlink.core.errors import UserError
from groundlink.scenario import sensor_kinds as registry
from groundlink.scenario.sensor_kinds import (
    InstalledEntry,
    distribution_of,
    load_reference,
    sensor_kinds,
)

ROOT = Path(__file__).parents[3]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
DECLARED = PROJECT["project"]["entry-points"][registry.GROUP]

SHIPPED = {name: kind for name, kind in sensor_kinds().items() if name in DECLARED}


def test_every_declared_kind_is_found_in_order() -> None:
    assert list(SHIPPED) == sorted(DECLARED)
    assert list(sensor_kinds())[: len(SHIPPED)] == list(SHIPPED)
    assert {distribution_of(name) for name in SHIPPED} == {registry.OWN_DISTRIBUTION}


def test_every_shipped_kind_is_one_folder_that_runs_as_a_process() -> None:
    for name, kind in SHIPPED.items():
        assert DECLARED[name] == f"services.sensors.{name}:KIND"
        assert kind.package == f"services.sensors.{name}"
        assert find_spec(f"{kind.package}.__main__")
        for reference in (kind.model, kind.native):
            assert not reference or callable(load_reference(reference))


def test_the_import_contracts_name_every_kind() -> None:
    contracts = {row["name"]: row for row in PROJECT["tool"]["importlinter"]["contracts"]}
    kinds = contracts["Kinds of sensors never import each other"]["modules"]
    assert sorted(kinds) == [kind.package for kind in SHIPPED.values()]


def test_the_registry_imports_no_model() -> None:
    code = (
        "import sys, groundlink.bus.topics\n"
        "kinds = [m for m in sys.modules if m.startswith('services.sensors.')]\n"
        "assert kinds and not [m for m in kinds if m.endswith('.model')], kinds\n"
        "assert 'rosbags' not in sys.modules and 'zenoh' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("no_such_package:KIND", "cannot import no_such_package:KIND: No module named"),
        ("services.sensors.imu:KIND", "is not a SensorKind of this name"),
        ("services.sensors.imu:__doc__", "is not a SensorKind of this name"),
    ],
)
def test_an_entry_point_that_cannot_be_used_is_one_line(
    value: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = InstalledEntry("sonar", value, "sonars")
    monkeypatch.setattr(registry, "entry_points", lambda group: [entry])
    with pytest.raises(UserError, match="sensor kind `sonar`") as caught:
        sensor_kinds.__wrapped__()
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_without_any_kind_the_error_names_the_group(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "entry_points", lambda group: [])
    with pytest.raises(UserError, match=r"group `groundlink\.sensors`"):
        sensor_kinds.__wrapped__()
