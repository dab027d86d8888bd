# SPDX-License-Identifier: Apache-2.0
"""Keys are read or refused in one line that tells everything but the key."""

from pathlib import Path

import pytest

from udp_bridge.wire.keys import REFUSAL_HINTS, TOLERATED, BadKey, RefusalHints, read_key

HEX = "00112233445566778899aabbccddeeff"


def key_file(folder: Path, text: bytes, mode: int = 0o600) -> str:
    file = folder / "key"
    file.write_bytes(text)
    file.chmod(mode)
    return str(file)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (HEX.encode(), bytes.fromhex(HEX)),
        (HEX.upper().encode() + b"\r\n", bytes.fromhex(HEX)),
        (b"a pass phrase of some length\n", b"a pass phrase of some length"),
        (bytes(range(200, 232)), bytes(range(200, 232))),
    ],
)
def test_a_key_is_hexadecimal_or_itself(tmp_path: Path, text: bytes, key: bytes) -> None:
    assert read_key(key_file(tmp_path, text), None, {}) == key


def test_a_key_of_the_environment() -> None:
    assert read_key(None, "K", {"K": HEX}) == bytes.fromhex(HEX)
    assert read_key(None, None, {"K": HEX}) is None


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        (b"short secret", 0o600, "12 bytes, expected 16"),
        (b"c0ffee00c0ffee00\n", 0o600, "8 bytes, expected 16"),
        (b"", 0o600, "0 bytes"),
        (b"c0ffee0" * 7, 0o600, "odd number"),
        (b"\xc0\xff" * 4000, 0o600, "more than 4096"),
        (b"a pass phrase of some length", 0o640, "chmod 600"),
        (b"a pass phrase of some length", 0o604, "others may use it"),
    ],
)
def test_invalid_keys(tmp_path: Path, text: bytes, mode: int, words: str) -> None:
    file = key_file(tmp_path, text, mode)
    with pytest.raises(BadKey, match=r"^[^\n]+$") as refused:
        read_key(file, None, {})
    told = str(refused.value)
    assert words in told
    assert file in told
    assert not text or text.strip().decode("latin-1") not in told


def test_where_no_key_is(tmp_path: Path) -> None:
    with pytest.raises(BadKey, match="no such file"):
        read_key(str(tmp_path / "none"), None, {})
    with pytest.raises(BadKey, match="is a directory"):
        read_key(str(tmp_path), None, {})
    with pytest.raises(BadKey, match="no variable K"):
        read_key(None, "K", {})
    with pytest.raises(BadKey, match="choose one"):
        read_key("f", "K", {"K": HEX})
    with pytest.raises(BadKey) as refused:
        read_key(None, "K", {"K": "secret"})
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("why", REFUSAL_HINTS)
def test_mismatched_key_is_reported_once(why: str) -> None:
    misfits = RefusalHints()
    few = TOLERATED.get(why, 0)
    assert misfits.new({"too_short": 3, why: few}) == []
    (line,) = misfits.new({"too_short": 3, why: few + 1})
    assert line.startswith(f"refuses datagrams as {why}: ")
    assert misfits.new({"too_short": 3, why: 200}) == []
