# SPDX-License-Identifier: Apache-2.0
"""Results as JUnit XML, for CI systems."""

from xml.etree import ElementTree

from sensor_conformance.checking import CheckReport
from sensor_conformance.clauses.clause import Verdict


def junit(report: CheckReport) -> str:
    """Return the XML: a suite, and a test case for each clause and topic."""
    counts = report.counts()
    suite = ElementTree.Element(
        "testsuite",
        name=report.name,
        tests=str(len(report.results)),
        failures=str(counts[Verdict.FAILED]),
        skipped=str(counts[Verdict.NOT_TESTED]),
        errors="0",
    )
    for one in report.results:
        case = ElementTree.SubElement(suite, "testcase", classname=one.clause.id, name=one.topic)
        properties = ElementTree.SubElement(case, "properties")
        for name, value in (("source", one.clause.source), ("figures", one.result.line)):
            ElementTree.SubElement(properties, "property", name=name, value=value)
        if one.result.verdict is Verdict.FAILED:
            ElementTree.SubElement(case, "failure", message=one.result.line).text = one.clause.title
        elif one.result.verdict is Verdict.NOT_TESTED:
            ElementTree.SubElement(case, "skipped", message=one.result.line)
    root = ElementTree.Element("testsuites")
    root.append(suite)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)
