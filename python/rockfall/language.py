# SPDX-License-Identifier: BSD-3-Clause
"""Texts by message id in the language in force, translated by gettext from `locale/*.po`.

English is a catalogue like the others: rewording it does not touch the ids. Placeholders have
names, and numbers that fill them are written in the format of the language.
"""

from __future__ import annotations

import gettext
import importlib.resources
import io
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from numbers import Real
from string import Formatter
from typing import Any

from rockfall.errors import RockfallError

LANGUAGES = ("en", "de", "fr", "it")
#: Thousands and decimals outside English (ISO 80000-1).
MARKS = str.maketrans({",": "\u202f", ".": ","})
_in_force: ContextVar[str] = ContextVar("language", default="en")


class Number(str):
    """A number formatted in English, which `say` writes in the format of the language."""

    __slots__ = ()


class Text(str):
    """A text in the language in force; tables and templates take it as it is."""

    __slots__ = ()


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Make texts in this language within the block."""
    catalogue(language)
    token = _in_force.set(language)
    try:
        yield
    finally:
        _in_force.reset(token)


@cache
def catalogue(language: str) -> gettext.GNUTranslations:
    """Texts of a language; a RockfallError for unknown languages."""
    from babel.messages.mofile import write_mo

    compiled = io.BytesIO()
    write_mo(compiled, _messages(language))
    compiled.seek(0)
    return gettext.GNUTranslations(compiled)


@cache
def _messages(language: str) -> Any:
    """Messages of a language, as babel reads them."""
    from babel.messages.pofile import read_po

    if language not in LANGUAGES:
        raise RockfallError(f"language = '{language}': must be one of {', '.join(LANGUAGES)}")
    path = importlib.resources.files("rockfall") / "locale" / f"{language}.po"
    with path.open("rb") as source:
        return read_po(source, locale=language)


def texts_of(language: str, room: str) -> dict[str, str]:
    """All texts, unfilled, of the messages of a room (the first part of their ids)."""
    singular = (one for one in _messages(language) if isinstance(one.id, str))
    return {one.id: one.string for one in singular if one.id.startswith(f"{room}.")}


def say(key: str, /, **values: object) -> Text:
    """Text of a message, filled with these values."""
    return _filled(catalogue(_in_force.get()).gettext(key), values)


def say_count(key: str, n: int, /, **values: object) -> Text:
    """Text of a message on `n` things, in the plural form of the language."""
    found = catalogue(_in_force.get()).ngettext(key, key, n)
    return _filled(found, {"n": n, **values})


def localised(number: str, language: str = "") -> str:
    """Write a number, formatted in English, in the format of a language; default: that in force."""
    return number if (language or _in_force.get()) == "en" else str(number).translate(MARKS)


def _filled(message: str, values: dict[str, object]) -> Text:
    return Text(_FILL.vformat(message, (), values))


class _Fill(Formatter):
    def format_field(self, value: Any, format_spec: str) -> str:
        shown = format(value, format_spec)
        return localised(shown) if isinstance(value, (Real, Number)) else shown


_FILL = _Fill()
