# SPDX-License-Identifier: Apache-2.0
"""What arrives over a lossy link, with and without repair, in virtual time."""
