# SPDX-License-Identifier: BSD-3-Clause
"""Catalogues of texts: all languages have the same ids and placeholders, and every id is used."""

import json
import re
from pathlib import Path
from string import Formatter

import pytest

pytest.importorskip("babel", reason="needed to check the catalogues")
from babel.messages.pofile import read_po  # noqa: E402

from rockfall.analysis.hazard.classes import CLASSES  # noqa: E402
from rockfall.errors import RockfallError  # noqa: E402
from rockfall.grounds import IMPACT_SETS, models  # noqa: E402
from rockfall.language import (  # noqa: E402
    LANGUAGES,
    Number,
    catalogue,
    is_message,
    packed,
    say,
    say_count,
    speaking,
    translated,
    unpacked,
    word,
)
from rockfall.result.maps.map_labels import map_comment, map_label  # noqa: E402
from rockfall.result.variables import MAP, OUTCOME, STATUS  # noqa: E402
from rockfall.studies.ensemble.uncertain_inputs import INPUTS  # noqa: E402

PACKAGE = Path(__file__).parents[2] / "python/rockfall"
PAGE = Path(__file__).parents[2] / "web/src"  # page of `rockfall app`; uses only "app...." ids


def messages(language):
    """Forms of each message by id: one, or singular and plural."""
    with (PACKAGE / f"locale/{language}.po").open("rb") as source:
        found = read_po(source, locale=language, abort_invalid=True)
    several = {one.id: one.string for one in found if one.id}
    return {
        key if isinstance(key, str) else key[0]: [text] if isinstance(text, str) else [*text]
        for key, text in several.items()
    }


ENGLISH = messages("en")


@pytest.mark.parametrize("language", LANGUAGES)
def test_entries_are_apart(language):
    text = (PACKAGE / f"locale/{language}.po").read_text(encoding="utf-8")
    entries = re.split(r"\n{2,}", text.strip())
    assert [
        entry for entry in entries if entry.count("\nmsgid ") + (entry[:6] == "msgid ") != 1
    ] == []
    assert "\n\n\n" not in text
    assert [one for one in entries if ("msgstr[" in one) != ("\nmsgid_plural " in one)] == []
    forms = [one.count("\nmsgstr") - ("\nmsgid_plural " in one) for one in entries]
    assert {*forms} == {1}, "two texts for one id"


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
    families = [  # f"word.{name}", and `app.key.${name}` on the page
        *re.findall(r"""f["']([a-z_]+\.[^"'\s]*\{[^"'\s]+)["']""", texts),
        *(one.replace("${", "{") for one in re.findall(r"`(app\.[^`\s]*\$\{[^`\s]+)`", page)),
    ]
    families = [re.sub(r"\\\{.+?\\\}", ".+", re.escape(one)) for one in families]
    made = re.compile("|".join(families))
    quoted = {*re.findall("(?<=[\"'])[\\w.]+(?=[\"'])", texts + page)}
    assert [key for key in ENGLISH.keys() - quoted if not made.fullmatch(key)] == []
    assert {*re.findall(r"'(app\.[a-z_0-9.]+)'", page)} - ENGLISH.keys() == set()
    said = re.findall(r"""(?<!\w)say(?:_count)?\(\s*["']([a-z_]+\.[a-z_0-9]+)["']""", texts)
    kinds = "axis|comment|compare|ended|input|model|quantity|variable|word"
    said += re.findall(rf"""["']((?:{kinds})\.[a-z_]+)["']""", texts)
    assert {*said} - ENGLISH.keys() == set()


def test_a_text_can_be_said_again_in_another_language():
    part = say_count("count.part_of_boulders", 1000, part=20, fraction=Number("2.0 %"))
    text = say("model.faster", part=part, limit=0.8)
    with speaking("de"):
        again = translated(text)
        assert again.startswith("20 von 1\u202f000 Blöcken (2,0 %) überschritten 0,8 m/s je Grad")
        assert unpacked(json.loads(json.dumps(packed(text))), text) == again
        assert translated("a name, 1.5") == "a name, 1.5" and translated(Number("1.5")) == "1,5"
    assert translated(again) == text


