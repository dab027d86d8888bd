# SPDX-License-Identifier: Apache-2.0
"""JUnit XML has a test case for each expectation; what has not passed has one line."""

from xml.etree import ElementTree

import pytest

from groundlink.expectations.junit import junit
from groundlink.expectations.results import (
    FAILED,
    PASSED,
    UNDECIDED,
    ExpectationResult,
    Verdict,
    problems,
)


def result(name: str, verdict: Verdict, *, skipped: bool = False) -> ExpectationResult:
    return ExpectationResult(
        name=name,
        kind="reaches",
        verdict=verdict,
        value=0.2,
        limit=0.3,
        unit="m",
        at_s=1.0,
        text=f"<{name}> & 0.2 m",
        skipped=skipped,
    )


RESULTS = [
    result("good", PASSED),
    result("bad", FAILED),
    result("short", UNDECIDED),
    result("other", UNDECIDED, skipped=True),
]


def test_a_test_case_for_each_expectation() -> None:
    (suite,) = ElementTree.fromstring(junit("lab", RESULTS))
    counts = {"tests": "4", "failures": "1", "errors": "1", "skipped": "1"}
    assert suite.attrib == {"name": "lab"} | counts
    assert [case.attrib for case in suite] == [
        {"classname": "lab.reaches", "name": one.name} for one in RESULTS
    ]


@pytest.mark.parametrize(
    ("number", "tag"), [(0, "system-out"), (1, "failure"), (2, "error"), (3, "skipped")]
)
def test_a_verdict_is_an_element(number: int, tag: str) -> None:
    case = ElementTree.fromstring(junit("lab", RESULTS))[0][number]
    (element,) = case
    assert element.tag == tag
    assert (element.get("message") or element.text) == RESULTS[number].text


def test_what_was_not_decided_is_a_problem_unless_skipped() -> None:
    assert problems(RESULTS) == [
        "bad: <bad> & 0.2 m",
        "short: undecided, <short> & 0.2 m",
    ]
