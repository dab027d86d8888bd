# SPDX-License-Identifier: Apache-2.0
"""The kept list of mutants: one change of one place in a source file, and the tests that must fail.

A list in `lists/` is a YAML file of rows:

- `file`: the source, from the root of the repository;
- `was`: text that occurs in it exactly once;
- `becomes`: what stands there in the mutant;
- `means`: what is wrong with the mutant, for the reader of a survivor;
- `tests`: what pytest is given to find it, separated by blanks.
"""

from pathlib import Path

import msgspec

ROOT = Path(__file__).resolve().parents[2]
LISTS = Path(__file__).parent / "lists"


class Mutant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A fault to plant."""

    file: str
    was: str
    becomes: str
    means: str
    tests: str

    @property
    def name(self) -> str:
        """Return what identifies it for a person."""
        return f"{self.file}: {self.means}"

    def planted(self, text: str) -> str:
        """Return the text of its file with the fault.

        Raises
        ------
        ValueError
            when the place is not there, or there more than once.
        """
        if (count := text.count(self.was)) != 1:
            raise ValueError(f"{self.name}: `was` occurs {count} times; expected once")
        return text.replace(self.was, self.becomes)


def catalog(folder: Path = LISTS) -> list[Mutant]:
    """Return all mutants of the lists of a folder, in their order.

    Raises
    ------
    ValueError
        when a list cannot be read; the text names it.
    """
    mutants: list[Mutant] = []
    for path in sorted(folder.glob("*.yaml")):
        try:
            mutants += msgspec.yaml.decode(path.read_bytes(), type=list[Mutant])
        except msgspec.DecodeError as error:
            raise ValueError(f"{path.name}: {error}") from None
    return mutants
