# SPDX-License-Identifier: BSD-3-Clause
"""Texts by message id in the current language, from the gettext catalogues `locale/*.po`.

English is a catalogue like the others, so rewording it does not change the ids. Placeholders are
named; numbers and lists are formatted for the language. A text keeps its message id and values, so
that it can be shown in another language later.
"""

import gettext
import importlib.resources
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from numbers import Real
from string import Formatter
from typing import Any

from rockfall.errors import RockfallError

LANGUAGES = ("en", "de", "fr", "it")
#: Regions that may follow a language code, as in de-AT.
REGIONS = ("AT", "CH", "DE", "FR", "GB", "IT", "LI", "LU", "US")
#: Thousands separator and decimal sign of languages other than English (ISO 80000-1), and of
#: regions that use the Swiss format.
MARKS = str.maketrans({",": "\u202f", ".": ","})
SWISS_MARKS = str.maketrans({",": "\u2019"})
SWISS = ("de-CH", "de-LI", "it-CH")
#: The German catalogue uses Swiss spelling; these words take ß elsewhere, after a long vowel.
NOT_SWISS = ("de-AT", "de-DE", "de-LU")
SPELLING = (
    (re.compile(r"(gr[oö]|stra|lie|st[oö]|f[uü]|m[aä](?=ss(?:st|g|n|ig|\b))|au(?=sse[rn]))ss",
                re.IGNORECASE), r"\1ß"),
    (re.compile(r"\bResultat(?=d|k)"), "Ergebnis"),
    (re.compile(r"\bResultat(e?)(?=\b)"), lambda match: "Ergebnisse" if match[1] else "Ergebnis"),
    (re.compile(r"\bResultats\b"), "Ergebnisses"),
)  # fmt: skip
_in_force: ContextVar[str] = ContextVar("language", default="en")


class Number(str):
    """A number formatted in English; `say` converts it to the format of the language."""

    __slots__ = ()


class Text(str):
    """A text, with the message id and the values used to make it."""

    key: str
    values: Mapping[str, Any]
    is_count: bool  # True for texts from `say_count`


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Use a language for texts within the block."""
    catalogue(language)
    token = _in_force.set(language)
    try:
        yield
    finally:
        _in_force.reset(token)


def spoken() -> str:
    """Current language."""
    return _in_force.get()


class Catalogue:
    """Messages of a `.po` file, each on one line; Python's gettext reads compiled files only."""

    ENTRY = re.compile(r'^msgid (".*")\n(?:msgid_plural .*\n)?((?:msgstr.*\n?)+)', re.MULTILINE)

    def __init__(self, text: str, locale: str) -> None:
        spelt = spelling(locale)
        self.forms: dict[str, list[str]] = {
            json.loads(key): [spelt(json.loads(form)) for form in re.findall('".*"', forms)]
            for key, forms in self.ENTRY.findall(text)
        }
        self.plural = gettext.c2py(re.findall("plural=(.+?);", text)[0])

    def gettext(self, key: str) -> str:
        """Message for a key, or the key itself if there is none."""
        return self.forms.get(key, [key])[0]

    def ngettext(self, key: str, n: int) -> str:
        """Message for a key in the plural form for `n`, or the key itself if there is none."""
        return self.forms[key][self.plural(n)] if key in self.forms else key


@cache
def catalogue(language: str) -> Catalogue:
    """Catalogue for a language code with or without region; raises RockfallError if unknown."""
    name, dash, region = language.partition("-")
    if name not in LANGUAGES or (dash and region not in REGIONS):
        raise RockfallError(
            f"language = '{language}': must be one of {', '.join(LANGUAGES)}, or with a region: "
            "de-AT, de-CH"
        )
    path = importlib.resources.files("rockfall") / "locale" / f"{name}.po"
    return Catalogue(path.read_text(encoding="utf-8"), language)


def spelling(locale: str) -> Callable[[str], str]:
    """Return a function that applies the spelling of a region to a text."""
    rules = SPELLING if locale in NOT_SWISS else ()

    def spelt(text: str) -> str:
        for words, own in rules:
            text = words.sub(own, text)
        return text

    return spelt


