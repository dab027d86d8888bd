# SPDX-License-Identifier: Apache-2.0
"""Refusal of a request."""

from __future__ import annotations


class RequestRefused(Exception):
    """A request was refused, by the node or by physics.

    Parameters
    ----------
    constant
        Name of the result code in the standard, such as ``NAME_NOT_UNIQUE``.
    reason
        One line.
    """

    def __init__(self, constant: str, reason: str) -> None:
        super().__init__(reason)
        self.constant = constant
