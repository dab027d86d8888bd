# SPDX-License-Identifier: Apache-2.0
"""The first bad commit is found in temporary worktrees; the user's tree stays as it is."""

import json
from pathlib import Path

import pytest

from groundlink.__main__ import main as groundlink
from groundlink.bisection.search import most_probes
from groundlink.cli.bisect.commits import Repository
from groundlink.core.errors import UserError

from .toys import RECORDING, ToyRepository

PROGRAM = f"""\
echo "$PWD" "$(cat speed)" >> {{log}}
case $(cat speed) in broken) exit 3;; esac
cp {RECORDING} "$1"
exit $(($(cat speed) > 5))
"""
"""A stack that is bad at speeds over 5, and logs its folder and speed."""


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ToyRepository:
    monkeypatch.chdir(tmp_path)
    return ToyRepository(tmp_path / "stack")


def files(toy: ToyRepository) -> dict[str, str]:
    return {"drive.sh": PROGRAM.format(log=toy.folder.parent / "log")}


def bisected(toy: ToyRepository, good: str, bad: str, *more: str) -> int:
    words = ["bisect", "--repository", str(toy.folder), "--good", good, "--bad", bad]
    return groundlink([*words, "--program", "sh drive.sh", "--json", *more])


def test_guilty_commit_is_found(toy: ToyRepository, capsys: pytest.CaptureFixture[str]) -> None:
    shas = toy.commits([1] * 11 + [9] * 6, files(toy))
    (toy.folder / "speed").write_text("work in progress", encoding="utf-8")
    (toy.folder / "notes").write_text("not in git", encoding="utf-8")
    before = toy.git("status", "--porcelain=v2", "--branch"), toy.git("for-each-ref")
    assert bisected(toy, "main~16", "main") == 0
    result = json.loads(capsys.readouterr().out)
    assert [change["sha"] for change in result["changes"]] == [shas[11]]
    assert "change 11 (Ada, 20" in result["found"]
    assert result["good"].startswith(shas[10][:12])
    assert result["runs"] <= most_probes(17) == 6
    assert (toy.git("status", "--porcelain=v2", "--branch"), toy.git("for-each-ref")) == before
    assert toy.git("worktree", "list").count("\n") == 0
    log = (toy.folder.parent / "log").read_text(encoding="utf-8")
    folders = [line.split()[0] for line in log.splitlines()]
    assert len(folders) == len({*folders}) == result["runs"]
    assert not any(Path(folder).exists() for folder in folders)


def test_merges_are_followed(toy: ToyRepository, capsys: pytest.CaptureFixture[str]) -> None:
    good = toy.commit("start", {**files(toy), "speed": "1"})
    toy.git("checkout", "--quiet", "-b", "branch")
    toy.commit("harmless", {"other": "1"})
    guilty = toy.commit("guilty", {"speed": "7"})
    toy.commit("harmless again", {"other": "2"})
    toy.git("checkout", "--quiet", "main")
    for number in range(5):
        toy.commit(f"main {number}", {"main": str(number)})
    toy.git("merge", "--quiet", "--no-edit", "branch")
    toy.commit("after", {"main": "6"})
    assert bisected(toy, good, "HEAD") == 0
    result = json.loads(capsys.readouterr().out)
    assert [change["sha"] for change in result["changes"]] == [guilty]


def test_commit_without_a_recording_is_skipped(
    toy: ToyRepository, capsys: pytest.CaptureFixture[str]
) -> None:
    shas = toy.commits(["1", "1", "broken", "broken", "9", "9"], files(toy))  # type: ignore[list-item]
    assert bisected(toy, shas[0], shas[-1]) == 1
    result = json.loads(capsys.readouterr().out)
    assert [change["sha"] for change in result["changes"]] == [shas[4]]
    assert sorted(name[:12] for name in result["not_judged"]) == sorted(s[:12] for s in shas[2:4])


def test_build_that_fails_is_skipped(
    toy: ToyRepository, capsys: pytest.CaptureFixture[str]
) -> None:
    shas = toy.commits([1, 9], files(toy))
    assert bisected(toy, *shas, "--build", "test -e drive.sh && touch built") == 0
    assert bisected(toy, *shas, "--build", "false", "--out", "other") == 2
    assert "the good end is not judged" in capsys.readouterr().err


def test_scenario_of_the_repository_is_that_of_each_commit(
    toy: ToyRepository, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from groundlink.cli.bisect import recorders

    scenarios = []

    def record(scenario: str, case: object, to: Path, duration: str | None) -> int:
        scenarios.append(Path(scenario))
        to.write_bytes(RECORDING.read_bytes())
        return int("slow" not in Path(scenario).read_text(encoding="utf-8"))

    monkeypatch.setattr(recorders, "record_case", record)
    shas = [toy.commit(text, {"run.yaml": text}) for text in ("slow", "slower", "fast")]
    words = ["--repository", "stack", "--good", shas[0], "--bad", shas[2], "--json"]
    assert groundlink(["bisect", "stack/run.yaml", *words]) == 0
    assert [c["sha"] for c in json.loads(capsys.readouterr().out)["changes"]] == [shas[2]]
    assert {file.name for file in scenarios} == {"run.yaml"}
    assert not any(file.is_relative_to(toy.folder) for file in scenarios)


def test_mistakes_name_the_repository(
    toy: ToyRepository, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shas = toy.commits([1, 9], files(toy))
    for good, bad, line in [
        (shas[0], "nowhere", "Needed a single revision"),
        (shas[1], shas[0], "is no ancestor of --bad"),
        (shas[1], "main", "are the same commit"),
    ]:
        assert bisected(toy, good, bad) == 2
        error = capsys.readouterr().err
        assert line in error
        assert error.count("\n") == 1
    for folder, line in [(tmp_path, "not a git repository"), (tmp_path / "none", "no such folder")]:
        with pytest.raises(UserError, match=line):
            Repository(folder)


def test_bare_repository_has_commits_but_no_tree(toy: ToyRepository, tmp_path: Path) -> None:
    toy.commits([1, 9], files(toy))
    toy.git("clone", "--quiet", "--bare", str(toy.folder), str(tmp_path / "bare"))
    bare = Repository(tmp_path / "bare")
    assert bare.tree is None
    with bare.worktree(bare.resolve("main~1")) as folder:
        assert (folder / "speed").read_text() == "1"
    assert not folder.exists()
