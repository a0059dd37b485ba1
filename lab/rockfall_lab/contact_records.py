# SPDX-License-Identifier: BSD-3-Clause
"""Records of contacts of thrown bodies (blocks on a ground, or boulders on rocks): a dataset over
`contact`, and its file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rockfall.errors import RockfallError
from rockfall.io.atomic import atomic_write
from rockfall.io.netcdf import write_compressed
from rockfall.version import __version__
from rockfall_lab._lab import lab_f2py as _lab
from rockfall_lab.case import names
from rockfall_lab.spheres.experiment import load_measured

if TYPE_CHECKING:
    import xarray as xr

ENTRIES = "flight", "rolling"
EXITS = "flies", "rolls_on", "stops"
ATTRIBUTES = (
    "title", "lab_case", "version", "ground", "shape", "radius", "yield_pressure", "rest_angle",
)  # fmt: skip

UNITS = dict.fromkeys(("slope", "heading", "incidence", "lateral"), "degree")
UNITS |= {"speed": "m s-1", "duration": "s"}
TYPES = {
    "sequence": "i4",
    "order": "i1",
    "block": "i2",
    "layer": "i4",
    "ratio": "f8",
    "entry": "i1",
    "exit": "i1",
}
MEANING = {
    "sequence": "number of the throw",
    "order": "place of the contact in its throw",
    "block": "number of the block",
    "layer": "number of the layer of rocks",
    "ratio": "R_b/R_m",
    "entry": "how the contact begins: at a touch, or where a long contact was cut",
    "exit": "how it ends: the block flies, rolls on (the contact was cut), or stops",
    "slope": "of the laboratory's mean plane",
    "downhill": "from the throw to the beginning, along the fall line, over R_b",
    "heading": "of V_t before, from the fall line, left > 0",
    "speed": "|V_in|, in the plane of V_t and V_n, of the centre of mass",
    "incidence": "angle of V_in from the mean plane, 90 = at right angles",
    "spin": "W/|V_in|, W = R_b omega about the axis in the plane across V_t, > 0 forward",
    "s": "rho_b V_n**2/(2 p_y)",
    "vt_out": "V_t/|V_in| without gravity's work along the slope, < 0 thrown back",
    "vn_out": "V_n/|V_in|, away from the mean plane",
    "w_out": "W/|V_in|, about the axis across the V_t that the block has then, > 0 forward",
    "lateral": "turn of V_t from the heading before, left > 0",
    "duration": "from the first touch to the last, or to the cut",
    "advance": "displacement along the heading before, over R_b",
    "rise": "displacement of the centre away from the mean plane, over R_b",
    "height": "of the centre above the mean plane at the first touch, over R_b",
    "energy_out": "kinetic energy with all of the spin, after / before; nothing taken out",
}
OF_THE_LABORATORY = "block", "layer", "ratio"  # columns that only one of the laboratories has


def contact_columns(
    rows: np.ndarray, counts: np.ndarray, n_contacts: np.ndarray, number: np.ndarray, body: str
) -> dict[str, np.ndarray]:
    """Columns of contacts, throw by throw, from the kernel's `rows` (fields, contacts, throws),
    counts and throw `number` (throws,); `body` is the name of the first count."""
    throw, order = np.nonzero(np.arange(rows.shape[1])[None, :] < n_contacts[:, None])
    counted = body, *names("contact_counts")[1:]
    return {
        "sequence": number[throw],
        "order": order + 1,
        **{name: counts[k][order, throw] for k, name in enumerate(counted)},
        **{name: rows[k][order, throw] for k, name in enumerate(names("contact"))},
    }


def contact_dataset(
    columns: dict[str, np.ndarray], radius: float, gravity: float, attributes: dict[str, Any]
) -> xr.Dataset:
    """Dataset of contacts with attributes; all share R_b [m] and gravity [m/s2]."""
    import xarray as xr

    data: dict[str, tuple] = {}
    for name, values in columns.items():
        attrs: dict[str, Any] = {"units": UNITS.get(name, "1"), "long_name": MEANING[name]}
        data[name] = ("contact", values.astype(TYPES.get(name, "f4")), attrs)
    for name, meanings in ("entry", ENTRIES), ("exit", EXITS):
        flags = {"flag_values": np.arange(len(meanings), dtype="i1")}
        data[name][2].update(flags | {"flag_meanings": " ".join(meanings)})
    attributes = {"version": __version__, "radius": radius, "gravity": gravity} | attributes
    attributes["cut_time"] = float(_lab.cut_time(radius, gravity))
    return xr.Dataset(data, attrs=attributes)


def save_contacts(data: xr.Dataset, path: str | Path) -> None:
    """Write contacts as netCDF."""
    with atomic_write(path) as part:
        write_compressed(data, part, 4)


def open_contacts(path: str | Path) -> xr.Dataset:
    """Read contacts from a file written by `save_contacts`; raises a RockfallError for other
    files."""
    data = load_measured(path, "contacts")
    if not ({*MEANING} - {*OF_THE_LABORATORY} <= set(data) and {*ATTRIBUTES} <= set(data.attrs)):
        raise RockfallError(f"{path}: is not a file of contacts of the laboratory")
    return data
