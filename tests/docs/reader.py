# SPDX-License-Identifier: Apache-2.0
"""Reader of a tutorial: does what the page's code blocks say, in order, in one folder.

The reader uses nothing of a page but its blocks:

- ``sh``: commands. A block is a shell of its own in the folder; it ends at the first command that
  fails. The title names the terminal, none is the first one. A title that ends in ``keeps running``
  is of a block whose last command does not end: the reader presses Ctrl-C before the next block of
  that terminal, or at the end of the page.
- ``text``: the output of the block before. Numbers may differ, ``...`` stands for any text or
  lines. Of a command that keeps running, the reader waits for that output. With a title that ends
  in ``after Ctrl-C`` it is what the terminal of the title prints at its end.
- ``python`` without a title: lines for a Python prompt. Blocks without another between them, but
  for their outputs, are one program.
- Any other block with a title: a file of this name. ``NAME (excerpt)`` is a file that exists
  already, with some of its lines.
- A fence without a language: only shown.
"""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from groundlink.monitor.supervisor import end_with_parent

from .blocks import Block, blocks

KEEPS_RUNNING, AFTER_CTRL_C = "keeps running", "after Ctrl-C"
LIMIT_S = 100.0
"""Longest time of a command that ends."""

WAIT_S = 60.0
"""Longest wait for an output of a command that keeps running, and for its end."""

_SEPARATOR = "\x1e"
_NUMBER = r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?!\w)"
_HASH = r"\b[0-9a-f]{12,}\b"


@dataclass(frozen=True)
class Instead:
    """What the reader does instead of a command that a test cannot run as printed."""

    command: str
    """Command that the reader runs; empty: none."""

    why: str


class Reader:
    """Follows one page.

    Parameters
    ----------
    folder
        where all files go and all commands run.
    environment
        variables of the commands.
    inside
        words of a program that runs a command in a network of its own.
    instead
        commands that are not run as printed.
    """

    def __init__(
        self,
        folder: Path,
        environment: Mapping[str, str],
        inside: Sequence[str],
        instead: Mapping[str, Instead],
    ) -> None:
        self.folder = folder
        self._environment = dict(environment)
        self._inside = [*inside, "env", f"--chdir={folder}"]
        self._instead = instead
        self._terminals: dict[str, Started] = {}
        """Terminals with a command that keeps running."""

        self._commands = 0

    def follow(self, page: Path) -> None:
        """Do what the page says.

        Raises
        ------
        AssertionError
            if a command fails, or prints something else; its line and output are named.
        """
        try:
            found = blocks(page)
            position = 0
            while position < len(found):
                position += self._step(found[position:])
            for terminal in list(self._terminals):
                self._interrupt(terminal)
        finally:
            for started in self._terminals.values():
                started.kill()

    def _step(self, rest: Sequence[Block]) -> int:
        """Do what the first block says; return how many blocks are done with it."""
        block = rest[0]
        if block.language == "sh":
            return self._shell(block, rest[1:])
        if block.language == "text" and block.title.endswith(AFTER_CTRL_C):
            terminal = block.title.removesuffix(AFTER_CTRL_C).strip(" ,")
            compare(block, self._interrupt(terminal))
        elif block.title.endswith("(excerpt)"):
            self._check_excerpt(block)
        elif block.title:
            file = self.folder / block.title
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text, encoding="utf-8")
        elif block.language == "python":
            return self._python(rest)
        elif block.language:
            raise AssertionError(f"{block}: neither a command nor a file nor an output")
        return 1

    def _shell(self, block: Block, rest: Sequence[Block]) -> int:
        keeps_running = block.title.endswith(KEEPS_RUNNING)
        terminal = block.title.removesuffix(KEEPS_RUNNING).strip(" ,")
        if terminal in self._terminals:
            self._interrupt(terminal)
        has_output = bool(rest) and rest[0].language == "text"
        has_output = has_output and not rest[0].title.endswith(AFTER_CTRL_C)
        lines = [self._replaced(line) for line in commands(block)]
        started = self._start(["bash", "-eu", "-c", "\n".join(lines)], terminal)
        if keeps_running:
            self._terminals[terminal] = started
            assert has_output, f"{block}: it keeps running, but shows no output to wait for"
            started.wait_for(rest[0])
        else:
            output = started.succeed(block)
            if has_output:
                compare(rest[0], output)
        return 2 if has_output else 1

    def _replaced(self, command: str) -> str:
        instead = self._instead.get(command)
        return command if instead is None else instead.command

    def _python(self, rest: Sequence[Block]) -> int:
        """Run consecutive blocks as one program; compare the output of each."""
        program: list[Block] = []
        outputs: dict[int, Block] = {}
        for block in rest:
            if block.language == "python" and not block.title:
                program.append(block)
            elif block.language == "text" and not block.title:
                outputs[len(program) - 1] = block
            else:
                break
        separated = f"print({_SEPARATOR!r})\n".join(block.text for block in program)
        words = [sys.executable, "-W", "error", "-c", separated]
        printed = self._start(words, "Python").succeed(program[0])
        for part, output in enumerate(printed.split(_SEPARATOR + "\n")):
            if part in outputs:
                compare(outputs[part], output)
        return len(program) + len(outputs)

    def _check_excerpt(self, block: Block) -> None:
        file = self.folder / block.title.removesuffix("(excerpt)").strip()
        text = file.read_text(encoding="utf-8")
        for line in block.text.splitlines():
            shown = line.removesuffix("...").rstrip()
            assert shown in text, f"{block}: not in {block.title}: {line}"

    def _start(self, words: Sequence[str], terminal: str) -> "Started":
        self._commands += 1
        log = self.folder.parent / f"{self._commands:02} {terminal or 'First terminal'}.log"
        return Started([*self._inside, *words], self._environment, log)

    def _interrupt(self, terminal: str) -> str:
        """Press Ctrl-C in a terminal; return all that it printed."""
        started = self._terminals.pop(terminal)
        os.killpg(started.process.pid, signal.SIGINT)
        started.end(WAIT_S)
        return started.output


