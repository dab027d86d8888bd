# SPDX-License-Identifier: Apache-2.0
"""The reader of tutorials finds each way in which a page can be wrong."""

import os
from pathlib import Path

import pytest

from .blocks import blocks
from .reader import Instead, Reader

PAGE = """\
# A page

```yaml title="folder/numbers.yaml"
first: 7
```

```sh
cat folder/numbers.yaml   # a comment
grep -c first folder/numbers.yaml
window
```

```text
first: 9
1
```

```sh title="Second terminal, keeps running"
sh -c 'trap "echo ended; exit 1" INT; echo ready in 3 s; while :; do sleep 0.05; done'
```

```text
ready ... 5 s
```

```python
total = 1.5
print("total", total)
```

```text
total 2.5
```

```python
print(total * 2)
```

```yaml title="folder/numbers.yaml (excerpt)"
first: ...
```

```text title="Second terminal, after Ctrl-C"
...
ended
```

```
not compared
```
"""

INSTEAD = {"window": Instead("", "opens a window")}


def follow(text: str, folder: Path) -> None:
    page = folder / "page.md"
    page.write_text(text, encoding="utf-8")
    (folder / "empty").mkdir()
    Reader(folder / "empty", os.environ, (), INSTEAD).follow(page)


@pytest.fixture(autouse=True)
def _root(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tests.docs.blocks.ROOT", tmp_path)


def test_a_right_page_is_followed(tmp_path: Path) -> None:
    follow(PAGE, tmp_path)
    assert (tmp_path / "empty" / "folder" / "numbers.yaml").read_text() == "first: 7\n"


@pytest.mark.parametrize(
    ("right", "wrong", "said"),
    [
        ("grep -c first", "grep -c second", r"page\.md:8: exit code 1"),
        ("cat folder/numbers.yaml  ", "cat numbers.yaml", "No such file"),
        ("first: 9\n1\n", "first: 9\n", r"page\.md:14: expected"),
        ("first: 9\n", "last: 9\n", r"page\.md:14: expected"),
        ("ready ... 5 s", "sleeping", r"page\.md:23: expected"),
        ("total 2.5", "total two", r"page\.md:32: expected"),
        ("print(total * 2)", "print(totals)", "NameError"),
        ("first: ...", "second: ...", "not in folder/numbers"),
        ("\nended\n", "\nasleep\n", r"page\.md:44: expected"),
        ("```\nnot compared", "```yaml\nnot compared", "neither a command nor a file"),
    ],
)
def test_a_wrong_page_is_named(
    right: str, wrong: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.docs.reader.WAIT_S", 2.0)
    assert PAGE.count(right) >= 1
    with pytest.raises(AssertionError, match=said):
        follow(PAGE.replace(right, wrong, 1), tmp_path)


@pytest.mark.parametrize("text", ["```sh\nls\n", "```sh lines=3\nls\n```\n"])
def test_a_fence_that_is_not_understood_is_named(text: str, tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=r"page\.md:1: .*fence"):
        blocks(page)
