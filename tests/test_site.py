# SPDX-License-Identifier: Apache-2.0
"""The documentation site builds without a warning; its pages quote what the code says."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import groundlink
import udp_bridge
from groundlink.core import VERSION
from groundlink.loader import load
from groundlink.ros.cdr import CODECS
from groundlink.scenario.sensor_kinds import sensor_kinds
from tests.bridge.programs import need
from tools import error_reference as errors
from tools.command_reference import page

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
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


def test_search_works_in_a_page_from_the_disk(site: Path, tmp_path: Path) -> None:
    need("chromium")
    done = subprocess.run(
        [
            *("chromium", "--headless", "--no-sandbox", "--disable-gpu", "--dump-dom"),
            *("--disable-dev-shm-usage", f"--user-data-dir={tmp_path / 'profile'}"),
            *("--virtual-time-budget=10000", f"{(site / 'index.html').as_uri()}?q=backscatter"),
        ],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert "explanation/sensor-models.html?h=backscatter#lidar" in done.stdout, done.stderr


def test_pages_have_the_version_and_formulas_without_a_script(site: Path) -> None:
    page = (site / "explanation" / "sensor-models.html").read_text(encoding="utf-8")
    assert f"- Groundlink {VERSION}</title>" in page
    assert page.count("<math ") == text("explanation/sensor-models.md").count("```math\n") > 15
    assert "\\frac" not in page


def test_every_page_stands_in_one_of_the_four_parts() -> None:
    loose = [page for page in DOCS.rglob("*.md") if page.relative_to(DOCS).parts[0] not in PARTS]
    assert loose == [DOCS / "index.md"]


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


def text(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def test_the_commands_are_those_of_the_parser() -> None:
    assert text("reference/commands.md") == page(), "run: python -m tools.command_reference"


def test_the_errors_are_those_of_the_sources() -> None:
    assert text("reference/errors.md") == errors.page(), "run: python -m tools.error_reference"


def test_the_streams_and_ros_types_are_those_of_the_code() -> None:
    listed = text("reference/topics.md")
    rows = re.findall(r"^\| ([`\w, ]+) \| (?:`(\w+)` )?\| ([\w/]+)", listed, re.MULTILINE)
    found = {
        (k, name, ros_type) for kinds, name, ros_type in rows for k in re.findall(r"\w+", kinds)
    }
    streams = {
        (kind.name, name, CODECS[message].ros_type.replace("/msg/", "/"))
        for kind in sensor_kinds().values()
        if kind.package.startswith("services.")
        for name, message in kind.streams.items()
    }
    assert found == streams
    types = {codec.ros_type.replace("/msg/", "/") for codec in CODECS.values()}
    assert {ros_type for ros_type in types if ros_type not in listed} == set()


def test_every_data_sheet_is_in_the_reference() -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
    sheets = [sheet.stem for sheet in (ROOT / "scenarios" / "sensors").glob("*.yaml")]
    assert len(sheets) > 20
    assert [sheet for sheet in sheets if f"`{sheet}`" not in pages] == []


def test_the_python_page_has_every_public_name(site: Path) -> None:
    named = set(re.findall(r"^::: (\w+\.\w+)$", text("reference/python.md"), re.MULTILINE))
    packages = (groundlink, udp_bridge)
    public = {f"{package.__name__}.{name}" for package in packages for name in package.__all__}
    assert named == public - {"groundlink.__version__"}
    built = (site / "reference" / "python.html").read_text(encoding="utf-8")
    for name in ("groundlink.open", "groundlink.data.dataset.Dataset.array", "udp_bridge.Link"):
        assert f'id="{name}"' in built


def test_error_lines_of_troubleshooting_are_those_of_the_sources() -> None:
    """A quotation of several words stands in a source, maybe over two lines."""
    folders = ("groundlink", "services", "udp-bridge/src")
    files = [ROOT / "setup.sh", *(file for name in folders for file in (ROOT / name).rglob("*.py"))]
    sources = "".join(file.read_text(encoding="utf-8") for file in files)
    joined = re.sub(r'"\s+f?"', "", sources)
    first_column = re.findall(r"^\| (.*?) \|", text("how-to/troubleshooting.md"), re.MULTILINE)
    quoted = [quote for cell in first_column for quote in re.findall(r"`([^`]+ [^`]+)`", cell)]
    assert len(quoted) > 20
    parts = [part for quote in quoted if ":" not in quote for part in quote.split(" ... ")]
    assert [part for part in parts if part not in joined] == []


def test_tests_and_benchmarks_that_pages_name_exist() -> None:
    pages = {*DOCS.rglob("*.md"), *ROOT.glob("*.md")} - {ROOT / "CHANGELOG.md"}
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    named = {
        (page.name, path)
        for page, words in texts.items()
        for path in re.findall(r"\btests/[\w/]+\.py\b", words)
    }
    named |= {
        (page.name, module.replace(".", "/"))
        for page, words in texts.items()
        for module in re.findall(
            r"python -m ((?:benchmarks|experiments|fuzz|tools)[\w.]*\w)", words
        )
    }
    assert len(named) > 100
    assert [(page, path) for page, path in sorted(named) if not _exists(ROOT / path)] == []


def _exists(path: Path) -> bool:
    return path.exists() or path.with_suffix(".py").exists()


def blocks(name: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text(name), re.DOTALL)


def test_programs_of_the_guides_are_python() -> None:
    programs = [
        (file, code)
        for file in (DOCS / "how-to").glob("*.md")
        for code in blocks(f"how-to/{file.name}", "python")
    ]
    assert len(programs) > 4
    for file, code in programs:
        compile(code, str(file), "exec")


def test_scenarios_of_the_guides_are_valid(tmp_path: Path) -> None:
    sheet, noise = blocks("how-to/device-noise.md", "yaml")
    (tmp_path / "sensors").mkdir()
    (tmp_path / "sensors" / "my_imu.yaml").write_text(sheet)
    (loop,) = blocks("how-to/lockstep.md", "yaml")
    (fleet,) = blocks("how-to/many-vehicles.md", "yaml")
    for name, content in (
        ("noise", noise),
        ("loop", loop),
        ("fleet", "name: fleet\nworld: yard\n" + fleet),
    ):
        file = tmp_path / f"{name}.yaml"
        file.write_text(content)
        assert load(file).vehicles
    assert load(tmp_path / "noise.yaml").vehicles[0].sensors[0].rate_hz == 200
