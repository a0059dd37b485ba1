# SPDX-License-Identifier: BSD-3-Clause
"""Forms for editing a document: fields for the keys of each group and for the feature attributes
of each layer, with units and ranges from the kernel's table; and checks of values."""

from functools import cache
from typing import Any, NamedTuple

from rockfall.app.messages import Refused
from rockfall.case import REPEATABLE, Case, Key, default_values, key_table, keys_of
from rockfall.grounds import GroundTable, parameters, table_names, table_path
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.language import say
from rockfall.result.variables import MAP
from rockfall.scene.frames import GROUPS
from rockfall.scene.lines import OF_LAYER
from rockfall.scene.releases.source_attributes import AXES, LAWS, VELOCITY, VOLUMES

MAX_TEXT = 200  # maximum characters of a value
MAX_VALUES = 1000  # maximum length of a list
MAX_INTEGER = 2**53  # largest integer that JSON keeps exact in a browser
#: Keys that set places, replaced by layers of a document.
DRAWN = {
    "release": {"x", "y", "points", "points_layer", "polygons", "polygons_layer", "name_field"},
    "surface": {"zones_layer", "zone_field"},
}
GROUND_KEYS = {("surface", "ground")}  # keys whose values could name another file
PLACES = OF_LAYER - {"name"}  # keys of lines that are not attributes of features
REST = "rest"  # marks the zone polygons that fill the terrain around the drawn zones


class Field(NamedTuple):
    """A form field, as sent to the page; `min` and `max` are optional limits."""

    name: str
    kind: str  # real, integer, text, logical, or count (an integer or a word)
    list: bool
    default: Any
    allowed: str
    choices: tuple[str, ...] | None
    min: float | None
    max: float | None
    unit: str
    meaning: str
    read_only: bool = False
    most: int = 1

    def about(self) -> dict[str, Any]:
        """The field as sent to the page."""
        return {name: value for name, value in self._asdict().items() if name != "most"}


Form = dict[str, Field]


def settings_forms(grounds: tuple[str, ...] | None) -> dict[str, Form]:
    """Form fields of the groups with settings; `grounds` are the allowed names (None: any)."""
    forms: dict[str, Form] = {}
    for key in key_table():
        if key.group not in REPEATABLE and key.name not in DRAWN.get(key.group, ()):
            field = _field(key)
            if (key.group, key.name) in GROUND_KEYS:
                field = field._replace(choices=grounds)
            forms.setdefault(key.group, {})[key.name] = field
    return forms


def layer_forms(case: Case, zones: bool, grounds: tuple[str, ...] | None) -> dict[str, Form]:
    """Form fields for the features of each layer; `zones` is True if the page can draw zones."""
    keys = {(key.group, key.name): key for key in key_table()}
    text = Key("", "name", "text", 1, "absent", "", "", "")
    names = ("density", "drop_height")
    groups = {"density": "boulder", "drop_height": "release"}
    law = _field(keys["boulder", "volume"])._replace(choices=LAWS, default=None)
    sources = {"name": _field(text), "volume": law}
    sources |= {name: _attribute(keys["boulder", name]) for name in VOLUMES}
    sources |= {name: _attribute(keys[groups[name], name]) for name in names}
    sources["block_shape"] = _attribute(keys["boulder", "block_shape"])
    sources |= {
        axis: _field(
            Key("", axis, "real", 1, "absent", "> 0", "m", "measured axis of blocks", low=0)
        )
        for axis in AXES
    }
    velocity = _attribute(keys["release", "velocity"])
    sources |= {name: velocity._replace(name=name) for name in VELOCITY}
    sources["frequency"] = _attribute(keys["scenario", "frequency"])
    forms = {"sources": sources}
    for layer, group in GROUPS.items():
        own = keys_of(group).items()
        forms[layer] = {name: _field(key) for name, key in own if name not in PLACES}
    if zones:
        forms["zones"] = _zone_form(case, keys, _field(text), grounds)
    return forms


def _zone_form(
    case: Case, keys: dict[tuple[str, str], Key], name: Field, grounds: tuple[str, ...] | None
) -> Form:
    """Form fields of zones: the number in a table, or the material."""
    number = _field(Key("", "zone", "integer", 1, "absent", "", "", ""))
    if "table" in case.surface:
        return {"zone": number, "name": name}
    radius = _attribute(keys["surface", "uniform_mean_radius"])
    rg = _attribute(keys["surface", "uniform_rg"])
    form = {"name": name, "ground": _field(keys["surface", "ground"])}
    form["ground"] = form["ground"]._replace(choices=grounds)
    form["mean_radius"] = radius._replace(name="mean_radius")
    form |= {attribute: rg._replace(name=attribute) for attribute in ("rg70", "rg20", "rg10")}
    form |= {f"ground_{key}": _pair_field(key) for key in ("strength", "relief")}
    return form | ({"zone": number} if "default_zone" in case.surface else {})


def _pair_field(name: str) -> Field:
    """Field of a ground parameter set by a zone."""
    row = next(parameter for parameter in parameters() if parameter.name == name)
    low, high = row.limits
    return Field(
        f"ground_{name}", "real", False, None, row.allowed, None, low, high, row.unit, row.meaning
    )


def ground_names(*cases: Case) -> tuple[str, ...]:
    """Names of grounds that need no files other than the case's."""
    grounds: list[str] = []
    for case in cases:
        own = [case.surface[key] for _, key in GROUND_KEYS if key in case.surface]
        grounds += [*GroundTable(table_path(case)).rows, *table_names(), *shipped_sets(), *own]
    return tuple(dict.fromkeys(grounds))


def _attribute(key: Key) -> Field:
    """Field for an attribute that replaces a key: it has a single value and no default."""
    return _field(key)._replace(list=False, most=1, default=None)


@cache
def _field(key: Key) -> Field:
    """Field of a key in the kernel's table."""
    choices: tuple[str, ...] | None = None
    if (key.group, key.name) == ("output", "maps"):
        choices = tuple(MAP)
    elif key.kind == "text" and "," in key.allowed:
        choices = tuple(key.allowed.split(", "))
    default = default_values().get(key.group, {}).get(key.name)
    return Field(
        key.name, key.kind, key.most > 1, default, key.allowed, choices, key.low, key.high,
        key.unit, key.meaning, bool(key.file), key.most,
    )  # fmt: skip


def check_value(field: Field, value: Any, **place: str) -> Any:
    """Value in the type of its field; raises Refused if impossible. The kernel checks ranges."""
    if field.list and isinstance(value, list):
        if len(value) > min(field.most, MAX_VALUES):
            raise Refused(say("app.server_too_many", name=field.name), **place)
        return [_checked(field, item, place) for item in value]
    return _checked(field, value, place)


def _checked(field: Field, value: Any, place: dict[str, str]) -> Any:
    kind = field.kind
    if kind == "count":
        kind = "text" if isinstance(value, str) else "integer"
    number = isinstance(value, int | float) and not isinstance(value, bool)
    good = {
        "real": number,
        "integer": number and value == int(value) and abs(value) <= MAX_INTEGER,
        "logical": isinstance(value, bool),
        "text": isinstance(value, str) and value.isprintable() and len(value) <= MAX_TEXT,
    }[kind]
    if good and kind == "real":
        good = abs(value) < 1e300
    if not good:
        raise Refused(say("app.server_wrong_type", name=field.name), **place)
    if kind == "text" and field.choices is not None and value not in field.choices:
        allowed = ", ".join(field.choices)
        raise Refused(say("app.server_choices", name=field.name, allowed=allowed), **place)
    return float(value) if kind == "real" else int(value) if kind == "integer" else value
