# SPDX-License-Identifier: Apache-2.0
"""Probes of a bisection: one run each, judged once, and kept in a folder for the next time."""

import hashlib
import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from groundlink.bisection.search import RunVerdict
from groundlink.cli.run.cases import INTERRUPTED, check_recording
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError

STATE = "bisect.json"
"""File of the verdicts, in the folder of the recordings."""

SKIP = 125
"""Exit code of a check that cannot judge, as for `git bisect run`."""

LAST_BAD = 124
"""Largest exit code that means bad. Shells use the larger ones for commands that do not start."""


class Candidate(NamedTuple):
    """What a probe runs."""

    name: str
    """Text for people; the same run has the same name."""

    record: Callable[[Path], int]
    """Writes the recording of a run to a new file; returns an exit code: 0, or 1 for a run that
    went wrong. Other codes mean that there was no run to judge."""


class JudgedRun(msgspec.Struct):
    """A run and its verdict."""

    name: str
    recording: str | None
    """Name of the file in the folder; None if there was no run to judge."""

    run_code: int
    """Exit code of the run."""

    verdict: RunVerdict
    line: str
    """Last line of the check."""

    check: str
    """Identity of the check."""


class _State(msgspec.Struct):
    """Content of `STATE`."""

    setting: dict[str, str]
    probes: list[JudgedRun]


class Prober:
    """Runs and judges candidates; finished runs of the folder are not repeated.

    Parameters
    ----------
    folder
        where recordings and verdicts are kept.
    setting
        what all runs have in common.
    check
        words of a command that judges a recording, its last argument; none: the run's exit code
        decides.
    most
        most runs of the bisection, if known.
    say
        prints a line.

    Raises
    ------
    UserError
        if the folder holds something else.
    """

    def __init__(
        self,
        folder: Path,
        setting: Mapping[str, str],
        check: Sequence[str],
        most: int | None,
        say: Callable[[str], None],
    ) -> None:
        self.folder = folder
        self.runs = 0
        """Runs of this command, without those of earlier ones."""

        self._setting, self._check, self._say = dict(setting), check, say
        self._of = "" if most is None else f" of at most {most}"
        self._check_identity = _identity(check)
        self._judged: dict[str, JudgedRun] = {}
        self._known = {probe.name: probe for probe in _read(folder, self._setting)}

    @property
    def probes(self) -> list[JudgedRun]:
        """Judged candidates, in the order of the search."""
        return [*self._judged.values()]

    def recording(self, candidate: Candidate) -> Path:
        """Return the recording of a judged candidate."""
        name = self._known[candidate.name].recording
        assert name is not None
        return self.folder / name

    def expect(self, candidate: Candidate, verdict: RunVerdict) -> None:
        """Check an end of the search.

        Raises
        ------
        UserError
            if the verdict is another one.
        """
        if self.probe(candidate) is not verdict:
            probe = self._known[candidate.name]
            raise UserError(
                f"the {verdict.value} end is {_words(probe.verdict)}: {candidate.name}: "
                f"{probe.line}; expected {verdict.value}. Fix: choose other ends or another check"
            )

    def probe(self, candidate: Candidate) -> RunVerdict:
        """Return the verdict of a candidate.

        Raises
        ------
        UserError
            if the check cannot be run.
        """
        self._say(f"probe {len(self._judged) + 1}{self._of}: {candidate.name}")
        probe = self._known.get(candidate.name)
        recording = probe and probe.recording and self.folder / probe.recording
        if not probe or not recording or not recording.exists():
            probe = self._run(candidate)
        elif probe.check != self._check_identity:
            probe = self._judge(candidate.name, recording, probe.run_code)
        self._known[candidate.name] = self._judged[candidate.name] = probe
        with write_atomically(self.folder / STATE) as part:
            state = _State(self._setting, [*self._known.values()])
            part.write_bytes(msgspec.json.format(msgspec.json.encode(state)) + b"\n")
        self._say(f"  {probe.verdict.value}: {probe.line}")
        return probe.verdict

    def _run(self, candidate: Candidate) -> JudgedRun:
        names = {probe.recording for probe in self._known.values()}
        numbers = (f"{number}.mcap" for number in range(1, len(names) + 2))
        out = self.folder / next(name for name in numbers if name not in names)
        out.unlink(missing_ok=True)  # from a run that was interrupted
        code = candidate.record(out)
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        self.runs += 1
        if code in (0, 1) and out.exists():
            return self._judge(candidate.name, out, code)
        out.unlink(missing_ok=True)
        line = f"exit code {code}" if code not in (0, 1) else "it made no recording"
        return JudgedRun(candidate.name, None, code, RunVerdict.SKIPPED, line, self._check_identity)

    def _judge(self, name: str, recording: Path, run_code: int) -> JudgedRun:
        line, code = f"exit code {run_code}", run_code
        if self._check:
            line, code = check_recording(shlex.join(self._check), recording)
        if not 0 <= code <= SKIP:
            raise UserError(
                f"check `{shlex.join(self._check)}`: exit code {code}; expected 0 for good, 1 to "
                f"{LAST_BAD} for bad, {SKIP} where it cannot judge. Fix: run it on {recording}"
            )
        verdict = {0: RunVerdict.GOOD, SKIP: RunVerdict.SKIPPED}.get(code, RunVerdict.BAD)
        return JudgedRun(name, recording.name, run_code, verdict, line, self._check_identity)


def _words(verdict: RunVerdict) -> str:
    return "not judged" if verdict is RunVerdict.SKIPPED else verdict.value


def _read(folder: Path, setting: Mapping[str, str]) -> list[JudgedRun]:
    """Return the probes that a folder has of these runs; make the folder if there is none."""
    if not folder.exists():
        folder.mkdir(parents=True)
        return []
    file = folder / STATE
    if not file.exists():
        if not folder.is_dir() or any(folder.iterdir()):
            raise UserError(f"--out {folder}: holds other files. Fix: choose another folder")
        return []
    try:
        state = msgspec.json.decode(file.read_bytes(), type=_State)
    except msgspec.DecodeError as error:
        raise UserError(
            f"{file}: not the verdicts of a bisection: {error}. Fix: delete the folder"
        ) from None
    if state.setting != setting:
        names = sorted({*state.setting, *setting})
        other = ", ".join(name for name in names if state.setting.get(name) != setting.get(name))
        raise UserError(
            f"--out {folder}: holds runs of another bisection, with another {other}. Fix: delete "
            "the folder, or choose another one"
        )
    return state.probes


def _identity(words: Sequence[str]) -> str:
    """Return what changes with a command and the files among its words."""
    contents = [
        hashlib.sha256(Path(w).read_bytes()).hexdigest() for w in words if Path(w).is_file()
    ]
    return hashlib.sha256(json.dumps([*words, *contents]).encode()).hexdigest()
