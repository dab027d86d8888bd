# SPDX-License-Identifier: Apache-2.0
"""A recorded run as one page: gathered in one pass over the file, drawn, put into a template."""
