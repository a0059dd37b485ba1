# SPDX-License-Identifier: BSD-3-Clause
"""The messages explained in docs/faq.md are those that the program prints."""

import ast
import re

import pytest

from programs import ROOT

MESSAGES = re.findall(r"^### `(.+)`$", (ROOT / "docs/faq.md").read_text("utf-8"), re.MULTILINE)


def texts():
    """Yield texts of the program, with NUL for inserted values: of the English catalogue and of
    Python one by one, of each Fortran file joined."""
    catalogue = (ROOT / "python/rockfall/locale/en.po").read_text(encoding="utf-8")
    for text in re.findall(r'^msgstr(?:\[\d\])? (".*")$', catalogue, re.MULTILINE):
        yield re.sub(r"\{.*?\}", "\0", ast.literal_eval(text))
    for path in (ROOT / "python/rockfall").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.JoinedStr):
                parts = [part.value for part in node.values]
                yield "".join(part if isinstance(part, str) else "\0" for part in parts)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
    for path in (ROOT / "fortran/src").rglob("*.f90"):
        code = re.sub(r'" *(//)? *&\s*(//)? *&?"', "", path.read_text(encoding="utf-8"))
        yield "\0".join(re.findall(r'"([^"\n]*)"', code))


@pytest.fixture(scope="module")
def said():
    return list(texts())


def test_there_are_messages():
    assert len(MESSAGES) >= 30 and len(set(MESSAGES)) == len(MESSAGES)


@pytest.mark.parametrize("message", MESSAGES)
def test_message_is_in_the_source(message, said):
    parts = [part.strip() for part in message.split("...") if part.strip()]
    pattern = re.compile(r".*?".join(map(re.escape, parts)), re.DOTALL)
    able = [one for one in said if parts[0] in one]  # faster than the pattern
    assert any(pattern.search(one) for one in able), f"nothing says: {message}"
