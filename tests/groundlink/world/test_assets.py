# SPDX-License-Identifier: Apache-2.0
"""The store: what is kept comes back, what is damaged is missing, nothing half-written shows."""

import hashlib
from pathlib import Path

import pytest

from groundlink.core.errors import UserError
from groundlink.world import assets
from groundlink.world.assets import VARIABLE, MissingAsset


@pytest.fixture
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "store"))
    return tmp_path / "store"


@pytest.mark.parametrize("content", [b"hills", b"", bytes(3_000_000)])
def test_what_is_kept_comes_back_under_its_digest(store: Path, content: bytes) -> None:
    digest = assets.put(content)
    assert digest == hashlib.sha256(content).hexdigest()
    assert assets.read(digest) == content
    assert bytes(assets.map_asset(digest)) == content
    assert [file.name for file in store.iterdir()] == [digest]


def test_what_is_not_there_or_damaged_is_missing(store: Path) -> None:
    digest = assets.put(b"hills")
    absent = "0" * 64
    assert assets.missing([digest, absent, digest]) == [absent]
    (store / digest).write_bytes(b"hill")
    assert assets.missing([digest, absent]) == [digest, absent]
    with pytest.raises(MissingAsset, match=f"{digest[:12]} are not in {store}"):
        assets.read(digest)
    assert assets.put(b"hills") == digest
    assert assets.read(digest) == b"hills"


def test_the_folder_is_where_the_environment_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert assets.folder() == tmp_path / ".cache/groundlink/assets"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert assets.folder() == tmp_path / "cache/groundlink/assets"


def test_a_folder_that_cannot_be_written_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "store"))
    with pytest.raises(UserError, match=f"cannot write assets.*{VARIABLE}"):
        assets.put(b"hills")
