# SPDX-License-Identifier: Apache-2.0
"""MkDocs hook: links out of docs/ work in the site as they do in the repository.

Pages link to files of the repository by relative paths. A file outside of docs/ that a page links
to, such as ARCHITECTURE.md, is added to the site in the folder `repository`; a folder stands for
its README. `make docs` and `mkdocs serve` call the hook.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_LINK = re.compile(r"(?<=\]\()([^)\s#]+)")
_DOCS, _OTHERS = "docs/", "repository/"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add every file of the repository that a page links to, also indirectly."""
    root = Path(config.docs_dir).parent
    pages = [_path(file.src_uri) for file in files.documentation_pages()]
    for page in pages:
        for link in _LINK.findall((root / page).read_text(encoding="utf-8")):
            path = _target(page, link, root)
            uri = _uri(path)
            if path.startswith(_DOCS) or not (root / path).is_file() or uri in files.src_uris:
                continue
            files.append(File.generated(config, uri, abs_src_path=str(root / path)))
            if path.endswith(".md"):
                pages.append(path)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the page's text with its links as paths within the site."""
    source = page.file.src_uri
    root = Path(config.docs_dir).parent

    def within_site(link: re.Match[str]) -> str:
        uri = _uri(_target(_path(source), link[0], root))
        if uri not in files.src_uris:
            return link[0]
        return posixpath.relpath(uri, posixpath.dirname(source) or ".")

    return _LINK.sub(within_site, markdown)


def _path(uri: str) -> str:
    """Return the path in the repository of a file of the site."""
    return uri.removeprefix(_OTHERS) if uri.startswith(_OTHERS) else _DOCS + uri


def _uri(path: str) -> str:
    """Return the path in the site's sources of a file of the repository."""
    return path.removeprefix(_DOCS) if path.startswith(_DOCS) else _OTHERS + path


def _target(page: str, link: str, root: Path) -> str:
    """Return the path in the repository that a link of a page leads to."""
    path = posixpath.normpath(posixpath.join(posixpath.dirname(page), link))
    return f"{path}/README.md" if (root / path / "README.md").is_file() else path
