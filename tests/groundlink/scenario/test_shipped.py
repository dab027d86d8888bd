# SPDX-License-Identifier: Apache-2.0
"""What comes with Groundlink comes with its package, too, and not only with a checkout."""

import tomllib
from pathlib import Path

import groundlink
from groundlink.loader.scenario_files import SHIPPED

PACKAGE = Path(groundlink.__file__).parent
PYPROJECT = PACKAGE.parent / "pyproject.toml"


def test_an_installed_package_has_all_that_is_shipped() -> None:
    tables = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))
    patterns = tables["tool"]["setuptools"]["package-data"]["groundlink"]
    packed = {file.resolve() for pattern in patterns for file in PACKAGE.glob(pattern)}
    assert SHIPPED == PACKAGE.parent / "scenarios"
    assert packed == {file for file in SHIPPED.rglob("*") if file.is_file()}
