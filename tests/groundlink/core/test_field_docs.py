# SPDX-License-Identifier: Apache-2.0
"""Docstrings below the fields of structs are found by class and field."""

import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from groundlink.core.field_docs import field_descriptions, summary
from groundlink.core.fields import Spec

ROOT = Path(__file__).resolve().parents[3]


class Base(Spec, frozen=True, kw_only=True):
    """A base."""

    rate_hz: float = 1.0
    """Rate of the base,
    over two lines."""

    gain: float = 1.0
    """Gain of the base."""

    plain: int = 0

    def method(self) -> None:
        """Return nothing: the docstring of no field."""


class Derived(Base, frozen=True, kw_only=True):
    """A derived struct."""

    rate_hz: float = 2.0
    gain: float = 2.0
    """Gain of the derived struct."""

    class_: int = msgspec.field(name="class", default=0)
    """A field with another key in files."""


def test_a_docstring_belongs_to_the_field_above_it() -> None:
    assert field_descriptions(Base) == {
        "rate_hz": "Rate of the base, over two lines.",
        "gain": "Gain of the base.",
    }


def test_a_field_has_its_own_docstring_or_that_of_the_base() -> None:
    assert field_descriptions(Derived) == {
        "rate_hz": "Rate of the base, over two lines.",
        "gain": "Gain of the derived struct.",
        "class": "A field with another key in files.",
    }


def test_a_struct_without_a_source_has_no_descriptions() -> None:
    made = msgspec.defstruct("Made", [("rate_hz", float)], module="no_such_module")
    assert field_descriptions(made) == {}


@pytest.mark.parametrize("text", ["", "One line.", "Two\n    lines.\n\n    More."])
def test_the_summary_is_the_first_paragraph(text: str) -> None:
    assert summary(text) == {"": "", "O": "One line.", "T": "Two lines."}[text[:1]]


def test_loading_a_scenario_reads_no_docstrings() -> None:
    program = (
        "import sys; from groundlink.loader import load; load('indoor_lab');"
        "print([name for name in sys.modules if name.startswith('groundlink.loader.field')])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout == "[]\n"
