# SPDX-License-Identifier: Apache-2.0
"""The table of types in `wire/types.py` is the one in every other language and document."""

import difflib
import re

import pytest

from tools.wire_types import BLOCKS, ROOT, Block, updated
from udp_bridge.wire.types import MSG_TYPES, STAMP_ORDERED


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: block.file)
def test_a_file_has_the_table_of_the_library(block: Block) -> None:
    text = (ROOT / block.file).read_text(encoding="utf-8")
    lines = difflib.unified_diff(text.splitlines(), updated(block).splitlines(), lineterm="", n=0)
    difference = "\n".join(lines)
    assert not difference, f"{block.file}: run `python -m tools.wire_types`\n{difference}"


def test_the_page_names_the_types_that_stamps_order() -> None:
    page = re.sub(r"\s+", " ", (ROOT / "udp-bridge/PROTOCOL.md").read_text(encoding="utf-8"))
    *most, last = (f"{MSG_TYPES[number].name} ({number})" for number in sorted(STAMP_ORDERED))
    assert f"{', '.join(most)} and {last}" in page
