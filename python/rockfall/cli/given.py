# SPDX-License-Identifier: BSD-3-Clause
"""Case and scene from the arguments of a command."""

import argparse
from collections.abc import Iterable
from typing import Any

from rockfall.analysis.objects.at_risk import AtRisk
from rockfall.case import Case, read_case
from rockfall.case.variants import chosen_variant
from rockfall.cli.messages import warn
from rockfall.scene.read import read_scene
from rockfall.scene.rules.plausible import implausible
from rockfall.scene.scene import Scene
from rockfall.simulation.memory import machine_memory, read_memory


def given_options(arguments: argparse.Namespace, keys: Iterable[str]) -> dict[str, Any]:
    """Options with these names that have a value."""
    given = {key: getattr(arguments, key) for key in keys}
    return {key: value for key, value in given.items() if value is not None}


def at_risk(arguments: argparse.Namespace) -> AtRisk:
    """Layers of objects at risk, from the arguments."""
    return AtRisk(*(getattr(arguments, name) for name in AtRisk._fields))


def memory_of(arguments: argparse.Namespace) -> float:
    """Memory for a run [bytes]: `--memory`, or the machine's memory."""
    return machine_memory() if arguments.memory is None else read_memory(arguments.memory)


def given_case(arguments: argparse.Namespace) -> Case:
    """Case from a file, or its variant selected by `--variant`."""
    return chosen_variant(read_case(arguments.case), arguments.variant)


def stem_of(arguments: argparse.Namespace) -> str:
    """Stem for output names: stem of the case file, and the variant."""
    stem, variant = arguments.case.stem, arguments.variant
    return f"{stem}_{variant}" if variant else str(stem)


def overridden(arguments: argparse.Namespace) -> Case:
    """Case, or its variant selected by `--variant`, with values replaced by the command line."""
    return with_overrides(given_case(arguments), arguments)


def with_overrides(case: Case, arguments: argparse.Namespace) -> Case:
    """Case with values replaced by the command line."""
    given = given_options(arguments, ("boulders", "boulders_total", "seed", "threads"))
    for key, other in (("boulders", "boulders_total"), ("boulders_total", "boulders")):
        if key in given:
            given.setdefault(other, None)
    return case.replace(case=given) if given else case


def scene_of(case: Case, arguments: argparse.Namespace) -> Scene:
    """Read the scene of a case, and print warnings about doubtful inputs."""
    scene = read_scene(case, memory=memory_of(arguments))
    _warn_of(scene)
    return scene


def warn_of_inputs(case: Case) -> None:
    """Print warnings about doubtful inputs of a case before a study."""
    _warn_of(read_scene(case, memory=machine_memory()))


def _warn_of(scene: Scene) -> None:
    for line in implausible(scene):
        warn(line)
