# SPDX-License-Identifier: BSD-3-Clause
"""Impact sets: file text for the kernel, the numbers in it, and covariance roots."""

import hashlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.case.text import kernel_text
from rockfall.errors import check_kernel
from rockfall.io.files import check_text_file
from rockfall.kernel_rules import kernel_numbers

ANY_SPEED = _core.constant("any_speed")  # [m/s] upper limit of a set that states no range


class Coefficients(NamedTuple):
    """Numbers of the five impact sets, as in the kernel's coefficients_t."""

    mean: np.ndarray  # (9, 5)
    covariance: np.ndarray  # (9, 9, 5)
    incidence: np.ndarray  # (8, 5): angles between the classes of `lateral` [degree]
    lateral: np.ndarray  # (13, 9, 5): quantiles of the lateral deviation [degree]
    speed_range: np.ndarray  # (2, 5): incident speeds of the fitted impacts [m/s]
    angle_range: np.ndarray  # (2, 5): their incidence angles, from the surface [degree]


class SetFile(NamedTuple):
    """A file of impact sets, and the draw to use from it."""

    text: bytes
    name: str  # used in messages
    draw: int = 0  # 1-based; 0: the file must have exactly one draw

    @property
    def checksum(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.text).hexdigest()

    def read(self, turning: str) -> tuple[Coefficients, int]:
        """Return the numbers of the sets, including those that a turning rule requires, and the
        number of draws in the file. Raises a RockfallError with file, group and key."""
        *values, ranges, draws, code, message = _core.read_sets(
            *kernel_text(self.text, self.name), turning, self.draw
        )
        check_kernel(code, message)
        return Coefficients(*values, *np.moveaxis(ranges, -1, 0)), draws


def open_sets(path: Path) -> SetFile:
    """Read the text of a file of impact sets, without checking it. Raises a RockfallError if the
    file is not regular or too large."""
    check_text_file(path)
    return SetFile(path.read_bytes(), str(path))


def draws_in(path: Path, turning: str) -> list[SetFile]:
    """Draws of a set file (one or more), all checked for the numbers that a turning rule needs."""
    first = open_sets(path)._replace(draw=1)
    _, number = first.read(turning)
    draws = [first._replace(draw=draw) for draw in range(1, number + 1)]
    for drawn in draws[1:]:
        drawn.read(turning)
    return draws


def covariance_root(covariance: np.ndarray, name: str = "covariance") -> np.ndarray:
    """Root L (n, n) of a covariance C (n, n) in the unit of C: C = L L^T, by the kernel's rule
    (theory, chapter 5). Raises a RockfallError that starts with `name` if C is not a covariance."""
    root, code, message = _core.covariance_root(name, covariance)
    check_kernel(code, message)
    return root


def set_weights(ratio: float, between: bool) -> np.ndarray:
    """Weights (5,) of the impact sets for a ratio R_b/R_m."""
    return _core.weights_of_sets(ratio, between)


def size_weights() -> np.ndarray:
    """Probabilities (3,) of the obstacle sizes in method A."""
    return kernel_numbers("size_weights")
