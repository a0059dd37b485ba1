# SPDX-License-Identifier: BSD-3-Clause
"""Vectorised rebound rules of the kernel, for rows (n, 3) of V_t, V_n, W [m/s]."""

from typing import TypeVar

import numpy as np

from rockfall._core import rockfall_f2py as _core

INERTIA_FACTOR = _core.constant("inertia_factor")  # I/(m R_b^2) of a sphere
MAX_DRAWS = int(_core.constant("max_draws"))  # maximum draws of a rebound; the last is then limited
MIN_NORMAL = _core.constant("min_normal")  # V_n of a limited rebound / incident speed

_Volume = TypeVar("_Volume", float, np.ndarray)


def sphere_radius(volume: _Volume) -> _Volume:
    """Radius [m] of a sphere with this volume [m3]."""
    return _core.sphere_radii(np.ravel(volume)).reshape(np.shape(volume))[()]


def energy(v: np.ndarray) -> np.ndarray:
    """Twice the kinetic energy per mass, (n,) [m2/s2]."""
    plan = np.column_stack([v[:, :2], np.zeros(len(v))])
    return _core.kinetic_energies(np.full(len(v), 2.0), plan.T, v[:, 2]) if len(v) else v[:, 0]


def kinetic_energy(mass: np.ndarray, speed: np.ndarray, spin: np.ndarray) -> np.ndarray:
    """Kinetic energy (n,) [J] from masses [kg], speeds [m/s] and W [m/s], each (n,)."""
    if not speed.size:
        return speed
    return _core.kinetic_energies(mass, np.stack([speed, 0 * speed, 0 * speed]), spin)


def ratio_class(ratio: np.ndarray) -> np.ndarray:
    """Index, 1 to 5, of the impact set nearest to each R_b/R_m, in the shape of `ratio`."""
    return _core.ratio_classes(np.ravel(ratio)).reshape(np.shape(ratio)).astype(int)


def admissible(v_in: np.ndarray, v_out: np.ndarray) -> np.ndarray:
    """Mask (n,) of rebounds that leave the surface without gaining energy (theory, chapter 5)."""
    v_in, v_out = np.broadcast_arrays(v_in, v_out)
    return _core.admissible_rebounds(v_in.T, v_out.T).astype(bool)


def limited(v_in: np.ndarray, v_out: np.ndarray) -> np.ndarray:
    """Rebounds (n, 3) made admissible: V_n at least 1 % of the incident speed, no gain of
    energy."""
    rebounds = np.array(v_out, order="C")
    _core.limit_rebounds(v_in.T, rebounds.T)
    return rebounds
