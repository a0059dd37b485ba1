# SPDX-License-Identifier: BSD-3-Clause
"""Rules for keys that only studies use: &ensemble, &hazard, &scenario and &variant. The kernel
checks types and ranges of values, and the rules for runs.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rockfall.case.keys import keys_of
from rockfall.limits import MAX_NAME

#: Keys of &variant that select groups of a repeatable kind.
CHOSEN = {"barriers": "barrier", "dams": "dam"}
BASE = "base"  # name of the case without its variants
#: Factors of &ensemble that `draws` may have as columns.
FACTORS = tuple(key for key in keys_of("ensemble") if key.endswith("_factor"))

ROCKS = {  # keys of &surface with rock sizes
    "zones", "mean_radius", "rg70", "uniform_mean_radius", "uniform_rg",
}  # fmt: skip

Groups = Mapping[str, Any]  # groups with keys and values, repeatable groups as lists
Broken = Iterator[tuple[str, str]]  # keys, and the rules that they violate


class Fault(NamedTuple):
    """A key that violates a rule."""

    group: str
    number: int  # number of the group among groups of the same name, from 1
    key: str
    rule: str


def first_fault(groups: Groups, at_points: bool) -> Fault | None:
    """First key of &ensemble, &hazard, &scenario and &variant that violates a rule; None if none
    does."""
    checks = [("ensemble", 1, _ensemble(groups)), ("hazard", 1, _hazard(groups))]
    for number in range(1, len(groups["scenario"]) + 1):
        checks.append(("scenario", number, _scenario(groups, number, at_points)))
    for number in range(1, len(groups["variant"]) + 1):
        checks.append(("variant", number, _variant(groups["variant"], number)))
    faults = (
        Fault(group, number, key, rule) for group, number, broken in checks for key, rule in broken
    )
    return next(faults, None)


def _ensemble(groups: Groups) -> Broken:
    """Check &ensemble. Factors apply to boulders of the case and of the source layer, whose values
    are unknown until it is read."""
    ensemble, boulder, release = (groups[name] for name in ("ensemble", "boulder", "release"))
    if ensemble["dem_error"] > 0 and "dem_correlation" not in ensemble:
        yield "dem_correlation is missing", "needed for dem_error"
    if "dem_correlation" in ensemble and not ensemble["dem_error"]:
        yield "dem_correlation", "is only valid with a dem_error"
    if ensemble["radius_factor"] > 1 and not ROCKS & groups["surface"].keys():
        yield "radius_factor", "is only valid with rock sizes in &surface"
    if "draws" in ensemble:
        if ensemble["source_shift"] > 0:
            yield "source_shift", "must be 0: draws gives it"
        for key in FACTORS:
            if ensemble[key] > 1:
                yield key, "must be 1: draws gives it"
    if "points" in release or "polygons" in release:
        return
    if ensemble["volume_std_factor"] > 1 and not boulder.get("volume_std"):
        yield "volume_std_factor", "is only valid with a volume_std"
    if ensemble["drop_height_factor"] > 1 and not release["drop_height"]:
        yield "drop_height_factor", "is only valid with a drop_height"


def _hazard(groups: Groups) -> Broken:
    """Check &hazard. Classes must not decrease with intensity or frequency, so that the classes at
    the limits of a frequency interval bound all classes in between."""
    hazard = groups["hazard"]
    periods, factor = hazard["return_periods"], hazard["frequency_factor"]
    if any(later <= earlier for earlier, later in pairwise(periods)):
        yield "return_periods", "must increase"
    if len(factor) != 2:
        yield "frequency_factor", "must be two factors, the lowest first"
    elif not factor[0] <= 1 <= factor[1]:
        yield "frequency_factor", "must enclose 1"
    if not groups["scenario"]:
        return
    classes = keys_of("hazard")["matrix"].allowed.split(", ")  # ascending
    numbers = np.array([classes.index(word) for word in hazard["matrix"]])
    intensities = len(hazard["thresholds"]) + 1
    if numbers.size != intensities * len(periods):
        yield (
            "matrix",
            f"must be {intensities} x {len(periods)} classes: {intensities} intensities, each with "
            f"{len(periods)} return periods",
        )
        return
    matrix = numbers.reshape(intensities, len(periods))
    if (np.diff(matrix, axis=0) < 0).any() or (np.diff(matrix, axis=1) > 0).any():
        yield "matrix", "must not decrease with energy or frequency"


def _scenario(groups: Groups, number: int, at_points: bool) -> Broken:
    *earlier, given = groups["scenario"][:number]
    rates = "frequency", "return_period", "activity"
    if len(given["name"].encode()) > MAX_NAME:
        yield "name", f"must be at most {MAX_NAME} characters"
    if sum(rate in given for rate in rates) != 1:
        yield ", ".join(rates), "give one of the three"
    if "activity" in given and given.get("volume", groups["boulder"]["volume"]) != "pareto":
        yield "activity", "is only valid with volume = 'pareto'"
    if given["frequency_per"] == "km2" and at_points:
        yield "frequency_per", "is not valid for points, which have no area"
    if (given["frequency_per"] == "m") != ("cliff_length" in given):
        yield "frequency_per, cliff_length", "'m' and cliff_length must be given together"
    if given["name"] in (other["name"] for other in earlier):
        yield "name", "must be unique among scenarios"
    if "activity" in given and "volume" in given:
        for key in "volume_min", "volume_max", "volume_exponent":
            if key not in given:
                yield f"{key} is missing", "needed for volume = 'pareto'"


def _variant(variants: list[Groups], number: int) -> Broken:
    """Check that a variant is consistent, and that its name is a valid file name. The variant's
    case is checked when it is built."""
    *earlier, given = variants[:number]
    name = given["name"]
    if len(name.encode()) > MAX_NAME:
        yield "name", f"must be at most {MAX_NAME} bytes"
    if name[0] in ". " or name[-1] in ". " or {*name} & {*'/\\:*?"<>|,='}:
        yield (
            "name",
            "is also a file name: must not begin or end with a dot or blank, or contain any of "
            '/ \\ : * ? " < > | , =',
        )
    if _lower(name) == BASE.encode():
        yield "name", "is reserved for the case without its variants: choose another name"
    for key, group in CHOSEN.items():
        if key in given and group in given.get("without", []):
            yield key, f"is not valid together with without = '{group}'"
    if _lower(name) in (_lower(other["name"]) for other in earlier):
        yield "name", "must be unique among variants, in lower case, too"


def _lower(name: str) -> bytes:
    """Name in lower case (ASCII), because file systems may ignore case."""
    return name.encode().lower()
