# SPDX-License-Identifier: Apache-2.0
"""Who gets onto a bus that takes certificates, by trying; what each may say there is elsewhere."""

import datetime
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.bus import zenoh_config
from groundlink.bus.credentials import ABOUT, AUTHORITY, CERTIFICATE, KEY, VARIABLE, about_text
from groundlink.bus.session import Bus, BusError
from groundlink.deploy.certificates import Authority
from groundlink.monitor.process_commands import free_endpoint

NOW = datetime.datetime.now(datetime.UTC)
YESTERDAY = NOW - datetime.timedelta(days=1)


def write(folder: Path, authority: Authority, process: str, known: bytes | None = None) -> str:
    """Write a process's credentials, which take those for genuine that `known` has signed."""
    own = authority.certify(process, ["127.0.0.1"] if process == "router" else ())
    folder.mkdir()
    (folder / AUTHORITY).write_bytes(known or authority.certificate)
    (folder / CERTIFICATE).write_bytes(own.certificate)
    (folder / KEY).write_bytes(own.key)
    (folder / ABOUT).write_text(about_text(process))
    return str(folder)


@pytest.fixture(scope="module")
def authority() -> Authority:
    return Authority(NOW)


@pytest.fixture(scope="module")
def endpoint(authority: Authority, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    endpoint = free_endpoint().replace("tcp/", "tls/")
    with pytest.MonkeyPatch.context() as patched:
        folder = tmp_path_factory.mktemp("certified") / "router"
        patched.setenv(VARIABLE, write(folder, authority, "router"))
        with Bus(listen=endpoint, name="router"):
            yield endpoint


def test_who_has_a_certificate_gets_in(
    authority: Authority, endpoint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, write(tmp_path / "imu", authority, "rover/imu"))
    with Bus(connect=endpoint, name="rover/imu") as own:
        assert own.is_connected()


@pytest.mark.parametrize("wrong", ["expired", "of another authority", "none"])
def test_who_has_none_that_is_good_stays_out_and_is_told_why(
    authority: Authority,
    endpoint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    wrong: str,
) -> None:
    if wrong == "expired":
        monkeypatch.setattr(authority, "_from", YESTERDAY - datetime.timedelta(days=1))
        monkeypatch.setattr(authority, "_to", YESTERDAY)
        monkeypatch.setenv(VARIABLE, write(tmp_path / "imu", authority, "rover/imu"))
    elif wrong == "of another authority":
        known = authority.certificate
        folder = write(tmp_path / "imu", Authority(NOW), "rover/imu", known)
        monkeypatch.setenv(VARIABLE, folder)
    else:
        monkeypatch.delenv(VARIABLE)
    monkeypatch.setattr(zenoh_config, "CONNECT_SECONDS", 2.0)
    with pytest.raises(BusError, match="rejected the other's certificate") as no:
        Bus(connect=endpoint, name="rover/imu")
    assert len(str(no.value).splitlines()) == 1
