# SPDX-License-Identifier: BSD-3-Clause
"""Grounds of a first case, recognised from the names of zones."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from rockfall.draft.recognise import Layer
from rockfall.errors import RockfallError
from rockfall.grounds import models, shipped_rows, table_names
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.grounds.impact_tables import tables_of_all_shapes
from rockfall.io.zone_table import RADII

#: Shipped grounds: meaning, and prefixes of terms for such zones in English, German, French and
#: Italian. Each has an impact table.
GROUNDS = {
    "rock": (
        "bedrock, rock face, ledge",
        ("rock", "bedrock", "cliff", "slab", "fels", "wand", "roche", "falaise", "paroi", "rocci",
         "parete"),
    ),
    "rocky-slope": (
        "rocks in contact, with their mean radius measured",
        ("rocky", "blockfeld", "blockhang"),
    ),
    "talus": (
        "scree, blocks and stones that shift underfoot",
        ("talus", "scree", "debris", "schutt", "geröll", "geroell", "hangschutt", "blockschutt",
         "éboulis", "eboulis", "pierrier", "detrit", "ghiaion", "pietraia"),
    ),
    "compact": (
        "road, track, berm, quarry floor",
        ("compact", "road", "track", "berm", "asphalt", "strasse", "straße", "weg", "route",
         "chemin", "piste", "strada", "pista"),
    ),
    "meadow": (
        "firm turf, alpine meadow, pasture",
        ("meadow", "pasture", "grass", "turf", "wiese", "weide", "alpweide", "prairie", "pâturage",
         "paturage", "pré", "prat", "pascol"),
    ),
    "vegetated-soil": (
        "soil with shrubs or forest floor",
        ("vegetated", "forest", "shrub", "bush", "wald", "gebüsch", "forêt", "foret", "bosc"),
    ),
    "soft-soil": (
        "deep soil in which a foot sinks",
        ("soft", "marsh", "bog", "weich", "moor", "sumpf", "marais", "tourb", "molle", "palud"),
    ),
}  # fmt: skip
CHOICES = ", ".join(GROUNDS)
ID = "zone"  # attribute with the zone id

#: Takes a question and returns the answer; "" for no answer.
Ask = Callable[[str], str]


def recognised(name: str) -> str:
    """Ground recognised from a term in a name; "" if none or several are recognised."""
    words = re.split(r"[\W\d_]+", name.lower())
    grounds = {ground for word in words if (ground := _of_word(word))}
    return grounds.pop() if len(grounds) == 1 else ""


def _of_word(word: str) -> str:
    """Ground with the longest prefix that matches a word; `rocky` does not count as rock."""
    prefixes = {prefix: ground for ground, (_, start) in GROUNDS.items() for prefix in start}
    longest = max(filter(word.startswith, prefixes), key=len, default="")
    return prefixes.get(longest, "")


def check_ground(name: str, where: str) -> None:
    """Raise a RockfallError for a name that is not a shipped ground."""
    shipped = {*shipped_rows().rows, *table_names(), *shipped_sets()}
    if name not in shipped:
        raise RockfallError(
            f"{where}: no ground '{name}': must be {CHOICES}, or another ground of docs/grounds.md"
        )


def needs_rocks(ground: str) -> bool:
    """Return True if a shipped ground needs the size of its rocks."""
    if row := shipped_rows().rows.get(ground):
        return models()[row.cells["model"]] > 0
    return ground in shipped_sets() or ground in tables_of_all_shapes()


@dataclass
class Grounds:
    """Grounds given for a draft, and the zones that use them."""

    usual: str = ""  # for zones without a ground, or for a case without zones
    by_zone: Mapping[str, str] = field(default_factory=dict)  # keys: names, or ids as text
    ask: Ask | None = None
    used: set[str] = field(default_factory=set)  # zones in `by_zone` that exist
    answers: dict[str, str] = field(default_factory=dict)  # question -> answer
    zones: dict[tuple[str, str], list[str]] = field(default_factory=dict)  # keys: ground and reason

    def __post_init__(self) -> None:
        if self.usual:
            check_ground(self.usual, "--ground")
        for zone, ground in self.by_zone.items():
            check_ground(ground, f"--ground {zone}={ground}")

    def of_case(self, where: str) -> str:
        """Ground of a case without zones."""
        return self.usual or self._asked("the slope", where, "GROUND")

    def of_zone(self, layer: Layer, k: int) -> str:
        """Ground of a polygon: given for its zone, from its attribute or name, the default, or the
        answer to a question."""
        labels = _labels(layer, k)
        self.used |= self.by_zone.keys() & {*labels}
        given = next((self.by_zone[label] for label in labels if label in self.by_zone), "")
        if not given and (own := layer.text(layer.attribute("ground"), k)):
            return own
        title = f"zone {labels[0]}" if labels else f"feature {k + 1}"
        by_name = recognised(labels[0]) if labels and not given else ""
        ground = given or by_name or self.usual
        if not ground:
            sizes = [(key, layer.text(layer.attribute(key), k)) for key in RADII]
            what = ", ".join([title, *(f"{key} {size} m" for key, size in sizes if size)])
            option = f"'{labels[0]}=GROUND'" if labels else "GROUND"
            ground = self._asked(what, f"{layer}: {title}", option)
        reason = "by name" if by_name else "as given"
        titles = self.zones.setdefault((ground, reason), [])
        if title not in titles:
            titles.append(title)
        return ground

    def notes(self) -> Iterator[str]:
        """Yield notes on the zones of each ground that does not come from an attribute."""
        for (ground, reason), zones in self.zones.items():
            yield f"{', '.join(zones)}: ground {ground} ({reason})"

    def check_used(self, layer: Layer | None) -> None:
        """Raise a RockfallError for grounds given for zones that do not exist."""
        for zone in self.by_zone.keys() - self.used:
            text = f"--ground {zone}={self.by_zone[zone]}"
            if layer is None:
                raise RockfallError(f"{text}: give a layer of zones")
            labels = [_labels(layer, k)[:1] for k in range(len(layer.shapes))]
            has = ", ".join(dict.fromkeys(label for several in labels for label in several))
            raise RockfallError(f"{text}: not in {layer}, which has {has or 'no names and ids'}")

    def _asked(self, what: str, where: str, option: str) -> str:
        """Answer to a question, posed only once; raises a RockfallError without an answer."""
        if what not in self.answers:
            if self.ask is None or not (ground := self.ask(what)):
                raise RockfallError(
                    f"{where}: ground is missing: give --ground {option}, of {CHOICES}"
                )
            check_ground(ground, what)
            self.answers[what] = ground
        return self.answers[what]


def _labels(layer: Layer, k: int) -> list[str]:
    """Name and id of a polygon, if present."""
    columns = layer.name_column, layer.attribute(ID)
    return [*filter(None, (layer.text(column, k) for column in columns))]
