# SPDX-License-Identifier: BSD-3-Clause
"""Cases of the block laboratory: blocks, ground and throws.

A case is a namelist file whose group &lab has a ground; the groups &block, &ground and &throw
change single values. The kernel defines names, defaults and limits of the physics; data/grounds.csv
has strength and relief of the grounds.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rockfall.case.text import kernel_text, namelist_text, plain_values, read_groups
from rockfall.errors import RockfallError, check_kernel
from rockfall.grounds import shipped_rows, yielding_ground
from rockfall.grounds.impact_tables import CONSTANTS, YieldingGround
from rockfall.grounds.relief import Spectrum
from rockfall.grounds.shapes import SHAPES, Surface, hull, random_block, refine
from rockfall.io.files import read_text
from rockfall.io.tables import read_table
from rockfall.kernel_rules import USUAL_DENSITY
from rockfall_lab._lab import lab_f2py as _lab
from rockfall_lab.case import THROWN, like, names, names_ground, range_values

PLANNED = {  # keys of the kernel's plan_t, by group
    "block": ("radius", "density", "count", "edge"),
    "ground": (
        "relief", "shortest", "longest", "hurst", "patches", "rest_angle", "yield_exponent",
        "fitted_radius",
    ),
    "throw": ("step_factor",),
}  # fmt: skip
WHOLE = "count", "patches"
#: Shapes given by the user in a key of &block with the same name, with an example.
GIVEN_SHAPES = {"axes": "0.5, 0.4, 0.3", "points": "'FILE.csv'"}


STIFFNESS = 120.0  # stiffness of the foundation, times R_b over the yield pressure


@cache
def grounds() -> dict[str, dict[str, Any]]:
    """Values of &ground for each shipped ground, by name."""
    rows = shipped_rows()
    return {name: ground_values(*yielding_ground(rows.rows[name])) for name in rows.yielding}


def ground_values(model: str, ground: YieldingGround) -> dict[str, Any]:
    """Values of &ground for a yielding ground, at its median strength."""
    grows = bool(ground.strength_radius)
    radius = ground.strength_radius or ground.relief_radius
    return {
        **CONSTANTS[model],
        "yield_pressure": ground.strength,
        "restitution": restitution_of(ground.strength, USUAL_DENSITY),
        "relief": float(ground.reliefs(np.array(radius))),
        "rest_angle": ground.rest_angle,
        "yield_exponent": float(grows),
        "fitted_radius": radius,
    }


def restitution_of(pressure: float, density: float) -> float:
    """Restitution at 5 m/s of ground with STIFFNESS: yield pressure [Pa], block density [kg/m3]."""
    return float(f"{(0.06 * pressure / density) ** 0.25 / STIFFNESS**0.5:.4g}")


@cache
def _defaults() -> dict[str, dict[str, Any]]:
    """Default of every key except the keys of a ground."""
    plan = dict(zip(names("plan"), _lab.defaults("plan").tolist(), strict=False))
    limits = dict(zip(names("throw"), _lab.defaults("throw").tolist(), strict=False))
    seed, throws, contacts = (int(value) for value in _lab.defaults("block_case")[:3])
    groups: dict[str, dict[str, Any]] = {
        "lab": {"title": "", "seed": seed, "ground": "", "shape": "compact"},
        **{group: {key: plan[key] for key in keys} for group, keys in PLANNED.items()},
    }
    groups["lab"] |= {"throws": throws, "contacts": contacts}
    groups["block"]["points"] = ""
    ranges = {key: [limits[f"{key}_{end}"] for end in ends] for key, ends in THROWN.items()}
    groups["throw"] |= {**ranges, "gravity": limits["gravity"]}
    for values in groups.values():
        values |= {key: int(values[key]) for key in WHOLE if key in values}
    return groups


def is_block_case(path: str | Path) -> bool:
    """Return True if the case in a file has a ground."""
    return names_ground(read_text(path), str(path))


def read_block_case(path: str | Path) -> BlockCase:
    """Read a block-laboratory case from a namelist file."""
    return block_case_of(read_text(path), str(path), Path(path).parent)


def block_case_of(text: str, name: str, folder: Path = Path()) -> BlockCase:
    """Parse a block-laboratory case from a text; file names are relative to a folder."""
    _check(text, name)
    return BlockCase(name=name, folder=folder, **read_groups(text, name))


def _check(text: str, name: str) -> None:
    check_kernel(*_lab.check_block_case(*kernel_text(text.encode(), name)))


class BlockCase:
    """Case of the block laboratory, group by group: `case.ground["friction"]`."""

    def __init__(
        self, *, name: str = "case of blocks", folder: Path = Path(), **groups: Mapping[str, Any]
    ) -> None:
        self.name, self.folder = name, folder
        given = {group: plain_values(values) for group, values in groups.items()}
        ground = given.get("lab", {}).get("ground", "")
        if ground not in grounds():
            names = ", ".join(grounds())
            raise RockfallError(f"{name}: &lab ground = '{ground}': unknown; known: {names}")
        shipped = {"ground": _defaults()["ground"] | grounds()[ground]}
        self._groups = {
            group: {
                key: like(given.get(group, {}).get(key, value), value)
                for key, value in values.items()
            }
            for group, values in (_defaults() | shipped).items()
        }
        for group, values in given.items():  # with unknown keys
            self._groups[group] = {**values, **self._groups.get(group, {})}
        _check(self.text(), name)
        shape, shapes = self.lab["shape"], (*SHAPES, *GIVEN_SHAPES)
        if shape not in shapes:
            raise RockfallError(
                f"{name}: &lab shape = '{shape}': unknown; known: {', '.join(shapes)}"
            )
        for key, example in GIVEN_SHAPES.items():
            if (shape == key) != bool(self.block.get(key)):
                raise RockfallError(
                    f"{name}: &lab shape = '{key}' and &block {key} = {example} need each other"
                )

    def __getattr__(self, group: str) -> dict[str, Any]:
        try:
            return self.__dict__["_groups"][group]
        except KeyError:
            raise AttributeError(f"a case of blocks has no group {group!r}") from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BlockCase) and self._groups == other._groups

    def replace(self, **groups: Mapping[str, Any]) -> BlockCase:
        """Return a copy with other values: `case.replace(ground={"friction": 0.6})`. Another ground
        replaces all values of &ground, including changes to the previous ground."""
        kept = dict(self._groups)
        if groups.get("lab", {}).get("ground", self.lab["ground"]) != self.lab["ground"]:
            del kept["ground"]
        changed = {name: {**kept.get(name, {}), **new} for name, new in groups.items()}
        return BlockCase(name=self.name, folder=self.folder, **(kept | changed))

    def at_radius(self, radius: float) -> BlockCase:
        """Return a copy with blocks of another R_b [m] on the same ground: its relief scales with
        R_b, its strength with R_b to the power `yield_exponent`."""
        ground, factor = self.ground, radius / self.ground["fitted_radius"]
        growth = factor ** ground["yield_exponent"]
        pressure = ground["yield_pressure"] * growth
        met = {
            "yield_pressure": float(f"{pressure:.6g}"),
            "restitution": float(f"{ground['restitution'] * growth**0.25:.4g}"),
            "fitted_radius": radius,
        }
        return self.replace(block={"radius": radius}, ground=met)

    def text(self) -> str:
        """The complete case as the text of a namelist file."""
        return namelist_text(self._groups, indent=2)

    def row(self, kind: str) -> np.ndarray:
        """Kernel row in the order of `names(kind)`."""
        values = self.ground if kind == "ground" else {"gravity": self.throw["gravity"]}
        if kind == "throw":
            values |= range_values(self.throw)
        return np.array([float(values[key]) for key in names(kind)])

    def spectrum(self) -> Spectrum:
        """Spectrum of the relief of the ground."""
        ground = self.ground
        return Spectrum(ground["relief"], ground["shortest"], ground["longest"], ground["hurst"])

    def surfaces(self) -> list[Surface]:
        """Surfaces of the blocks, refined to facets of the size `edge` in &block."""
        if self.block["points"]:
            blocks = [hull(*_points(self.folder / self.block["points"]))]
        else:
            axes = self.block.get("axes") or SHAPES[self.lab["shape"]]
            seed, count = self.lab["seed"], self.block["count"]
            blocks = [random_block(axes, seed, k) for k in range(count)]
        return [refine(block, self.block["edge"]) for block in blocks]


def relief_keys(spectrum: Spectrum) -> dict[str, float]:
    """Keys of &ground that define a relief by its spectrum."""
    return {
        "relief": round(spectrum.slope, 2),
        "shortest": spectrum.shortest,
        "longest": spectrum.longest,
        "hurst": round(spectrum.hurst, 2),
    }


def _points(path: Path) -> tuple[np.ndarray, str]:
    """Points (n, 3) of a CSV file with columns x, y, z in any unit of length, and its name. Refuses
    missing columns."""
    where, columns, rows = read_table(path)
    for name in "xyz":
        if name not in columns:
            raise RockfallError(f"{where}: column {name}: is missing")
    points = [[row.number(name, -1e6, 1e6) for name in "xyz"] for row in rows]
    return np.array(points), str(path)
