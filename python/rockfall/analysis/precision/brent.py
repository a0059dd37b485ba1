# SPDX-License-Identifier: BSD-3-Clause
"""Minimum and root of a function of one variable (Brent 1973, chapters 4 and 5), the same as those
of scipy.optimize, whose import takes as long as a third of a report's numbers."""

from __future__ import annotations

import math
from collections.abc import Callable

Function = Callable[[float], float]

GOLDEN = (3 - math.sqrt(5)) / 2
RELATIVE = math.sqrt(2.2e-16)  # a minimum is as flat
MAX_STEPS = 100
EPSILON = 2.0**-52


def minimum(function: Function, low: float, high: float, xatol: float) -> tuple[float, float]:
    """Place of a minimum between two ends, to within `xatol`, and its value: by parabolas through
    the three lowest points, else by golden sections."""
    best = second = third = low + GOLDEN * (high - low)
    f_best = f_second = f_third = function(best)
    step = before = 0.0  # the last, and the one before
    for _ in range(5 * MAX_STEPS):
        middle = (low + high) / 2
        least = RELATIVE * abs(best) + xatol / 3
        if abs(best - middle) <= 2 * least - (high - low) / 2:
            break
        parabolic = None
        if abs(before) > least:
            r = (best - second) * (f_best - f_third)
            q = (best - third) * (f_best - f_second)
            p = (best - third) * q - (best - second) * r
            q = 2 * (q - r)
            p, q = (-p if q > 0 else p), abs(q)
            if abs(p) < abs(q * before / 2) and q * (low - best) < p < q * (high - best):
                parabolic = p / q
        if parabolic is None:
            before = (low if best >= middle else high) - best
            step = GOLDEN * before
        else:
            before, step = step, parabolic
            x = best + step
            if min(x - low, high - x) < 2 * least:
                step = math.copysign(least, middle - best)
        x = best + math.copysign(max(abs(step), least), step)
        f = function(x)
        if f <= f_best:
            low, high = (best, high) if x >= best else (low, best)
            third, f_third, second, f_second, best, f_best = second, f_second, best, f_best, x, f
            continue
        low, high = (x, high) if x < best else (low, x)
        if f <= f_second or second == best:
            third, f_third, second, f_second = second, f_second, x, f
        elif f <= f_third or third in (best, second):
            third, f_third = x, f
    return best, f_best


def root(
    function: Function, low: float, high: float, xtol: float = 2e-12, rtol: float = 4 * EPSILON
) -> float:
    """Place between two ends, at which a function has opposite signs, where it is 0, to within
    xtol + rtol |place|: by inverse quadratic interpolation, else by bisection."""
    last, place = low, high
    f_last, f_place = function(last), function(place)
    if not f_last:
        return last
    if f_last * f_place > 0:
        raise ValueError(f"no change of sign between {low} and {high}")
    other = f_other = step = before = 0.0
    for _ in range(MAX_STEPS):
        if f_last and f_place and (f_last > 0) != (f_place > 0):
            other, f_other = last, f_last
            step = before = place - last
        if abs(f_other) < abs(f_place):
            last, place, other = place, other, place
            f_last, f_place, f_other = f_place, f_other, f_place
        least, half = (xtol + rtol * abs(place)) / 2, (other - place) / 2
        if not f_place or abs(half) < least:
            break
        step_before, before, tried = before, half, half
        if abs(step_before) > least and abs(f_place) < abs(f_last):
            if last == other:
                quick = -f_place * (place - last) / (f_place - f_last)
            else:
                to_last = (f_last - f_place) / (last - place)
                to_other = (f_other - f_place) / (other - place)
                inverse = f_other * to_other - f_last * to_last
                quick = -f_place * inverse / (to_other * to_last * (f_other - f_last))
            if 2 * abs(quick) < min(abs(step_before), 3 * abs(half) - least):
                before, tried = step, quick
        step = tried
        last, f_last = place, f_place
        place += step if abs(step) > least else math.copysign(least, half)
        f_place = function(place)
    return place
