# SPDX-License-Identifier: Apache-2.0
import argparse

from groundlink.cli.commands import GROUPS, parser


def test_every_command_is_listed_once_with_its_help() -> None:
    groundlink = parser()
    (commands,) = (a for a in groundlink._actions if isinstance(a, argparse._SubParsersAction))
    lists = groundlink.format_help().split("\n\n")
    titles = {text.partition(":\n")[0]: text for text in lists}
    assert [title for title in titles if title in GROUPS] == list(GROUPS)
    listed = "\n".join(titles[title] for title in GROUPS)
    for action in commands._get_subactions():
        assert listed.count(f"\n  {action.dest} ") == 1
        assert action.help is not None
        assert action.help[:20] in listed
    assert len(commands._get_subactions()) == len(commands.choices)
