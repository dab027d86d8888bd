# SPDX-License-Identifier: Apache-2.0
"""Extended regular expressions, as POSIX defines them."""

import pytest

from udp_bridge_ros2.standard_services.posix_regex import compile_posix


@pytest.mark.parametrize(
    ("pattern", "matches", "others"),
    [
        ("rover", ["rover"], ["rover2", "a_rover", "Rover", ""]),
        ("rover.*", ["rover", "rover_2", "rover\n"], ["a_rover"]),
        ("^(rover|crate)[0-9]+$", ["rover1", "crate22"], ["rover", "box1", "rover1\n"]),
        ("a|bc", ["a", "bc"], ["ac", "abc"]),
        ("ab{2}c{1,}d{0,2}", ["abbc", "abbccdd"], ["abc", "abbcddd"]),
        ("(ab)*c?d+", ["d", "ababcdd"], ["c", "aba"]),
        (r"a\.b\\\[", [r"a.b\["], [r"axb\["]),
        (r"[\.]", ["\\", "."], ["a"]),
        ("[]a-c^-]+", ["]", "b", "^", "-", "]abc-"], ["d", "["]),
        ("[^]a]", ["b", "^"], ["]", "a"]),
        ("[[:alpha:]_][[:alnum:]_]*", ["_", "a1", "Z_9"], ["1a", "é"]),
        ("[[:space:][:digit:]]{2}", [" 1", "\t\n"], ["a1"]),
        ("[[.-.]a[=b=]]+", ["-ab"], ["=", "."]),
        ("[[:upper:]x]", ["Q", "x"], ["q"]),
        ("a&b~#-c", ["a&b~#-c"], []),
    ],
)
def test_whole_names_match(pattern: str, matches: list[str], others: list[str]) -> None:
    found = compile_posix(pattern)
    assert [text for text in (*matches, *others) if found.fullmatch(text)] == matches


@pytest.mark.parametrize(
    ("pattern", "reason"),
    [
        ("*a", "position 0: nothing that '*' can repeat"),
        ("a|+", "position 2: nothing that '+' can repeat"),
        ("(?:a)", "position 1: nothing that '?' can repeat"),
        ("a*?", "position 2: nothing that '?' can repeat"),
        ("a{1}{2}", "position 4: nothing that '{' can repeat"),
        ("a{2,1}", "position 1: expected {m}"),
        ("a{,2}", "position 1: expected {m}"),
        ("a{256}", "position 1: expected {m}"),
        ("a{", "position 1: expected {m}"),
        ("(a", "position 2: '(' without ')'"),
        ("a)", "position 1: ')' without '('"),
        ("[a", "position 2: '[' without ']'"),
        ("[]", "position 2: '[' without ']'"),
        ("[b-a]", "a range must ascend"),
        ("[[:alpha:]-z]", "a range must ascend"),
        ("[[:letter:]]", "unknown class '[:letter:]'"),
        ("[[.ab.]]", "unknown class '[.ab.]'"),
        (r"\d", "position 1: '\\' must precede a punctuation character"),
        ("a\\", "position 2: '\\' must precede a punctuation character"),
    ],
)
def test_what_posix_leaves_undefined_is_refused(pattern: str, reason: str) -> None:
    with pytest.raises(ValueError, match="regular expression ") as caught:
        compile_posix(pattern)
    assert reason in str(caught.value)
