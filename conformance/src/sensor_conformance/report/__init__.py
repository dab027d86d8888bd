# SPDX-License-Identifier: Apache-2.0
"""What a check found: results, pictures as SVG, a page, JUnit XML."""
