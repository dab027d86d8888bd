# SPDX-License-Identifier: Apache-2.0
"""Pictures of the documentation: `python -m tools.pictures` lists them, with a name it makes one.

Nothing imports this package.
"""