class Started:
    """A started command, in a process group of its own, with its output in a file."""

    def __init__(self, words: Sequence[str], environment: Mapping[str, str], log: Path) -> None:
        self._log = log
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                words,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    @property
    def output(self) -> str:
        """Return what it has printed so far."""
        return self._log.read_text(encoding="utf-8", errors="replace")

    def succeed(self, block: Block) -> str:
        """Wait for its end without an error; return its output."""
        self.end(LIMIT_S)
        code = self.process.returncode
        assert code == 0, f"{block}: exit code {code}:\n{self.output}"
        return self.output

    def wait_for(self, expected: Block) -> None:
        """Wait until its output begins as a block of the page."""
        deadline = time.monotonic() + WAIT_S
        while not re.match(_pattern(expected), _normal(self.output)):
            is_late = self.process.poll() is not None or time.monotonic() > deadline
            assert not is_late, _difference(expected, self.output)
            time.sleep(0.05)

    def end(self, limit_s: float) -> None:
        """Wait for its end; kill it if that comes too late."""
        try:
            self.process.wait(limit_s)
        except subprocess.TimeoutExpired:
            self.kill()
            raise AssertionError(f"no end within {limit_s} s:\n{self.output}") from None

    def kill(self) -> None:
        """End it and all processes that it started."""
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


def commands(block: Block) -> list[str]:
    """Return the commands of a shell block, one a line, without comments."""
    text = block.text.replace("\\\n", " ")
    lines = (re.sub(r"(?:^|\s+)#.*$", "", line).strip() for line in text.splitlines())
    return [re.sub(r"\s+", " ", line) for line in lines if line]


def compare(expected: Block, output: str) -> None:
    """Compare an output with a block of the page; numbers may differ."""
    assert re.fullmatch(_pattern(expected), _normal(output)), _difference(expected, output)


def _difference(expected: Block, output: str) -> str:
    return f"{expected}: expected\n{expected.text}\ngot\n{output}"


def _normal(text: str) -> str:
    """Return the lines that are not empty, with single spaces and none at their ends."""
    lines = (re.sub(r"\s+", " ", line).strip() for line in text.splitlines())
    return "".join(line + "\n" for line in lines if line)


def _pattern(expected: Block) -> str:
    lines = []
    for line in _normal(expected.text).splitlines():
        if line == "...":
            lines.append(r"(?:.*\n)*?")
            continue
        parts = re.split(f"({_NUMBER}|{_HASH}|\\.\\.\\.)", line)
        lines.append("".join(map(_part, parts)) + r" ?\n")
    return "".join(lines)


def _part(part: str) -> str:
    if part == "...":
        return ".*"
    for masked in (_NUMBER, _HASH):
        if re.fullmatch(masked, part):
            return masked
    return re.escape(part)
