# SPDX-License-Identifier: Apache-2.0
"""A relay that is a bad link on purpose, for UDP of any kind; it needs no run and no root."""
