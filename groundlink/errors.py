# SPDX-License-Identifier: Apache-2.0
"""The one error that a user is meant to read.

Rule: its text is one line: what is wrong, where, what was expected, how to mend it. Whoever runs a
command prints it and exits with 2; nobody else catches it.
"""


class UserError(Exception):
    """Something that the user can mend."""
