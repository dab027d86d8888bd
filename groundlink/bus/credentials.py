# SPDX-License-Identifier: Apache-2.0
"""Credentials of a process on a secured bus: its certificate, its key and the run's authority.

`groundlink secure` writes one folder for each process. A process that gets the folder of another
process ends with an error. Contents of the files are never printed.
"""

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from groundlink.core.errors import UserError

VARIABLE = "GROUNDLINK_CREDENTIALS"
"""Environment variable with the folder. Without it the bus is open; use that on one host only."""

AUTHORITY, CERTIFICATE, KEY, ABOUT = "authority.pem", "certificate.pem", "key.pem", "about.json"


class CredentialInfo(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Content of the file beside the certificate."""

    process: str
    access_control: dict[str, Any] | None = None
    """Access control of a router; None for other processes."""


class Credentials:
    """A folder of credentials.

    Raises
    ------
    UserError
        if a file is missing, unreadable or malformed.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for name in (AUTHORITY, CERTIFICATE, KEY, ABOUT):
            if not os.access(folder / name, os.R_OK):
                raise UserError(
                    f"{VARIABLE}: cannot read {folder / name}. Fix: create the folder with "
                    "`groundlink secure` and make it readable for this process"
                )
        try:
            self._about = msgspec.json.decode((folder / ABOUT).read_bytes(), type=CredentialInfo)
        except msgspec.DecodeError as error:
            raise UserError(f"{folder / ABOUT}: {error}") from None

    def check(self, process: str) -> None:
        """Check that the folder belongs to `process`.

        Raises
        ------
        UserError
            if it belongs to another process.
        """
        owner = self._about.process
        if owner not in (process, process.partition("/")[0]):
            raise UserError(
                f"{VARIABLE}: credentials of another process; expected `{process}`, got `{owner}`. "
                f"Fix: set {VARIABLE} to the folder of `{process}`"
            )

    def settings(self) -> dict[str, Any]:
        """Return Zenoh's settings for mutual TLS."""
        certificate, key = str(self._folder / CERTIFICATE), str(self._folder / KEY)
        settings: dict[str, Any] = {
            "transport/link/tls": {
                "root_ca_certificate": str(self._folder / AUTHORITY),
                "enable_mtls": True,
                "verify_name_on_connect": True,
                "connect_certificate": certificate,
                "connect_private_key": key,
                "listen_certificate": certificate,
                "listen_private_key": key,
            }
        }
        if self._about.access_control is not None:
            settings["access_control"] = self._about.access_control
        return settings


def from_environment(environment: Mapping[str, str]) -> Credentials | None:
    """Return the credentials that the environment names; None without the variable."""
    folder = environment.get(VARIABLE)
    return Credentials(Path(folder)) if folder else None


def about_text(process: str, access_control: dict[str, Any] | None = None) -> str:
    """Return the content of the file beside a certificate."""
    about = msgspec.to_builtins(CredentialInfo(process, access_control))
    return json.dumps(about, indent=1) + "\n"
