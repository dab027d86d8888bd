# SPDX-License-Identifier: Apache-2.0
"""Every seeded fault is found by the clause that is about it; the clean recording has none."""

from copy import deepcopy
from functools import cache

import pytest

from sensor_conformance.checking import check_recording
from sensor_conformance.clauses import TABLE
from sensor_conformance.clauses.clause import Verdict
from sensor_conformance.readings.recording import CheckedRecording, read_topic
from sensor_conformance.report.svg import svg
from sensor_conformance.sources.memory import MemorySource
from sensor_conformance.sources.source import SourceTopic

from . import faults, packet_faults  # noqa: F401  (they fill the list)
from .clean import TOPICS, Messages, messages
from .fault import FAULTS, Fault

WITHOUT_FIGURES = {
    "cloud.fields",
    "frames.connected",
    "frames.known",
    "frames.order",
    "frames.set",
    "frames.slash",
    "frames.tree",
    "image.encoding",
    "odometry.frames",
}
"""Clauses about names."""


@cache
def clean_messages() -> Messages:
    return messages()


@cache
def clean() -> CheckedRecording:
    return CheckedRecording.read(MemorySource(clean_messages()))


def with_fault(fault: Fault) -> CheckedRecording:
    topic = SourceTopic(fault.topic, TOPICS[fault.topic][0])
    altered = deepcopy(clean_messages()[topic])
    changed = fault.alter(altered)
    source = MemorySource({topic: altered if changed is None else changed})
    readings = read_topic(source, topic)
    kept = [readings if one.name == topic.name else one for one in clean().topics]
    return CheckedRecording("altered", kept)


def test_clean_recording_passes_every_clause() -> None:
    report = check_recording(clean())
    assert [(one.clause.id, one.topic, one.result.line) for one in report.findings] == []
    passed = {one.clause.id for one in report.results if one.result.verdict is Verdict.PASSED}
    assert {clause.id for clause in TABLE} - passed == set()


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.clause}: {fault.name}")
def test_fault_is_found(fault: Fault) -> None:
    report = check_recording(with_fault(fault), only=[fault.clause])
    assert report.findings, [one.result.line for one in report.results]


def test_every_clause_has_a_fault() -> None:
    assert {fault.clause for fault in FAULTS} == {clause.id for clause in TABLE}


def test_clauses_with_figures_have_a_picture() -> None:
    drawn = {
        one.clause.id
        for one in check_recording(clean()).results
        if one.result.picture is not None and svg(one.result.picture)
    }
    assert {clause.id for clause in TABLE} - drawn == WITHOUT_FIGURES


def test_table() -> None:
    ids = [clause.id for clause in TABLE]
    assert len(set(ids)) == len(ids)
    for clause in TABLE:
        assert clause.title
        assert clause.source
        assert clause.check.__doc__
