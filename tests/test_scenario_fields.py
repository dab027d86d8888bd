# SPDX-License-Identifier: Apache-2.0
"""The page of scenario fields is that of the types."""

import difflib
import re

from tools.scenario_fields import PAGE, page


def test_the_page_is_current() -> None:
    before, now = (text.splitlines() for text in (PAGE.read_text(encoding="utf-8"), page()))
    difference = "\n".join(difflib.unified_diff(before, now, "page", "types", lineterm="", n=0))
    assert not difference, f"{PAGE}: run `python -m tools.scenario_fields`\n{difference}"


def test_headings_are_unique_and_links_lead_to_them() -> None:
    text = page()
    headings = re.findall(r"^## (.*)$", text, re.MULTILINE)
    assert len(headings) > 90
    assert len(set(headings)) == len(headings)
    anchors = {heading.replace(".", "") for heading in headings}
    assert set(re.findall(r"\]\(#(.*?)\)", text)) <= anchors
