# SPDX-License-Identifier: BSD-3-Clause
"""Catalogues of texts: all languages have the same ids and placeholders, and each is used."""

import re
from pathlib import Path
from string import Formatter

import pytest

pytest.importorskip("babel", reason="the report extra is not installed")
from babel.messages.pofile import read_po  # noqa: E402

from rockfall.errors import RockfallError  # noqa: E402
from rockfall.language import LANGUAGES, Number, catalogue, say, say_count, speaking  # noqa: E402

PACKAGE = Path(__file__).parents[2] / "python/rockfall"
PAGE = Path(__file__).parents[2] / "web/src"  # of `rockfall app`; says "app...." only


def messages(language):
    """Forms of each message by its id: one, or singular and plural."""
    with (PACKAGE / f"locale/{language}.po").open("rb") as source:
        found = read_po(source, locale=language, abort_invalid=True)
    several = {one.id: one.string for one in found if one.id}
    return {
        key if isinstance(key, str) else key[0]: [text] if isinstance(text, str) else [*text]
        for key, text in several.items()
    }


ENGLISH = messages("en")


def places(text):
    return sorted({f"{name}:{spec}" for _, name, spec, _ in Formatter().parse(text) if name})


@pytest.mark.parametrize("language", LANGUAGES)
def test_all_languages_have_the_same_ids_and_placeholders(language):
    found = messages(language)
    assert found.keys() == ENGLISH.keys()
    for key, forms in found.items():
        assert len(forms) == len(ENGLISH[key]), key
        for form, english in zip(forms, ENGLISH[key], strict=True):
            assert form.strip() and places(form) == places(english), key


def test_every_id_is_used_and_exists():
    files = [*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.j2")]
    texts = "\n".join(path.read_text(encoding="utf-8") for path in files)
    page = "\n".join(path.read_text(encoding="utf-8") for path in PAGE.rglob("*.ts"))
    begun = tuple(re.findall(r"`(app\.[a-z_0-9.]*)\$\{", page))  # `app.key.${name}`
    unused = [key for key in ENGLISH if f'"{key}"' not in texts and f"'{key}'" not in texts]
    assert [key for key in unused if f"'{key}'" not in page and not key.startswith(begun)] == []
    assert {*re.findall(r"'(app\.[a-z_0-9.]+)'", page)} - ENGLISH.keys() == set()
    said = re.findall(r"""(?<!\w)say(?:_count)?\(\s*["']([a-z_]+\.[a-z_0-9]+)["']""", texts)
    assert {*said} - ENGLISH.keys() == set()


def test_numbers_are_written_in_the_format_of_the_language():
    shown = {"line": "1.5 m", "fraction": Number("1,234.5"), "energy": 1, "height": 2}
    assert say("summary.line_fraction", **shown) == "1.5 m: 1,234.5 % of the boulders pass."
    with speaking("de"):
        found = say("summary.line_fraction", **shown)
        assert found == "1.5 m: 1\u202f234,5 % der Blöcke passieren."
        assert say_count("inputs.doubtful", 1).startswith("1 Eingabe ")
        assert say_count("inputs.doubtful", 2000).startswith("2\u202f000 Eingaben ")
    assert say_count("inputs.doubtful", 1).startswith("1 input ")


def test_an_unknown_language_is_refused():
    with pytest.raises(RockfallError, match="language = 'xx': must be one of en, de, fr, it"):
        catalogue("xx")
