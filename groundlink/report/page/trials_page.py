# SPDX-License-Identifier: Apache-2.0
"""Page of a vehicle's trials: figures and plots as one self-contained HTML file."""

from collections.abc import Sequence
from importlib.resources import files
from string import Template

from groundlink.report.analysis.trials import Trial
from groundlink.report.figures.trials import trial_plots

from .html import Markup, figure, joined, paragraph, section, table, text, tiles

COLUMNS = ("figure", "measured", "expected")


def trials_page(vehicle: str, trials: Sequence[Trial]) -> str:
    """Return the whole page."""
    template = Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    passed = sum(trial.good for trial in trials)
    return template.substitute(
        title=text(f"Trials of {vehicle}"),
        subtitle=text("Each trial starts at rest on dry, level ground with a friction of 1."),
        verdict=_verdict(trials),
        facts=tiles([(f"{passed} of {len(trials)}", "trials passed")]),
        sections=joined(_section(trial) for trial in trials),
        footer=text("made by groundlink try"),
    )


def _verdict(trials: Sequence[Trial]) -> Markup:
    failed = [trial for trial in trials if not trial.good]
    if not failed:
        return Markup('<div class="verdict">All figures are as expected.</div>')
    lines = (f"{trial.name}: {trial.fix}" for trial in failed)
    items = "".join(f"<li>{text(line)}</li>" for line in lines)
    return Markup(f'<div class="verdict failed">Try this:<ul>{items}</ul></div>')


def _section(trial: Trial) -> Markup:
    rows = [(one.name, str(one), one.expected) for one in trial.figures]
    bad = [number for number, one in enumerate(trial.figures) if not one.good]
    parts = [table(COLUMNS, rows, numbers=(1,), bad=bad), figure(trial_plots(trial), "")]
    if bad:
        parts.append(paragraph(f"Fix: {trial.fix}."))
    return section(trial.description.capitalize(), *parts)
