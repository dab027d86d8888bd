# SPDX-License-Identifier: Apache-2.0
"""XML elements that keep their file and line, with typed access to attributes.

Document types are refused: URDF has none, and entities can exhaust the memory of a parser.
"""

from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from groundlink.loader.document import ScenarioError, SourceLine

MAX_NUMBER = 1e9
"""Maximum absolute number in a URDF; sums of larger squares overflow."""

EXPAND_HINT = "expand it first: `xacro {name} > robot.urdf`"


@dataclass(eq=False)
class XmlElement:
    """An XML element."""

    tag: str
    attributes: dict[str, str]
    mark: SourceLine
    children: list["XmlElement"] = field(default_factory=list)

    def all(self, tag: str) -> list["XmlElement"]:
        """Return the children with a tag."""
        return [child for child in self.children if child.tag == tag]

    def first(self, tag: str) -> "XmlElement | None":
        """Return the first child with a tag, or None."""
        return next(iter(self.all(tag)), None)

    def need(self, tag: str) -> "XmlElement":
        """Return the first child with a tag; raise if there is none."""
        child = self.first(tag)
        if child is None:
            raise self.mistake(f"<{tag}> is missing in it; add it")
        return child

    def text(self, attribute: str) -> str:
        """Return an attribute; raise if there is none."""
        value = self.attributes.get(attribute, "").strip()
        if not value:
            raise self.mistake(f'`{attribute}="..."` is missing; add it')
        return value

    def numbers(
        self, attribute: str, count: int, default: tuple[float, ...] | None = None
    ) -> tuple[float, ...]:
        """Return the numbers of an attribute, or the default where it is not given."""
        if default is not None and attribute not in self.attributes:
            return default
        text = self.text(attribute)
        try:
            numbers = tuple(float(word) for word in text.split())
        except ValueError:
            numbers = ()
        if len(numbers) != count or not all(abs(number) <= MAX_NUMBER for number in numbers):
            wanted = "a number" if count == 1 else f"{count} numbers"
            if "$" in text:
                wanted += f"; if this is xacro, {EXPAND_HINT.format(name=self.mark.file.name)}"
            raise self.mistake(f"`{attribute}` is `{text}`; expected {wanted}")
        return numbers

    def number(self, attribute: str, default: float | None = None) -> float:
        """Return the number of an attribute, or the default where it is not given."""
        return self.numbers(attribute, 1, None if default is None else (default,))[0]

    def positive(self, attribute: str, count: int = 1) -> tuple[float, ...]:
        """Return the numbers of an attribute, all above zero."""
        numbers = self.numbers(attribute, count)
        if min(numbers) <= 0:
            given = self.attributes[attribute]
            raise self.mistake(f"`{attribute}` is `{given}`; expected more than 0")
        return numbers

    def mistake(self, problem: str) -> ScenarioError:
        """Return an error about this element."""
        name = self.attributes.get("name")
        called = f'<{self.tag} name="{name}">' if name else f"<{self.tag}>"
        return ScenarioError(f"{self.mark}: {called}: {problem}")


def parse(file: Path) -> XmlElement:
    """Return the root element of an XML file.

    Raises
    ------
    ScenarioError
        when the file cannot be read, or is not XML, or is a xacro source.
    """
    try:
        content = file.read_bytes()
    except OSError as error:
        raise ScenarioError(f"{file}: {(error.strerror or str(error)).lower()}") from None
    roots: list[XmlElement] = []
    open_: list[XmlElement] = []
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        mark = SourceLine(file, parser.CurrentLineNumber)
        if tag.startswith("xacro:"):
            name = EXPAND_HINT.format(name=file.name)
            raise ScenarioError(f"{mark}: <{tag}>: xacro, not URDF; {name}")
        element = XmlElement(tag, attributes, mark)
        (open_[-1].children if open_ else roots).append(element)
        open_.append(element)

    def refuse_doctype(*_: object) -> None:
        mark = SourceLine(file, parser.CurrentLineNumber)
        raise ScenarioError(f"{mark}: <!DOCTYPE>: not allowed in a URDF. Fix: delete it")

    def end(_: str) -> None:
        open_.pop()

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = refuse_doctype
    try:
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError) as error:
        line = parser.ErrorLineNumber or 1
        why = expat.ErrorString(parser.ErrorCode) or error
        raise ScenarioError(f"{file}:{line}: not valid XML: {why}") from None
    return roots[0]
