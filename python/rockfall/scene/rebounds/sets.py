# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets as numbers, and the resulting restitution coefficients."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from rockfall.errors import RockfallError
from rockfall.grounds.impact_sets import shipped_sets
from rockfall.io.files import read_text
from rockfall.scene.rebounds.coefficients import covariance_root, draws_in
from rockfall.scene.rebounds.kernel_rebounds import admissible

ERROR_MARK = "Covariance of the errors of the means, lower triangle by rows:"
DRAWS = 4000  # draws of the matrix A for means of R_t and R_n


@dataclass(frozen=True)
class Lateral:
    """Lateral deviation in k incidence classes: quantiles (k, 13) of its absolute value [degree],
    class limits (k - 1,) [degree], and number of impacts in each class (k,)."""

    incidence: np.ndarray
    quantiles: np.ndarray
    impacts: np.ndarray


@dataclass(frozen=True)
class Sets:
    """The five sets of a file: means (5, 9) and covariances (5, 9, 9) of a1..a9; error covariances
    of the means (5, 9, 9) and lateral deviations, if the file has them."""

    name: str
    mean: np.ndarray
    covariance: np.ndarray
    error: np.ndarray | None = None
    lateral: tuple[Lateral, ...] | None = None

    def redrawn(self, generator: np.random.Generator) -> Sets:
        """Sets with means perturbed by draws from their errors; unchanged if these are unknown."""
        if self.error is None:
            return self
        off = [
            covariance_root(error, "covariance of errors") @ generator.standard_normal(9)
            for error in self.error
        ]
        return replace(self, mean=self.mean + off)


def read_sets(source: str | Path) -> list[Sets]:
    """Draws in a set file, or in a shipped set by name: one, or several for an ensemble."""
    path = shipped_sets().get(str(source), Path(source))
    error = _errors(read_text(path), path)
    draws = [own.read("past_aspect")[0] for own in draws_in(path, "past_aspect")]  # rule unused
    return [
        Sets(
            Path(source).stem, drawn.mean.T, drawn.covariance.T, error,
            _lateral(drawn.incidence.T, drawn.lateral.T),
        )
        for drawn in draws
    ]  # fmt: skip


def _lateral(between: np.ndarray, quantiles: np.ndarray) -> tuple[Lateral, ...] | None:
    """Lateral deviations of the five sets, from the kernel's arrays (5, 8) and (5, 9, 13); None
    if a set has none."""
    if not quantiles.any(axis=(1, 2)).all():
        return None
    classes = (between < 90).sum(axis=1) + 1
    return tuple(
        Lateral(angles[: n - 1], rows[:n], np.zeros(n, int))
        for angles, rows, n in zip(between, quantiles, classes, strict=True)
    )


def _errors(text: str, path: Path) -> np.ndarray | None:
    """Error covariances of the means, (5, 9, 9), if all sets of a file have them. Raises a
    RockfallError for damaged numbers."""
    blocks = text.split(f"! {ERROR_MARK}\n")[1:]
    if len(blocks) != 5:
        return None
    matrices = np.full((5, 9, 9), np.nan)
    for block in blocks:
        lines = block.splitlines()
        ratio = re.search(r"^&impact_set ratio = ([1-5])\b", block, re.MULTILINE)
        try:
            rows = [[float(term) for term in line.lstrip("! ").split(",")] for line in lines[:9]]
            if ratio is None:
                raise ValueError("no ratio")
            matrix = matrices[int(ratio[1]) - 1]
            for k, row in enumerate(rows):
                matrix[k, : k + 1] = matrix[: k + 1, k] = row
        except (ValueError, TypeError) as error:
            raise RockfallError(f"{path}: the errors of the means cannot be read") from error
    if not np.isfinite(matrices).all():
        raise RockfallError(f"{path}: the errors of the means cannot be read")
    return matrices


@lru_cache(maxsize=1)
def _standard_draws(seed: int) -> np.ndarray:
    """Standard normal numbers (draws, 9), the same for all angles."""
    return np.random.Generator(np.random.PCG64(seed)).standard_normal((DRAWS, 9))


def restitution(
    mean: np.ndarray, covariance: np.ndarray, angle: float, seed: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """R_t and R_n (draws,) of a set at an incidence angle [degree] without spin.

    Only admissible draws count: V_n_out > 0, no gain of energy (theory, chapter 5). R_t is NaN at
    90 degrees.
    """
    draws = mean + _standard_draws(seed) @ covariance_root(covariance).T
    t, n = np.cos(np.radians(angle)), -np.sin(np.radians(angle))
    if angle == 90:
        t = 0.0
    v_in = np.array([t, n, 0.0])
    out = draws.reshape(-1, 3, 3) @ v_in
    out = out[admissible(v_in[None], out)]
    return out[:, 0] / (t or np.nan), -out[:, 1] / n
