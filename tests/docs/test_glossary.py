# SPDX-License-Identifier: BSD-3-Clause
"""The catalogues use the terms of docs/glossary.csv, one term for each thing in each language."""

import csv
import re
import unicodedata

import pytest

from programs import ROOT
from rockfall.language import LANGUAGES, catalogue

TERMS = [*csv.DictReader((ROOT / "docs/glossary.csv").read_text("utf-8").splitlines())]
OTHERS = [language for language in LANGUAGES if language != "en"]
#: English words with exactly one translation per language; 'slope' and others have several.
SINGLE = {
    "barrier", "bedrock", "cliff", "crest", "dam", "deposit", "elevation", "fragment", "hazard",
    "intensity", "median", "net", "object", "obstacle", "part", "population", "quantile", "raster",
    "result", "speed", "terrain", "threshold", "trajectory", "variant", "volume", "wall", "zone",
}  # fmt: skip
#: Texts where the context replaces a term.
EXCEPT = {"figures.passing_open", "figures.profile", "model.observed_set", "model.spheres_set",
          "validity.not_drawn", "page.sections", "qgis.relief", "risk.traffic",
          "uncertain.ground"}  # fmt: skip


def folded(text):
    """Lower case without accents, umlauts and special spaces."""
    return unicodedata.normalize("NFKD", text.lower()).encode("ascii", "ignore").decode()


def pattern(term, language):
    """Pattern of a term with any ending, and in German also within a compound."""
    words = folded(re.sub(r" \(.*\)", "", term)).split()
    if language == "it":  # plurals change the last letter
        words = [re.sub("h?.$", "", word) if len(word) > 3 else word for word in words]
    elif language == "de":  # endings of adjectives, and of Szenario
        words = [re.sub("(e[rs]?|o)$", "", word) if len(word) > 3 else word for word in words]
    else:
        words = [word.replace("-", "s?-") for word in words]
    return re.compile(("" if language == "de" else r"\b") + r"\W+".join(f"{w}\\w*" for w in words))


def plain(text):
    return re.sub(r"\{[^}]*\}|`[^`]*`|'[a-z]+'|&\w+(?: [a-z_]+)?|--\w+", "#", text)


def texts(language):
    forms = catalogue(language).forms
    return {key: " ".join(text) for key, text in forms.items() if key}


def test_there_are_terms():
    names = [term["en"] for term in TERMS]
    assert len(names) >= 120 and names == sorted(names, key=str.lower)
    assert len({*names}) == len(names)
    assert all(term[language].strip() for term in TERMS for language in LANGUAGES)
    assert all(term["meaning"].strip() for term in TERMS)


@pytest.mark.parametrize("language", OTHERS)
def test_no_second_word_is_used_for_a_term(language):
    for term in TERMS:
        for word in filter(None, term[f"not_{language}"].split("; ")):
            end = "" if word.endswith("*") else r"(?!\w)"
            other = re.compile(rf"(?<!\w){re.escape(word.rstrip('*'))}{end}", re.IGNORECASE)
            found = [key for key, text in texts(language).items() if other.search(plain(text))]
            assert not found, f"{word}: {term[language]} ({term['en']})"


@pytest.mark.parametrize("language", OTHERS)
def test_texts_use_the_terms(language):
    """The longest term has priority: an "impact table" is not an "impact"."""
    terms = sorted(TERMS, key=lambda term: -len(term["en"]))
    english, other, missing = texts("en"), texts(language), []
    for key in english.keys() - EXCEPT:
        left = plain(english[key]).lower()
        for term in terms:
            word = re.compile(rf"\b{term['en'].lower()}s?\b".replace(" ", r"\s"))
            if not word.search(left):
                continue
            is_label = word.fullmatch(left)
            left = word.sub("#", left)
            if (is_label or " " in term["en"] or term["en"] in SINGLE) and not pattern(
                term[language], language
            ).search(folded(other[key])):
                missing.append((key, term["en"], term[language], other[key]))
    assert missing == []
