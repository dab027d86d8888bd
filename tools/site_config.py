# SPDX-License-Identifier: Apache-2.0
"""MkDocs hook: the version beside the site's name, and formulas as MathML.

A formula is a block ``math`` of LaTeX in a page, as GitHub shows it. In the site it is MathML,
which browsers draw without a script or a font from elsewhere.
"""

from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig

from groundlink.core import VERSION


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Add the version to the name and the form of a formula to the extensions."""
    config.site_name = f"{config.site_name} {VERSION}"
    fences = config.mdx_configs.setdefault("pymdownx.superfences", {})
    fences["custom_fences"] = [{"name": "math", "class": "math", "format": _formula}]
    return config


def _formula(source: str, *rest: Any, **named: Any) -> str:
    """Return a block of LaTeX as an element of a page."""
    return convert(source, display="block")
