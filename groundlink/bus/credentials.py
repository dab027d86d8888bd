# SPDX-License-Identifier: Apache-2.0
"""Who a process is on a bus that strangers reach: its certificate, from a folder of its own.

Rule: a folder holds the name of one process, its certificate and its key, and that of the run's
authority; `groundlink secure` makes it. A process that is given another's folder says so and ends.
Nothing of it is printed.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from groundlink.core.errors import UserError

VARIABLE = "GROUNDLINK_CREDENTIALS"
"""Environment variable with the folder; without it the bus is open, and belongs on one host."""

AUTHORITY, CERTIFICATE, KEY, ABOUT = "authority.pem", "certificate.pem", "key.pem", "about.json"


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What stands beside the certificate."""

    process: str
    access_control: dict[str, Any] | None = None
    """Of a router: who may say what."""


class Credentials:
    """A folder of credentials.

    Raises
    ------
    UserError
        when it isn't whole.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for name in (AUTHORITY, CERTIFICATE, KEY, ABOUT):
            if not os.access(folder / name, os.R_OK):
                raise UserError(
                    f"{VARIABLE}: cannot read {folder / name}; make the folder with `groundlink "
                    "secure` and give it to this process"
                )
        try:
            self._about = msgspec.json.decode((folder / ABOUT).read_bytes(), type=About)
        except msgspec.DecodeError as error:
            raise UserError(f"{folder / ABOUT}: {error}") from None

    def check(self, process: str) -> None:
        """Refuse a folder that is another's.

        Raises
        ------
        UserError
            when it is.
        """
        owner = self._about.process
        if owner not in (process, process.partition("/")[0]):
            raise UserError(
                f"these are the credentials of `{owner}`, and this is `{process}`; point "
                f"{VARIABLE} to its own folder"
            )

    def settings(self) -> dict[str, Any]:
        """Return Zenoh's settings: both ends show a certificate of the authority."""
        certificate, key = str(self._folder / CERTIFICATE), str(self._folder / KEY)
        found: dict[str, Any] = {
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
            found["access_control"] = self._about.access_control
        return found


def from_environment(environment: Mapping[str, str]) -> Credentials | None:
    """Return the credentials that the environment names; None where it names none."""
    folder = environment.get(VARIABLE)
    return Credentials(Path(folder)) if folder else None


def about_text(process: str, access_control: dict[str, Any] | None = None) -> str:
    """Return what is to stand in the file beside a certificate."""
    about = msgspec.to_builtins(About(process, access_control))
    return json.dumps(about, indent=1) + "\n"
