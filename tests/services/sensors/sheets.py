# SPDX-License-Identifier: Apache-2.0
"""Sensors as the shipped data sheets describe them."""

from typing import Any, TypeVar

import msgspec
import yaml

from groundlink.loader.scenario_files import SHIPPED

Spec = TypeVar("Spec")


def from_sheet(kind: type[Spec], sheet: str, **further: Any) -> Spec:
    """Return a sensor of a shipped data sheet, which says what it is and not where."""
    text = (SHIPPED / "sensors" / f"{sheet}.yaml").read_text()
    fields: dict[str, Any] = yaml.safe_load(text)
    place = {"name": "it", "topic": "/it", "frame": "it_link"}
    assert not place.keys() & fields.keys()
    return msgspec.convert(fields | place | further, kind)
