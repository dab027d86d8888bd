# SPDX-License-Identifier: Apache-2.0
"""The documentation site builds without a warning, from the pages alone."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PARTS = ("tutorials", "how-to", "reference", "explanation")


def build(folder: Path, out: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("site")
    done = build(ROOT, out)
    assert done.returncode == 0, done.stderr
    return out


def test_nothing_is_loaded_from_the_network(site: Path) -> None:
    pages = list(site.rglob("*.html"))
    assert len(pages) > 40
    loading = re.compile(r"<(?:script|link|img|iframe)\b[^>]*?\b(?:src|href)=[\"']?(?:https?:)?//")
    assert [page for page in pages if loading.search(page.read_text(encoding="utf-8"))] == []


def test_pages_outside_of_docs_belong_to_the_site(site: Path) -> None:
    page = (site / "repository" / "ARCHITECTURE.html").read_text(encoding="utf-8")
    assert 'href="../explanation/time.html"' in page
    assert 'src="../pictures/processes.svg"' in page
    assert (site / "repository" / "udp-bridge" / "cpp" / "udp_bridge.hpp").exists()


def test_search_knows_the_pages(site: Path) -> None:
    index = (site / "search" / "search_index.json").read_text(encoding="utf-8")
    assert all(f'"{part}/' in index for part in PARTS)


def test_every_page_stands_in_one_of_the_four_parts() -> None:
    docs = ROOT / "docs"
    loose = [page for page in docs.rglob("*.md") if page.relative_to(docs).parts[0] not in PARTS]
    assert loose == [docs / "index.md"]


def test_a_broken_link_anchor_picture_or_navigation_fails_the_build(tmp_path: Path) -> None:
    config = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    nav = yaml.safe_dump({"nav": [{"Home": "index.md"}]})
    (tmp_path / "mkdocs.yml").write_text(config.partition("\nnav:\n")[0] + "\n" + nav)
    (tmp_path / "tools").symlink_to(ROOT / "tools")
    docs = tmp_path / "docs"
    docs.mkdir()
    (docs / "loose.md").write_text("# Loose\n")
    (docs / "index.md").write_text(
        "# Home\n\n[a](nowhere.md) [b](loose.md#nowhere) ![c](none.png) [d](../NONE.md)\n"
    )
    done = build(tmp_path, tmp_path / "site")
    assert done.returncode == 1
    assert done.stderr.count("WARNING -") == 5, done.stderr
    for named in ("'nowhere.md'", "'loose.md#nowhere'", "'none.png'", "'../NONE.md'", "- loose.md"):
        assert named in done.stderr
