# SPDX-License-Identifier: Apache-2.0
"""Results as JUnit XML, for CI systems."""

from collections.abc import Sequence
from xml.etree import ElementTree

from .results import FAILED, ExpectationResult


def junit(name: str, results: Sequence[ExpectationResult]) -> str:
    """Return the XML: a suite of this name, and a test case for each expectation.

    An expectation that was not decided is an error of its test case.
    """
    tags = [_tag(result) for result in results]
    suite = ElementTree.Element(
        "testsuite",
        name=name,
        tests=str(len(results)),
        failures=str(tags.count("failure")),
        errors=str(tags.count("error")),
        skipped=str(tags.count("skipped")),
    )
    for result, tag in zip(results, tags, strict=True):
        case = ElementTree.SubElement(
            suite, "testcase", classname=f"{name}.{result.kind}", name=result.name
        )
        if tag:
            ElementTree.SubElement(case, tag, message=result.text)
        else:
            ElementTree.SubElement(case, "system-out").text = result.text
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _tag(result: ExpectationResult) -> str:
    """Return the element that marks a test case; empty for one that passed."""
    if result.skipped:
        return "skipped"
    if not result.is_problem:
        return ""
    return "failure" if result.verdict == FAILED else "error"
