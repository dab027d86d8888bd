# SPDX-License-Identifier: Apache-2.0
"""Certificates: valid from a little before they were made, for what they are meant for."""

from datetime import UTC, datetime, timedelta

import pytest
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from groundlink.deploy.certificates import VALID_DAYS, Authority

NOW = datetime(2026, 7, 1, 12, tzinfo=UTC)
AUTHORITY = Authority(NOW)


def test_they_are_valid_at_once_also_where_clocks_are_some_minutes_behind() -> None:
    for pem in (AUTHORITY.certificate, AUTHORITY.certify("rover/imu").certificate):
        certificate = x509.load_pem_x509_certificate(pem)
        assert certificate.not_valid_before_utc == NOW - timedelta(minutes=5)
        assert certificate.not_valid_after_utc == NOW + timedelta(days=VALID_DAYS)


def test_only_a_server_has_hosts_and_only_the_authority_signs() -> None:
    authority, another = (
        x509.load_pem_x509_certificate(one.certificate) for one in (AUTHORITY, Authority(NOW))
    )
    constraints = authority.extensions.get_extension_for_class(x509.BasicConstraints).value
    assert (constraints.ca, constraints.path_length) == (True, 0)
    for hosts, uses in (
        ((), [ExtendedKeyUsageOID.CLIENT_AUTH]),
        (
            ("router", "10.0.0.1"),
            [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH],
        ),
    ):
        made = x509.load_pem_x509_certificate(AUTHORITY.certify("router", hosts).certificate)
        made.verify_directly_issued_by(authority)
        found = made.extensions
        assert not found.get_extension_for_class(x509.BasicConstraints).value.ca
        assert list(found.get_extension_for_class(x509.ExtendedKeyUsage).value) == uses
        assert made.subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value == "router"
        names = [e.value for e in found if isinstance(e.value, x509.SubjectAlternativeName)]
        assert [n.get_values_for_type(x509.DNSName) for n in names] == [["router"]] * bool(hosts)
        with pytest.raises(InvalidSignature):
            made.verify_directly_issued_by(another)
