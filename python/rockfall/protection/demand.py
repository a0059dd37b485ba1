# SPDX-License-Identifier: BSD-3-Clause
"""Requirements of standards from the boulders at a barrier: energy, height, EAD class."""

from __future__ import annotations

import numpy as np

from rockfall.analysis.precision.intervals import quantile
from rockfall.kernel_rules import EAD_ENERGY
from rockfall.protection.crossings import Crossings
from rockfall.protection.factors import Factors
from rockfall.result.variables import ENDS
from rockfall.scene.rebounds.kernel_rebounds import sphere_radius

ABOVE = len(EAD_ENERGY)  # class of barriers whose declared energy exceeds the list

ROUNDING = 1e-9  # rounding error of a density computed from an energy

Row = dict[str, float]


def demand(came: Crossings, factors: Factors, density: float, volume: float | None = None) -> Row:
    """Design values in SI units: v_d, m_d, E_d, h_d (of the centre, vertical, and normal to the
    slope), with 95 % limits; `height_needed` = h_d + f_min; and the EAD class for E_d. `volume`
    [m3] is the design block volume (None: a quantile of the boulders that reach the line).
    `density` [kg/m3] is the case's; that of the densest boulder is used if it differs."""
    if volume is None:
        volume = quantile(came.volume, factors["quantile_volume"], came.source)[0]
    values = _uni if factors.conditions.standard == "UNI" else _onr
    row = {"n": came.n, "volume": volume}
    row |= values(came, factors, _density(came, density), volume)
    free = max(factors["free_border"], float(sphere_radius(np.array(volume))))
    row["f_min"] = free if came.n else np.nan
    for name in "height_needed", "normal_height_needed":
        for end in ENDS:
            row[f"{name}{end}"] = row[f"{name.replace('height_needed', 'h_d')}{end}"] + free
    return row | {f"ead_class{end}": class_for(row[f"E_d{end}"], factors) for end in ENDS}


def _density(came: Crossings, density: float) -> float:
    """Density [kg/m3] of the densest boulder, from its energy; the case's density if they agree."""
    moves = came.speed > 0
    mass = 2 * came.energy_translational[moves] / came.speed[moves] ** 2
    densest = float((mass / came.volume[moves]).max(initial=0.0))
    return densest if densest and abs(densest / density - 1) > ROUNDING else density


def class_for(energy: float, factors: Factors) -> float:
    """Lowest EAD class whose usable capacity exceeds an energy [J]; ABOVE if none does, NaN if the
    energy is unknown. Class 0 kits are not tested at SEL."""
    first = 1 if factors.conditions.limit_state == "SEL" else 0
    enough = [k for k in range(first, ABOVE) if energy < usable(EAD_ENERGY[k], factors)]
    return np.nan if np.isnan(energy) else enough[0] if enough else ABOVE


def usable(capacity: float, factors: Factors) -> float:
    """Usable capacity [J] of a barrier with this MEL capacity [J]."""
    return capacity * factors["energy_share"] / factors["gamma_E"]


def _uni(came: Crossings, factors: Factors, density: float, volume: float) -> Row:
    """UNI 11211-4: v_d = v_k gamma_tr gamma_dp; m_d = V density gamma_vol gamma_gamma;
    E_d = m_d v_d^2 / 2; h_d = h_k gamma_tr gamma_dp."""
    path = factors["gamma_tr"] * factors["gamma_dp"]
    mass = volume * density * factors["gamma_vol"] * factors["gamma_gamma"]
    speed = _scaled(came, "speed", factors["quantile_speed"], path)
    row = {"m_d": mass} | _named("v_d", speed)
    row |= _named("E_d", [mass * value**2 / 2 for value in speed])
    return row | _heights(came, factors["quantile_height"], path)


def _onr(came: Crossings, factors: Factors, density: float, volume: float) -> Row:
    """ONR 24810: E_d = E_k gamma_F_energy, for the total energy; h_d = h_k gamma_F_height."""
    energy = _scaled(came, "energy_total", factors["quantile_energy"], factors["gamma_F_energy"])
    speed = _scaled(came, "speed", factors["quantile_speed"], 1.0)
    row = {"m_d": volume * density} | _named("v_d", speed) | _named("E_d", energy)
    return row | _heights(came, factors["quantile_height"], factors["gamma_F_height"])


def _heights(came: Crossings, level: float, factor: float) -> Row:
    row = _named("h_d", _scaled(came, "passing_height", level, factor))
    return row | _named("normal_h_d", _scaled(came, "normal_height", level, factor))


def _scaled(came: Crossings, quantity: str, level: float, factor: float) -> list[float]:
    """A quantile and its limits multiplied by a factor."""
    return [factor * value for value in quantile(getattr(came, quantity), level, came.source)]


def _named(name: str, values: list[float]) -> Row:
    return {f"{name}{end}": value for end, value in zip(ENDS, values, strict=True)}
