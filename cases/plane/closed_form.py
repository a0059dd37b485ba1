"""Contacts of a boulder that bounces down the plane with a fixed matrix, in closed form."""

from typing import NamedTuple

import numpy as np

GRAVITY = 9.81
MATRIX = np.array([[0.675, 0.05, 0.1], [0.2, -0.4, -0.1], [0.3, 0.05, 0.4]])  # matrix of plane.nml


class Contacts(NamedTuple):
    """Contacts, one row each: plan distance from the first contact [m], time since the release [s],
    and velocities (V_t, V_n, W) [m/s] before and after the rebound."""

    distance: np.ndarray
    time: np.ndarray
    incoming: np.ndarray
    outgoing: np.ndarray


def contacts(number: int, gradient: float, drop: float) -> Contacts:
    """First `number` contacts after a fall from rest over `drop` [m] onto a plane slope."""
    cosine = 1 / np.hypot(1, gradient)
    sine = gradient * cosine
    fly = np.array([[1, 2 * gradient, 0], [0, -1, 0], [0, 0, 1]])  # leaving to arriving

    speed = np.sqrt(2 * GRAVITY * drop)
    incoming = [speed * np.array([sine, -cosine, 0])]
    for _ in range(number - 1):
        incoming.append(fly @ MATRIX @ incoming[-1])
    outgoing = np.array(incoming) @ MATRIX.T

    v_t, v_n, _ = outgoing[:-1].T
    flight = 2 * v_n / (GRAVITY * cosine)
    hop = (v_t * flight + GRAVITY * sine * flight**2 / 2) * cosine
    return Contacts(
        distance=np.append(0, np.cumsum(hop)),
        time=speed / GRAVITY + np.append(0, np.cumsum(flight)),
        incoming=np.array(incoming),
        outgoing=outgoing,
    )
