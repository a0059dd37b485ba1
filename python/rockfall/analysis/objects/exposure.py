# SPDX-License-Identifier: BSD-3-Clause
"""Expected harm to property and persons by a hit, from attributes, with all assumptions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall.analysis.objects.attributes import NAMED, Layer
from rockfall.analysis.objects.vulnerability import BUILDING, Curve, constant, doubt, stepped
from rockfall.errors import RockfallError
from rockfall.language import Text, remark, say, word

QUANTITIES = ("damage", "individual_risk", "collective_risk")
PRESENCE, LETHALITY, VEHICLE_LENGTH, TRIPS = 1.0, 1.0, 5.0, 2.0  # defaults of missing attributes
BY_DEFAULT = "default"  # source of a default curve
HOURS, METRES = 24.0, 1000.0  # hours per day, metres per kilometre
MAX_NAMED = 5  # maximum number of objects listed in an assumption
ALWAYS = (  # messages that apply to every risk
    "risk.any_height", "risk.alone", "risk.independent", "risk.expected", "risk.limits",
    "risk.classes",
)  # fmt: skip


class Harm(NamedTuple):
    """Expected harm per boulder: scale x curve(energy), for traffic also x (diameter + length)."""

    scale: float
    curve: Curve
    length: float | None = None  # vehicle length [m]; None: not a vehicle

    def by(self, energy: np.ndarray, diameter: np.ndarray) -> np.ndarray:
        """Harm by boulders with these energies [J] and diameters [m]; 0 for NaN (a miss)."""
        hit = np.isfinite(energy)
        harm = np.zeros(energy.size)
        harm[hit] = self.scale * self.curve.fraction(energy[hit])
        if self.length is not None:
            harm[hit] *= diameter[hit] + self.length
        return harm

    def most(self, diameter: float) -> float:
        """Upper bound of the harm by boulders up to this diameter [m]."""
        extent = 1.0 if self.length is None else diameter + self.length
        return self.scale * self.curve.most * extent


@dataclass(frozen=True)
class Exposure:
    """Harm to each object, by quantity (None if nothing is at risk), and assumptions."""

    kinds: list[str] = field(default_factory=list)
    harms: dict[str, list[Harm | None]] = field(default_factory=dict)
    assumptions: list[Text] = field(default_factory=list)

    def __bool__(self) -> bool:
        return bool(self.harms)


def read_exposure(
    layer: Layer,
    names: list[str],
    thresholds: np.ndarray,
    curves: Mapping[str, Curve],
    without_energy: Iterable[int],
) -> Exposure:
    """Exposure of the objects in a layer; empty without persons, traffic, and property (values of
    buildings, or with `curve`). For objects `without_energy`, only the counts above the thresholds
    [J] are known."""
    kinds = layer.texts("kind")
    buildings = layer.has("value") and any(map(_is_building, kinds))
    has_curve = layer.has("curve") and layer.has("value")
    if not buildings and not has_curve and not any(map(layer.has, ("persons", "aadt"))):
        return Exposure()
    points = {*without_energy}
    damage, unknown = _damage(layer, kinds, thresholds, curves)
    deaths = _Deaths(layer, thresholds, curves, points)
    harms: dict[str, list[Harm | None]] = {"damage": damage}
    for quantity in QUANTITIES[1:]:
        harms[quantity] = [getattr(death, quantity) for death in deaths.found]
    notes = [*_of_damage(damage, names), *deaths.notes(names)]
    if unknown:
        notes.append(say("risk.no_vulnerability", names=_listed(names, unknown)))
    if exposed := [k for k in points if any(harms[harm][k] for harm in harms)]:
        notes.append(say("risk.points", names=_listed(names, exposed)))
    return Exposure(kinds, harms, [*notes, *map(say, ALWAYS)])


def curve_remarks(
    path: str | Path, curves: Mapping[str, Curve], exposed: Exposure
) -> Iterator[Text]:
    """Remarks if objects use no curve of a table, or curves that are probably in other units."""
    used = [
        (harm.curve, quantity == "damage")
        for quantity in QUANTITIES
        for harm in exposed.harms.get(quantity, [])
        if harm and curves.get(harm.curve.name) is harm.curve and harm.curve != BUILDING
    ]
    if not used:
        yield remark(path, "input.curves_unused")
    for curve, is_property in used:
        if question := doubt(curve, is_property):
            yield say("input.remark", where=str(path), text=question)


def _is_building(kind: str) -> bool:
    return kind.casefold() == "building"


def joined(parts: Sequence[tuple[Exposure, int]]) -> Exposure:
    """Exposure of the objects in several layers, given the number of objects in each."""
    if not any(exposure for exposure, _ in parts):
        return Exposure()
    kinds = [kind for exposure, size in parts for kind in exposure.kinds or [""] * size]
    harms: dict[str, list[Harm | None]] = {
        name: [harm for exposure, size in parts for harm in exposure.harms.get(name, [None] * size)]
        for name in QUANTITIES
    }
    notes = dict.fromkeys(text for exposure, _ in parts for text in exposure.assumptions)
    own = (note for note in notes if note.key not in ALWAYS)
    return Exposure(kinds, harms, [*own, *map(say, ALWAYS)])


def _damage(
    layer: Layer, kinds: list[str], thresholds: np.ndarray, curves: Mapping[str, Curve]
) -> tuple[list[Harm | None], list[int]]:
    """Damage to property, and the objects that have a value but no vulnerability. Vulnerability
    comes from `curve`, else from the vulnerability attributes, else from the default for
    buildings."""
    if not layer.has("value"):
        return [None] * layer.size, []
    worth = layer.numbers("value", 1.0) * layer.numbers("exposure", 1.0)
    named = _named_curves(layer, "curve", curves)
    steps = layer.by_intensity("vulnerability", thresholds.size + 1)
    harms: list[Harm | None] = []
    for k, (kind, curve) in enumerate(zip(kinds, named, strict=True)):
        if curve is None and len(steps):
            curve = stepped(thresholds, steps[k])
        elif curve is None and _is_building(kind):
            curve = BUILDING
        harms.append(None if curve is None else Harm(float(worth[k]), curve))
    unknown = [k for k, harm in enumerate(harms) if harm is None and worth[k] > 0]
    return harms, unknown


class _OfPersons(NamedTuple):
    individual_risk: Harm | None = None
    collective_risk: Harm | None = None


class _Deaths:
    """Harm to the persons of each object."""

    def __init__(
        self,
        layer: Layer,
        thresholds: np.ndarray,
        curves: Mapping[str, Curve],
        points: set[int],
    ) -> None:
        self.layer = layer
        self.numbers = {
            name: layer.numbers(name, np.nan, missing=True)
            for name in (
                "persons", "presence", "aadt", "speed", "vehicle_length", "persons_per_vehicle",
                "trips",
            )
        }  # fmt: skip
        self.curves = self._lethalities(thresholds, curves)
        self.defaults: dict[tuple[str, float], list[int]] = {}
        self.found = [self._of(k, points) for k in range(layer.size)]

    def _lethalities(
        self, thresholds: np.ndarray, curves: Mapping[str, Curve]
    ) -> list[Curve | None]:
        """Lethality for each object from `lethality_curve`, else from its attributes, else None."""
        named = _named_curves(self.layer, NAMED, curves)
        steps = self.layer.by_intensity("lethality", thresholds.size + 1, missing=True)
        for k, fractions in enumerate(steps):
            if named[k] is None and not np.isnan(fractions).any():
                named[k] = stepped(thresholds, fractions)
        return named

    def _of(self, k: int, points: set[int]) -> _OfPersons:
        persons, aadt = self.numbers["persons"][k], self.numbers["aadt"][k]
        if not np.isnan(persons) and not np.isnan(aadt):
            self.layer.refuse(k, "aadt", f"{aadt:g}", "cannot be combined with persons")
        if persons > 0:
            curve, presence = self._lethality(k), self._number(k, "presence", PRESENCE)
            return _OfPersons(Harm(presence, curve), Harm(persons * presence, curve))
        if aadt > 0:
            if k in points:
                self.layer.refuse(
                    k, "aadt", f"{aadt:g}", "needs a line, a polygon, or a point with a width"
                )
            return self._of_traffic(k, float(aadt))
        return _OfPersons()

    def _of_traffic(self, k: int, aadt: float) -> _OfPersons:
        """Harm to road users per metre of road that a boulder hits: individual risk of a person who
        passes `trips` times a day, and collective risk of all traffic."""
        for name in ("speed", "persons_per_vehicle"):
            if np.isnan(self.numbers[name][k]):
                self.layer.refuse(k, "aadt", f"{aadt:g}", f"needs the attribute {name}")
        curve, length = self._lethality(k), self._number(k, "vehicle_length", VEHICLE_LENGTH)
        # mean number of vehicles on a metre of road, for one vehicle per day
        per_metre = 1 / (HOURS * METRES * float(self.numbers["speed"][k]))
        inside = float(self.numbers["persons_per_vehicle"][k])
        return _OfPersons(
            Harm(self._number(k, "trips", TRIPS) * per_metre, curve, length),
            Harm(aadt * inside * per_metre, curve, length),
        )

    def _number(self, k: int, name: str, default: float) -> float:
        """Value of an attribute, or its default, which is noted as an assumption."""
        if np.isnan(value := self.numbers[name][k]):
            self.defaults.setdefault((name, default), []).append(k)
            return default
        return float(value)

    def _lethality(self, k: int) -> Curve:
        if (curve := self.curves[k]) is None:
            self.defaults.setdefault(("lethality", LETHALITY), []).append(k)
            return constant(LETHALITY, source=BY_DEFAULT)
        return curve

    def notes(self, names: list[str]) -> Iterator[Text]:
        """Assumptions about persons."""
        at_rest = [k for k, death in enumerate(self.found) if _rests(death.individual_risk)]
        moving = [k for k, death in enumerate(self.found) if _moves(death.individual_risk)]
        if at_rest:
            yield say("risk.at_rest", names=_listed(names, at_rest))
        if moving:
            yield say("risk.traffic", names=_listed(names, moving))
            yield say("risk.not_included", names=_listed(names, moving))
        harms = [death.individual_risk for death in self.found]
        yield from _of_curves("risk.lethality", harms, names)
        for (name, value), defaults in self.defaults.items():
            shown = _listed(names, defaults)
            yield say("risk.default", name=word(name), value=value, names=shown)


def _rests(harm: Harm | None) -> bool:
    return harm is not None and harm.length is None


def _moves(harm: Harm | None) -> bool:
    return harm is not None and harm.length is not None


def _of_damage(harms: list[Harm | None], names: list[str]) -> Iterator[Text]:
    """Assumptions about property."""
    if any(harms):
        yield say("risk.damage")
    yield from _of_curves("risk.vulnerability", harms, names)


def _of_curves(key: str, harms: list[Harm | None], names: list[str]) -> Iterator[Text]:
    """Assumptions about curves in use, with their sources and objects."""
    rows: dict[tuple[str, str], list[int]] = {}
    for k, harm in enumerate(harms):
        if harm is not None:
            rows.setdefault((harm.curve.name, harm.curve.source), []).append(k)
    for (name, source), objects in rows.items():
        cited = word(source) if source == BY_DEFAULT else source
        yield say(key, curve=name, source=cited, names=_listed(names, objects))


def _named_curves(layer: Layer, name: str, curves: Mapping[str, Curve]) -> list[Curve | None]:
    """Curve of each object, from the text attribute `name`; None if empty. Refuses unknown
    names."""
    named: list[Curve | None] = []
    for number, text in enumerate(layer.texts(name), start=1):
        if text and text not in curves:
            raise RockfallError(
                f"{layer.path}: feature {number}: {name} = {text}: must be one of: "
                f"{', '.join(curves)}, or a curve of the --vulnerability table"
            )
        named.append(curves[text] if text else None)
    return named


def _listed(names: list[str], objects: list[int]) -> str:
    """Names of objects; only the first if there are many."""
    shown = ", ".join(names[k] for k in objects[:MAX_NAMED])
    more = len(objects) - MAX_NAMED
    return say("risk.and_more", names=shown, more=more) if more > 0 else shown
