# SPDX-License-Identifier: BSD-3-Clause
"""Labels of maps and remarks on maps, in the current language, by variable name."""

import re
from collections.abc import Mapping
from typing import Any

from rockfall.language import is_message, localised, say, word
from rockfall.result.variables import MAP

#: Name of a map, and its positions along additional dimensions, as in `flat_maps`.
PARTS = re.compile(r"(.+?)((?:_[\d.]+(?:e[+-]?\d+)?(?:kJ|years))*)")
PLACE = re.compile(r"([\d.e+-]+)(kJ|years)")
QUANTILE = re.compile(r"(.+)_q(\d\d)")
LIMITS = {"_low": "variable.lower_limit", "_high": "variable.upper_limit"}
MEDIAN = 50
#: Message ids of remarks on maps, by name pattern.
COMMENTS = {
    r"reach_probability_(low|high)": "comment.wilson",
    r".+_q\d\d_(low|high)": "comment.limits",
    r".+_q\d\d": "comment.quantile",
    r"passing_height_max": "comment.passing_height",
    r"energy_line_angle_(max|min)": "comment.energy_line_angle",
    r"tree_impacts": "comment.tree_impacts",
}


def map_label(name: str, long_name: str) -> str:
    """Label of a map; its long name if there is no message."""
    parts = PARTS.fullmatch(name)
    base, places = parts.groups() if parts else (name, "")
    label = _label(base)
    if not label:
        return long_name
    at = (f"{localised(value)} {word(unit)}" for value, unit in PLACE.findall(places))
    return ", ".join([label, *at])


def map_comment(name: str, attrs: Mapping[str, Any]) -> list[str]:
    """Remark on the values of a map, if its attributes include one."""
    if "comment" not in attrs:
        return []
    keys = (key for pattern, key in COMMENTS.items() if re.fullmatch(pattern, name))
    return [next(map(say, keys), str(attrs["comment"]))]


def _label(name: str) -> str:
    """Label of a plan map; "" if there is no message."""
    if is_message(f"variable.{name}"):
        return say(f"variable.{name}")
    for end, key in LIMITS.items():
        if name.endswith(end) and name in MAP:
            return say(key, name=name.removesuffix(end))
    if match := QUANTILE.fullmatch(name):
        base, level = match[1], int(match[2])
        if level == MEDIAN and is_message(f"variable.{base}_median"):
            return say(f"variable.{base}_median")
        if is_message(f"variable.{base}_quantile"):
            return say(f"variable.{base}_quantile", level=level)
        if what := _label(base):
            return say("variable.over_runs", what=what, level=level)
    return ""
