# SPDX-License-Identifier: Apache-2.0
"""Bisection: searches the smallest change that makes a good run bad.

Pure algorithms on candidates and verdicts. They start no run and know no scenario, file or commit;
`groundlink/cli/bisect` does.
"""
