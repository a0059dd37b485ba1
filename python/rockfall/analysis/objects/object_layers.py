# SPDX-License-Identifier: BSD-3-Clause
"""Layers of objects at risk as files or frames, with unique object names."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from rockfall.errors import RockfallError
from rockfall.io.vectors.layers import layer_names
from rockfall.scene.frames import is_frame
from rockfall.scene.lines import numbered

FRAME = "objects"  # name for the GeoDataFrame of a single layer


class Source(NamedTuple):
    """A layer as given: a path or a GeoDataFrame, and the layer name if the file has several
    layers."""

    given: Any
    layer: str | None


class File(NamedTuple):
    """A layer in a file, and its label in tables."""

    path: str | Path
    layer: str | None
    label: str


def given_layers(given: Any, layers: str | Sequence[str] | None) -> list[Source]:
    """Pair files with layer names: any number of names for a single file, or a name for each of
    several files. Refuses other numbers of names, and a repeated layer, whose objects would count
    twice."""
    several = [] if given is None else list(given) if isinstance(given, list | tuple) else [given]
    names = [layers] if isinstance(layers, str) else list(layers or [])
    if names and len(several) != 1 and len(names) != len(several):
        raise RockfallError(
            f"--objects-layer: {len(names)} names for {len(several)} files: must be names of "
            "layers in one file, or one for each file"
        )
    if names and len(several) == 1:
        several *= len(names)
    sources = [Source(layer, names[k] if names else None) for k, layer in enumerate(several)]
    for k, source in enumerate(sources):
        if any(_is_same(source, other) for other in sources[:k]):
            text = f", layer {source.layer}" if source.layer else ""
            raise RockfallError(f"{_path(source)}{text}: is given twice as a layer of objects")
    return sources


def _path(source: Source) -> str:
    return "a GeoDataFrame" if is_frame(source.given) else str(source.given)


def _is_same(source: Source, other: Source) -> bool:
    if is_frame(source.given) or is_frame(other.given):
        return source.given is other.given
    paths = (Path(each.given).resolve() for each in (source, other))
    return len({*paths}) == 1 and source.layer == other.layer


def frames_of(sources: Sequence[Source]) -> dict[str, Any]:
    """GeoDataFrames among the layers, by name."""
    alone = len(sources) == 1
    return {
        FRAME if alone else f"{FRAME}[{k}]": source.given
        for k, source in enumerate(sources)
        if is_frame(source.given)
    }


def files_of(sources: Sequence[Source], frames: dict[str, Path]) -> list[File]:
    """Layers as files with distinct labels; `frames` are the files of the frames, in order."""
    of_frame = iter(frames.items())
    files = []
    for source in sources:
        name, path = next(of_frame) if is_frame(source.given) else (None, source.given)
        files.append(File(path, source.layer, source.layer or name or only_layer(path)))
    labels = numbered([file.label for file in files])
    return [file._replace(label=label) for file, label in zip(files, labels, strict=True)]


def only_layer(path: str | Path) -> str:
    """Layer name in a file with a single layer; otherwise the name of the file without its
    ending."""
    names = layer_names(path)
    return names[0] if len(names) == 1 else Path(path).stem


def distinct_names(names: Sequence[Sequence[str]], labels: Sequence[str]) -> list[list[str]]:
    """Names of the objects in each layer. Names that occur in several layers include the layer
    label; names that are still repeated include a number."""
    numbers: dict[str, set[int]] = {}
    for k, own in enumerate(names):
        for name in own:
            numbers.setdefault(name, set()).add(k)
    distinct = numbered([
        f"{label}: {name}" if len(numbers[name]) > 1 else name
        for own, label in zip(names, labels, strict=True)
        for name in own
    ])  # fmt: skip
    return [list(islice(distinct, len(own))) for own in names]
