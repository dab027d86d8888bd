# SPDX-License-Identifier: Apache-2.0
"""Programs that make files which are shipped. Nothing imports them but their tests."""
