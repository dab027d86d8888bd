# SPDX-License-Identifier: Apache-2.0
"""HTML elements: sections, tables and figures from untrusted text.

All text is escaped here, once; `Markup` is HTML already.
"""

from collections.abc import Iterable, Sequence
from html import escape


class Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def text(value: str) -> Markup:
    """Return text as HTML; HTML as it is."""
    return value if isinstance(value, Markup) else Markup(escape(value))


def joined(parts: Iterable[str]) -> Markup:
    """Return parts one below the other."""
    return Markup("\n".join(text(part) for part in parts))


def section(title: str, *parts: str) -> Markup:
    """Return a section with its heading; nothing without content."""
    content = joined(part for part in parts if part)
    return (
        Markup(f"<section>\n<h2>{text(title)}</h2>\n{content}\n</section>") if content else content
    )


def paragraph(words: str) -> Markup:
    """Return a paragraph."""
    return Markup(f"<p>{text(words)}</p>")


def heading(words: str) -> Markup:
    """Return a heading within a section."""
    return Markup(f"<h3>{text(words)}</h3>")


def figure(content: str, caption: str) -> Markup:
    """Return a picture, as SVG, with the words below it."""
    return Markup(f"<figure>{content}<figcaption>{text(caption)}</figcaption></figure>")


def picture(uri: str, label: str) -> Markup:
    """Return a picture from its data URI."""
    image = f'<img src="{escape(uri)}" alt="{escape(label)}">'
    return Markup(f"<figure>{image}<figcaption>{text(label)}</figcaption></figure>")


def table(
    columns: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    numbers: Iterable[int] = (),
    code: Iterable[int] = (),
    off: Iterable[int] = (),
    bad: Iterable[int] = (),
) -> Markup:
    """Return a table.

    Parameters
    ----------
    numbers, code
        columns that hold figures, or names of topics and the like.
    off, bad
        rows that stand out in orange, or in red.
    """
    kinds = dict.fromkeys(numbers, "n") | dict.fromkeys(code, "code")
    marked = dict.fromkeys(off, " class=off") | dict.fromkeys(bad, " class=bad")

    def cells(tag: str, row: Sequence[str]) -> str:
        made = []
        for i, value in enumerate(row):
            kind = f' class="{kinds[i]}"' if i in kinds else ""
            made.append(f"<{tag}{kind}>{text(value)}</{tag}>")
        return "".join(made)

    lines = [f"<tr>{cells('th', columns)}</tr>"]
    for number, row in enumerate(rows):
        lines.append(f"<tr{marked.get(number, '')}>{cells('td', row)}</tr>")
    body = "\n".join(lines[1:])
    return Markup(
        f'<div class="wide"><table><thead>{lines[0]}</thead>\n<tbody>{body}</tbody></table></div>'
    )


def details(summary: str, content: str) -> Markup:
    """Return text that is shown on a click."""
    return Markup(
        f"<details><summary>{text(summary)}</summary><pre>{text(content)}</pre></details>"
    )


def tiles(facts: Iterable[tuple[str, str]]) -> Markup:
    """Return figures with the words that name them."""
    made = "".join(f"<div><b>{text(v)}</b><span>{text(name)}</span></div>" for v, name in facts)
    return Markup(f'<div class="facts">{made}</div>')
