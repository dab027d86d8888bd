# SPDX-License-Identifier: Apache-2.0
"""The words of `groundlink fault`: what they mean, and one line where they mean nothing."""

import pytest

from groundlink.cli.run.fault import parsed
from groundlink.core.errors import UserError
from groundlink.scenario import faults


@pytest.mark.parametrize(
    ("words", "seconds", "fault"),
    [
        ("off", None, faults.Off()),
        ("clear", None, None),
        ("stuck", 5.0, faults.Stuck(for_s=5.0)),
        ("bias value=0,0,0.5", 2.0, faults.Bias(value=(0.0, 0.0, 0.5), for_s=2.0)),
        ("bias value=-1 quantity=range", None, faults.Bias(value=-1.0, quantity="range")),
        ("drift per_s=1e-3", None, faults.Drift(per_s=1e-3)),
        ("delay delay_s=0.25", None, faults.Delay(delay_s=0.25)),
        ("time_jump offset_s=-2", None, faults.TimeJump(offset_s=-2.0)),
        (
            "occluded_sector from_deg=-30 to_deg=45",
            1.0,
            faults.OccludedSector(from_deg=-30.0, to_deg=45.0, for_s=1.0),
        ),
    ],
)
def test_words_mean_a_fault(words: str, seconds: float | None, fault: faults.Fault | None) -> None:
    kind, *rest = words.split()
    assert parsed(kind, rest, seconds) == fault


@pytest.mark.parametrize(
    ("words", "seconds", "line"),
    [
        ("stuk", None, "unknown kind of fault `stuk`; did you mean `stuck`?"),
        ("claer", None, "did you mean `clear`?"),
        ("bias valeu=3", None, "`valeu=3`: unknown parameter of `bias`; did you mean `value`?"),
        ("bias 3", None, "`3`: unknown parameter of `bias`"),
        ("bias value=", None, "`value=`: unknown parameter"),
        ("bias", None, "`bias`: parameter `value` is missing. Fix: add value=VALUE"),
        ("bias value=much", None, "bias: `value`: "),
        ("bias value=1,x", None, "bias: `value[1]`: expected `float`, got `str`"),
        (
            "stuck at_s=5",
            None,
            "`at_s=5`: unknown parameter of `stuck`; this kind has no parameters",
        ),
        ("drop share=2", None, "drop: `share`: "),
        ("drift per_s=inf", None, "drift: `per_s` is inf; expected a finite number"),
        ("off", -1.0, "off: `for_s`: "),
        ("clear stuck", None, "`clear` takes no parameters; it ends all faults of the sensor"),
        ("clear", 3.0, "`clear` takes no parameters; it ends all faults of the sensor"),
    ],
)
def test_words_that_mean_none(words: str, seconds: float | None, line: str) -> None:
    kind, *rest = words.split()
    with pytest.raises(UserError) as caught:
        parsed(kind, rest, seconds)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)
