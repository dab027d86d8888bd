# SPDX-License-Identifier: Apache-2.0
r"""POSIX extended regular expressions, translated for `re`.

Grammar: IEEE Std 1003.1-2024, chapter 9. What it leaves undefined (``\d``, ``(?:``, ``a*?``, a
quantifier without an operand) is refused, because simulators would disagree on it.
"""

from __future__ import annotations

import re
import string

MOST_REPEATS = 255
"""Largest number in ``{m,n}``: RE_DUP_MAX."""

CLASSES = {
    "alpha": string.ascii_letters,
    "digit": string.digits,
    "alnum": string.ascii_letters + string.digits,
    "upper": string.ascii_uppercase,
    "lower": string.ascii_lowercase,
    "xdigit": string.hexdigits,
    "punct": string.punctuation,
    "blank": " \t",
    "space": string.whitespace,
    "graph": string.ascii_letters + string.digits + string.punctuation,
    "print": string.ascii_letters + string.digits + string.punctuation + " ",
    "cntrl": "".join(map(chr, (*range(32), 127))),
}
"""Characters of ``[:alpha:]`` and the others in the POSIX locale."""

_REPEAT = re.compile(r"\{([0-9]+)(,([0-9]*))?\}")
_IN_BRACKETS = re.compile(r"\[([:.=])(.*?)\1\]", re.DOTALL)


def compile_posix(pattern: str) -> re.Pattern[str]:
    """Compile an extended regular expression; use its `fullmatch`.

    Raises
    ------
    ValueError
        With the position of the first mistake.
    """
    return re.compile(_Translation(pattern).result(), re.DOTALL)


class _Translation:
    """One pass over a pattern."""

    def __init__(self, pattern: str) -> None:
        self._pattern = pattern
        self._at = 0

    def result(self) -> str:
        pattern, found, depth = self._pattern, "", 0
        is_operand = False
        """Whether a quantifier may follow."""
        while self._at < len(pattern):
            symbol = pattern[self._at]
            if symbol in "*+?{":
                if not is_operand:
                    raise self._mistake(f"nothing that {symbol!r} can repeat")
                found += self._repeat() if symbol == "{" else self._take()
                is_operand = False
            elif symbol in "(|^":
                depth += symbol == "("
                found += "(?:" if symbol == "(" else symbol
                is_operand = False
                self._at += 1
            elif symbol == "$":
                found += r"\Z"
                is_operand = False
                self._at += 1
            else:
                if symbol == ")":
                    depth -= 1
                    if depth < 0:
                        raise self._mistake("')' without '('")
                found += self._operand(symbol)
                is_operand = True
        if depth:
            raise self._mistake("'(' without ')'")
        return found

    def _operand(self, symbol: str) -> str:
        if symbol == "[":
            return self._brackets()
        if symbol == "\\":
            self._at += 1
            if self._pattern[self._at : self._at + 1] not in set(string.punctuation):
                raise self._mistake("'\\' must precede a punctuation character")
            return re.escape(self._take())
        return self._take() if symbol in ".)" else re.escape(self._take())

    def _take(self) -> str:
        self._at += 1
        return self._pattern[self._at - 1]

    def _repeat(self) -> str:
        match = _REPEAT.match(self._pattern, self._at)
        bounds = [int(text) for text in match.group(1, 3) if text] if match else []
        if not match or bounds != sorted(bounds) or bounds[-1] > MOST_REPEATS:
            raise self._mistake(f"expected {{m}}, {{m,}} or {{m,n}}, at most {MOST_REPEATS}")
        self._at = match.end()
        return match[0]

    def _brackets(self) -> str:
        """Translate a bracket expression, in which a backslash is an ordinary character."""
        pattern = self._pattern
        self._at += 1
        is_negated = pattern.startswith("^", self._at)
        self._at += is_negated
        first, members = self._at, ""
        while not pattern.startswith("]", self._at) or self._at == first:
            member = self._member()
            if pattern.startswith("-", self._at) and not pattern.startswith("-]", self._at):
                self._at += 1
                last = self._member()
                if len(member) != 1 or len(last) != 1 or member > last:
                    raise self._mistake("a range must ascend from one character to another")
                member = "".join(map(chr, range(ord(member), ord(last) + 1)))
            members += member
        self._at += 1
        return f"[{'^' * is_negated}{''.join(map(re.escape, members))}]"

    def _member(self) -> str:
        """Return the characters of a class, or one character."""
        if self._at >= len(self._pattern):
            raise self._mistake("'[' without ']'")
        match = _IN_BRACKETS.match(self._pattern, self._at)
        if not match:
            return self._take()
        members = CLASSES.get(match[2], "") if match[1] == ":" else match[2]
        if not members or (match[1] != ":" and len(members) != 1):
            raise self._mistake(f"unknown class {match[0]!r}")
        self._at = match.end()
        return members

    def _mistake(self, reason: str) -> ValueError:
        return ValueError(f"regular expression {self._pattern!r}, position {self._at}: {reason}")
