# SPDX-License-Identifier: BSD-3-Clause
"""Model warnings of one or more runs, without repetition, as Python warnings and as a result
attribute."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, TypeVar

from rockfall.analysis.validity.remark import STOPS
from rockfall.analysis.validity.remarks import model_warnings
from rockfall.case import case_of
from rockfall.language import Text, say
from rockfall.quantities import first_of
from rockfall.result.dataset import MODEL_WARNINGS

if TYPE_CHECKING:
    import xarray as xr

    from rockfall.result.contents import Held

    Result = TypeVar("Result", bound=xr.Dataset)

TELLING = "line", "names"  # values that distinguish warnings with the same message
MAX_NAMED = 3  # maximum results listed in a warning


def joint_warnings(results: Mapping[str, Held]) -> list[Text]:
    """Model warnings of several results (by name), as in `joined_warnings`."""
    return joined_warnings(
        {name: model_warnings(result, case_of(result)) for name, result in results.items()}
    )


def joined_warnings(by_name: Mapping[str, Iterable[Text]]) -> list[Text]:
    """Warnings of several results (by name), each once and ordered by grade. A warning has the
    values of the result with the largest fraction of boulders or rebounds; unless it applies to all
    results, the names of its results precede it."""
    return in_order(
        text
        if len(names) == len(by_name)
        else say("join.colon", before=", ".join(first_of(names, MAX_NAMED)), after=text)
        for text, names in _with_names(by_name)
    )


def worst_warnings(by_name: Mapping[str, Iterable[Text]]) -> list[Text]:
    """Warnings as in `joined_warnings`, without the names."""
    return in_order(text for text, _ in _with_names(by_name))


def _with_names(by_name: Mapping[str, Iterable[Text]]) -> Iterator[tuple[Text, list[str]]]:
    """Each warning with its worst values, and the names of its results."""
    texts: dict[tuple[str, ...], Text] = {}
    names: dict[tuple[str, ...], list[str]] = {}
    for name, own in by_name.items():
        for text in own:
            what = (text.key, *(str(text.values.get(value)) for value in TELLING))
            texts[what] = max(texts.get(what, text), text, key=_fraction)
            names.setdefault(what, []).append(name)
    yield from zip(texts.values(), names.values(), strict=True)


def in_order(texts: Iterable[Text]) -> list[Text]:
    """Warnings about wrong results (`STOPS`), with or without the name of a place or run, before
    all others."""
    kinds = {text: text.values.get("after", text) for text in texts}
    return sorted(kinds, key=lambda text: getattr(kinds[text], "key", "") not in STOPS)


def _fraction(text: Text) -> float:
    """Largest fraction of boulders or rebounds in a warning; 0 if it has none."""
    parts = [value.values for value in text.values.values() if isinstance(value, Text)]
    return max((own["part"] / own["n"] for own in parts if {"part", "n"} <= own.keys()), default=0)


def with_model_warnings(result: Result) -> Result:
    """Result with its model warnings as an attribute, one per line."""
    texts = model_warnings(result, case_of(result))
    return result.assign_attrs({MODEL_WARNINGS: "\n".join(texts)})


def warned_of_model(result: Result) -> Result:
    """Add the model warnings to a result, and issue them as Python warnings attributed to the
    caller's caller."""
    result = with_model_warnings(result)
    warn_each(dict.fromkeys(result.attrs[MODEL_WARNINGS].splitlines()), stacklevel=4)
    return result


def warn_each(texts: Iterable[str], stacklevel: int = 3) -> None:
    """Issue texts as Python warnings, by default attributed to the caller's caller."""
    for text in texts:
        warnings.warn(text, stacklevel=stacklevel)
