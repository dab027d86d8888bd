# SPDX-License-Identifier: Apache-2.0
"""A claim holds up to its limit, and a benchmark fails where one does not."""

import argparse
import json
from pathlib import Path

import pytest

from benchmarks.claims import Claim, add_options, judge


@pytest.mark.parametrize(
    ("value", "is_at_least", "holds"),
    [(2.0, True, True), (1.99, True, False), (2.0, False, True), (2.01, False, False)],
)
def test_a_claim_holds_up_to_its_limit(
    value: float, is_at_least: bool, holds: bool, tmp_path: Path
) -> None:
    claim = Claim("a", value, 2.0, is_at_least)
    assert claim.holds is holds
    assert ("NOT" in str(claim)) is not holds
    parser = argparse.ArgumentParser()
    add_options(parser)
    file = tmp_path / "claims.json"
    assert judge([claim], parser.parse_args(["--claims", str(file)])) == 0
    assert [Claim(**row) for row in json.loads(file.read_text(encoding="utf-8"))] == [claim]
    assert judge([claim], parser.parse_args(["--check"])) == int(not holds)
