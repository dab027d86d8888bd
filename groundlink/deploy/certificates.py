# SPDX-License-Identifier: Apache-2.0
"""Certificates of the processes of a run, signed by an authority for this run only.

Keys are of the curve P-256. The authority's own key is not stored, so a further certificate
requires a new set. Uses the library `cryptography`.
"""

import datetime
import ipaddress
from collections.abc import Sequence
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

VALID_DAYS = 825
"""Longest validity that browsers and most programs accept."""


class Pem(NamedTuple):
    """A certificate and its key in PEM format."""

    certificate: bytes
    key: bytes


class Authority:
    """Certificate authority; its certificates are valid from `now` (UTC) on."""

    def __init__(self, now: datetime.datetime) -> None:
        self._from = now - datetime.timedelta(minutes=5)
        self._to = now + datetime.timedelta(days=VALID_DAYS)
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _named("Groundlink authority")
        usage = x509.KeyUsage(False, False, False, False, False, True, True, False, False)
        certificate = (
            self._builder(self._name, self._key.public_key())
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(self._key, hashes.SHA256())
        )
        self.certificate = certificate.public_bytes(serialization.Encoding.PEM)

    def certify(self, name: str, hosts: Sequence[str] = ()) -> Pem:
        """Return a certificate with the common name `name`; with `hosts`, also for a server.

        A host is a name or a numeric address.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        builder = self._builder(_named(name), key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(False, None), critical=True)
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts:
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
            names = x509.SubjectAlternativeName([_general(host) for host in hosts])
            builder = builder.add_extension(names, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(uses), critical=False)
        certificate = builder.sign(self._key, hashes.SHA256())
        return Pem(
            certificate.public_bytes(serialization.Encoding.PEM),
            key.private_bytes(
                serialization.Encoding.PEM,
                serialization.PrivateFormat.PKCS8,
                serialization.NoEncryption(),
            ),
        )

    def _builder(
        self, subject: x509.Name, public_key: ec.EllipticCurvePublicKey
    ) -> x509.CertificateBuilder:
        return x509.CertificateBuilder(
            self._name,
            subject,
            public_key,
            x509.random_serial_number(),
            self._from,
            self._to,
        )


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _general(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