@pytest.mark.parametrize(
    "data",
    [
        None,
        7,
        {},
        {"id": "model.later", "values": {}},
        {"id": "model.faster", "values": {"part": "x"}},
        {"id": "input.dam_height", "values": {"highest": "high"}},
        {"id": "{x:9}", "values": {"x": 1}},
        {"id": 7, "values": {}},
        {"id": "count.part_of_boulders", "values": {"n": "x"}, "is_count": True},
    ],
)
def test_damaged_and_later_messages_are_in_english(data):
    with speaking("de"):
        assert unpacked(data, "as it was") == "as it was"


def test_maps_are_called_as_in_files():
    for name, about in MAP.items():
        assert map_label(name, about["long_name"]) == about["long_name"]
        assert map_comment(name, about) == ([about["comment"]] if "comment" in about else [])
        with speaking("de"):
            assert map_label(name, about["long_name"]) != about["long_name"]
            assert not {*map_comment(name, about)} & {about.get("comment")}
    assert map_label("energy_exceeded_30kJ", "") == f"{MAP['energy_exceeded']['long_name']}, 30 kJ"
    assert map_label("energy_max_q05", "") == (
        f"{MAP['energy_max']['long_name']}: 5% quantile over the runs"
    )
    assert map_label("mine", "my own, 30 kJ") == "my own, 30 kJ"


@pytest.mark.parametrize("name", INPUTS)
def test_uncertain_inputs_are_called_as_in_files(name):
    assert say(f"uncertain.{name}") == name


@pytest.mark.parametrize("name", [*STATUS, *OUTCOME, *CLASSES, *models(), IMPACT_SETS])
def test_identifiers_have_words(name):
    if name != "none":
        assert is_message(f"word.{name}") and word(name) == name.replace("_", " ")


def test_numbers_are_written_in_the_format_of_the_language():
    shown = {"line": "1.5 m", "fraction": Number("1,234.5"), "energy": 1, "height": 2}
    assert say("summary.line_fraction", **shown) == "1.5 m: 1,234.5 % of the boulders pass."
    with speaking("de"):
        found = say("summary.line_fraction", **shown)
        assert found == "1.5 m: 1\u202f234,5 % der Blöcke passieren."
        assert say_count("inputs.doubtful", 1).startswith("1 Eingabe ")
        assert say_count("inputs.doubtful", 2000).startswith("2\u202f000 Eingaben ")
    assert say_count("inputs.doubtful", 1).startswith("1 input ")


@pytest.mark.parametrize(
    ("locale", "number"),
    [
        ("en-GB", "1,234.5"), ("de-AT", "1\u202f234,5"), ("de-CH", "1’234.5"),
        ("fr-CH", "1\u202f234,5"), ("it-CH", "1’234.5"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_in_the_region(locale, number):
    with speaking(locale):
        shown = say("summary.line_fraction", line="L", fraction=Number("1,234.5"))
        assert number in shown
    with speaking(locale[:2]):
        assert shown.replace(number, "X") == say("summary.line_fraction", line="L", fraction="X")


def test_german_outside_switzerland_has_its_own_spelling():
    """Texts for Germany and Austria have ß after long vowels and diphthongs, ss after short vowels,
    and no Swiss words."""
    swiss, austrian = catalogue("de").forms, catalogue("de-AT").forms
    assert swiss == catalogue("de-CH").forms
    assert austrian == catalogue("de-DE").forms and austrian.keys() == swiss.keys()
    text = "\n".join(form for forms in austrian.values() for form in forms)
    for word_in in (
        "Straße",
        "außerhalb",
        "Blockgröße",
        "Maßstab",
        "gemäß",
        "Schutzmaßnahmen",
        "umschließen",
        "Masse",
        "Klasse",
        "Grundriss",
        "passieren",
        "zulässig",
    ):
        assert word_in in text, word_in
    wrong = r"\w*(?:[Gg]r[oö]ss|[Ss]trass|[Aa]usser|liess|[Mm]assst|gem[äa]ss|Resultat)\w*"
    assert re.findall(wrong, text) == []
    assert {word for word in re.findall(r"\w*ß\w*", text) if "ßs" in word} == {"Maßstab"}
    for key, forms in austrian.items():
        assert [*map(places, forms)] == [*map(places, swiss[key])], key


@pytest.mark.parametrize("language", ["xx", "de-XX", "xx-AT", "de-", "DE", "de_AT"])
def test_an_unknown_language_is_refused(language):
    with pytest.raises(RockfallError) as caught:
        catalogue(language)
    assert str(caught.value) == (
        f"language = '{language}': must be one of en, de, fr, it, or with a region: de-AT, de-CH"
    )
