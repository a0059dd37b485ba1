# SPDX-License-Identifier: BSD-3-Clause
"""Display of a stored result, without a live run."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from rockfall.app.edited.document import Document, Site
from rockfall.app.edited.features import LAYERS
from rockfall.app.edited.forms import Form, layer_forms, settings_forms
from rockfall.app.edited.opening import line_features
from rockfall.app.line_table import LineTable
from rockfall.app.messages import Message, binary_message, text_message
from rockfall.app.pictures import (
    MAX_SOURCES,
    Ground,
    View,
    batch_message,
    masses,
    sampled_rows,
    trajectory_message,
)
from rockfall.app.progress import Send
from rockfall.app.sections import section_message
from rockfall.app.study_messages import net_message
from rockfall.app.surroundings import Offer, stands_of
from rockfall.case import case_of, given_groups
from rockfall.io.rasters.grid import Grid
from rockfall.language import LANGUAGES
from rockfall.plots.extent import cell_of, reached
from rockfall.plots.terrain import terrain_of
from rockfall.result.samples import simulated
from rockfall.result.trajectories import trajectories
from rockfall.result.variables import EXCEEDED, MAP
from rockfall.scene.frames import GROUPS


class Exhibit:
    """A read-only result shown on the page."""

    language = LANGUAGES[0]
    revision = 0
    scenarios = 0  # a stored result has none to run
    offer: Offer | None = None

    def __init__(self, result: xr.Dataset, file: Path | None, send: Send | None = None) -> None:
        self.result, self.case, self._send = result, case_of(result), send
        self.view = View(next(iter(self.maps), ""))
        self._terrain = _terrain(result, file)
        self._ground = Ground(*self._terrain)
        forms = settings_forms(None), layer_forms(self.case, False, None)
        settings_form, layer_form = (
            {name: _fixed(form) for name, form in group.items()} for group in forms
        )
        settings, document = given_groups(self.case), Document()
        layers = {
            name: [*line_features(name, self.case, layer_form[name])]
            if name in GROUPS else []
            for name in LAYERS
        }  # fmt: skip
        self.document = Document(settings, document.layers | layers)
        self.site = Site(
            file or Path(self.case.name), self.case.name, self._ground.full, settings_form,
            layer_form, opened=settings, mode="result",
        )  # fmt: skip

    @property
    def maps(self) -> list[str]:
        """Names of the maps that the page can show."""
        return [name for name in MAP if name in self.result and name not in EXCEEDED]

    def start(self) -> None:
        """Send the initial messages for the view."""
        for kind, message in self.messages():
            self._tell(kind, message)

    def close(self) -> None:
        """Do nothing, because no run is in progress."""

    def look(self, view: View) -> None:
        """Set the view, and send the messages that depend on its changes."""
        before, self.view = self.view, view
        if view.section != before.section:
            self._tell("section", self._section())
        if view.net != before.net:
            self._tell("net", net_message(self.result, view.net, self.language, revision=0))
        if (view.map, view.trajectories) != (before.map, before.trajectories):
            self._show()

    def _show(self) -> None:
        for kind, message in self._pictures():
            self._tell(kind, message)

    def speak(self, language: str) -> None:
        """Set the language and resend all texts."""
        if language != self.language:
            self.language = language
            self._show()

    def _tell(self, kind: str, message: Message) -> None:
        assert self._send is not None
        self._send(kind, message)

    def messages(self) -> Iterator[tuple[str, Message]]:
        """Messages sent after the welcome, with their kinds."""
        yield "terrain", self._ground.message()
        yield "background", self._background()
        yield "state", text_message("state", revision=0, errors=[], warnings=[])
        yield from self._pictures()

    def _pictures(self) -> Iterator[tuple[str, Message]]:
        """Messages that depend on the selected map, lines and section."""
        result, attrs, view = self.result, self.result.attrs, self.view
        progress: dict[str, Any] = {
            "revision": 0, "boulders": simulated(result), "running": False, "seconds_left": None,
            "total": int(attrs["boulders_requested"]), "complete": bool(attrs["complete"]),
            "seconds": float(attrs["wall_seconds"]),
        }  # fmt: skip
        table = LineTable(result)
        yield (
            "batch",
            batch_message(
                result, self.case, view.map, self._ground, self.language,
                lines=table.entries(table.names), **progress,
            ),
        )  # fmt: skip
        shown = trajectories(result, view.trajectories) if view.trajectories else []
        mass = masses(result, [trajectory.boulder for trajectory in shown], self.case)
        message = trajectory_message(shown, mass, self._ground, revision=0, append=False)
        yield "trajectories", message

    def _section(self) -> bytes:
        return section_message(self.result, self.view.section, self._terrain, revision=0)

    def _background(self) -> bytes:
        """Message with the start points of boulders, and the forest stands."""
        places = np.column_stack([self.result[f"start_{axis}"].values for axis in "xy"])
        places = np.unique(places, axis=0)
        arrays = {"sources": sampled_rows(MAX_SOURCES, *places.T)}
        stands = stands_of(self.case, self.site.grid)
        return binary_message(
            "background", arrays, zones=[], sources=len(places), trees=0, stands=stands
        )


def _fixed(form: Form) -> Form:
    return {name: field._replace(read_only=True) for name, field in form.items()}


def _terrain(result: xr.Dataset, file: Path | None) -> tuple[np.ndarray, Grid]:
    """Terrain of a result; if its file is missing, the area of the boulders without elevations."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the page reports the missing relief
        terrain = terrain_of(result, beside=None if file is None else file.parent)
    if terrain is not None:
        return terrain
    west, east, south, north = reached(result)
    cell = max(cell_of(result), max(east - west, north - south) / 100)
    nx, ny = (max(2, int(np.ceil(side / cell))) for side in (east - west, north - south))
    return np.full((ny, nx), np.nan, "f4"), Grid(west, north, cell, nx, ny)
