# SPDX-License-Identifier: BSD-3-Clause
"""The interface promised in docs/stability_policy.md changes only deliberately."""

import difflib
from importlib.util import find_spec

import pytest

from programs import find_program
from tools.interface import LIST, listed

RENEW = (
    "The interface is not that of tests/interface.txt. If so meant: `python tools/interface.py`, "
    "a line in CHANGELOG.md, and what docs/stability_policy.md asks for."
)


def test_the_interface_is_the_one_that_is_promised():
    if not find_program():
        pytest.skip("rockfall-batch is not built")
    promised, found = LIST.read_text(encoding="utf-8").splitlines(), listed().splitlines()
    if not find_spec("rockfall_lab"):
        promised = [line for line in promised if not line.startswith("rockfall lab ")]
    differs = difflib.unified_diff(promised, found, "promised", "found", lineterm="", n=0)
    assert promised == found, "\n".join([RENEW, *differs])


def test_what_is_listed_is_sorted_out_by_kind_and_stands_once():
    for block in LIST.read_text(encoding="utf-8").split("\n\n"):
        title, *lines = block.splitlines()
        assert title.startswith("# ") and lines
        assert len({*lines}) == len(lines), title