def texts_of(language: str, room: str) -> dict[str, str]:
    """Messages whose ids begin with `room`, by id; placeholders are not filled in."""
    forms = catalogue(language).forms
    return {key: texts[0] for key, texts in forms.items() if key.startswith(f"{room}.")}


def say(key: str, /, **values: object) -> Text:
    """Text of a message with `values` filled in."""
    return _said(key, values)


def remark(where: object, key: str, /, **values: object) -> Text:
    """Text of a message about a place in the inputs: a file, or a group and key."""
    return say("input.remark", where=str(where), text=say(key, **values))


def say_count(key: str, n: int, /, **values: object) -> Text:
    """Text of a message about `n` items, in the plural form of the language."""
    return _said(key, {"n": n, **values}, is_count=True)


def word(name: str) -> str:
    """Word for an identifier, such as a boulder status or the ground model. An identifier without
    a message, such as a name chosen by the user, is returned as plain words."""
    key = f"word.{name}"
    return say(key) if is_message(key) else name.replace("_", " ")


def is_message(key: str) -> bool:
    """Return True if the catalogues have a message for the key."""
    return catalogue("en").gettext(key) != key


def translated(text: object) -> str:
    """Text or number in the current language; other strings are returned unchanged."""
    if isinstance(text, Text):
        return _said(text.key, text.values, text.is_count)
    return localised(text) if isinstance(text, Number) else str(text)


def localised(number: str, language: str = "") -> str:
    """Convert a number formatted in English to the format of a language (default: current)."""
    locale = language or _in_force.get()
    if locale.startswith("en"):
        return number
    return str(number).translate(SWISS_MARKS if locale in SWISS else MARKS)


def packed(text: object) -> Any:
    """Text as data for JSON, from which `unpacked` restores it."""
    if isinstance(text, Text):
        values = {name: packed(value) for name, value in text.values.items()}
        return {"id": text.key, "values": values} | ({"is_count": True} if text.is_count else {})
    if isinstance(text, Number):
        return {"number": str(text)}
    if isinstance(text, (list, tuple)):
        return [packed(item) for item in text]
    return text.item() if hasattr(text, "item") else text


def unpacked(data: Any, english: str) -> str:
    """Text from data made by `packed`; the stored `english` text if the data are damaged or the
    message belongs to a later version."""
    try:
        return _unpacked(data) if isinstance(data, dict) else str(english)
    except (AttributeError, KeyError, TypeError, ValueError):
        return str(english)


def packed_texts(texts: Sequence[str]) -> tuple[str, str]:
    """Texts as stored in files: one per line, and the JSON from which `unpacked_texts` restores
    them."""
    return "\n".join(texts), json.dumps([packed(text) for text in texts])


def unpacked_texts(lines: str, data: str) -> list[str]:
    """Texts stored by `packed_texts`, in the current language."""
    pairs = zip(json.loads(data), lines.splitlines(), strict=True)
    return [unpacked(own, english) for own, english in pairs]


def _unpacked(data: Any) -> Any:
    if isinstance(data, list):
        return [_unpacked(item) for item in data]
    if not isinstance(data, dict):
        return data
    if "number" in data:
        return Number(data["number"])
    values = {str(name): _unpacked(value) for name, value in data["values"].items()}
    if not is_message(data["id"]):
        raise KeyError(data["id"])
    return _said(data["id"], values, bool(data.get("is_count")))


def _said(key: str, values: Mapping[str, Any], is_count: bool = False) -> Text:
    messages = catalogue(_in_force.get())
    message = messages.ngettext(key, int(values["n"])) if is_count else messages.gettext(key)
    text = Text(_FILL.vformat(message, (), values))
    text.key, text.values, text.is_count = key, values, is_count
    return text


class _Fill(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, (list, tuple)):
            return catalogue(_in_force.get()).gettext("join.list").join(map(translated, value))
        shown = format(translated(value) if isinstance(value, Text) else value, format_spec)
        return localised(shown) if isinstance(value, (Real, Number)) else shown


_FILL = _Fill()
