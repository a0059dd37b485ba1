# SPDX-License-Identifier: BSD-3-Clause
"""The C library gives results bit-identical to the Python package."""

import ctypes
from pathlib import Path

import numpy as np
import pytest

import rockfall
from rockfall.scene.read import read_scene

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT / "build-quick/fortran/librockfall.so"
pytestmark = pytest.mark.skipif(
    not LIBRARY.exists(), reason="build-quick has no library: meson test builds it"
)
MESSAGE, TEXT = 1024, 256


class Library:
    """Scene and run of the C library, called through ctypes."""

    def __init__(self, scene, text):
        self.calls = ctypes.CDLL(LIBRARY)
        for name in ("new_scene", "open_run", "boulders"):
            getattr(self.calls, f"rockfall_{name}").restype = ctypes.c_void_p
        grid, self.message = scene.grid, ctypes.create_string_buffer(MESSAGE)
        place = map(ctypes.c_double, (grid.west, grid.north, grid.cell))
        self.scene = ctypes.c_void_p(self.calls.rockfall_new_scene(*place, grid.nx, grid.ny))
        self.arrays = scene.kernel.arrays()
        for name, array in self.arrays.items():
            length = (ctypes.c_int64 * 3)(*[*array.shape[::-1], 1, 1, 1][:3])
            about = name.encode(), array.dtype.str[1:].encode(), length
            self.calls.rockfall_give(self.scene, *about, ctypes.c_void_p(array.ctypes.data))
        self.check(
            self.calls.rockfall_build_scene(self.scene, text.encode(), b"case", self.message)
        )
        self.run = ctypes.c_void_p()

    def check(self, code):
        assert code == 0, self.message.value

    def open_run(self, boulders, threads):
        about = ctypes.c_int64(0), ctypes.c_int64(boulders), threads
        self.calls.rockfall_open_run.restype = ctypes.c_int
        self.check(
            self.calls.rockfall_open_run(self.scene, *about, ctypes.byref(self.run), self.message)
        )

    def advance(self, n):
        self.check(self.calls.rockfall_advance(self.run, ctypes.c_int64(n), self.message))

    def results(self):
        """Arrays of the result, in their shapes, by their names in files."""
        text, length = ctypes.create_string_buffer(TEXT), (ctypes.c_int64 * 4)()
        at, k, found = ctypes.c_void_p(), 0, {}
        while self.calls.rockfall_array(self.run, k, text, length, ctypes.byref(at)):
            group, name, file_name, kind, *axes = text.value.decode().split()
            shape = tuple(length[: len(axes)])[::-1]
            if at.value and group != "work":
                size = np.dtype(kind).itemsize * int(np.prod(shape))
                found[file_name] = np.frombuffer(ctypes.string_at(at, size), kind).reshape(shape)
            k += 1
        return found

    def close(self):
        self.calls.rockfall_close_run(self.run)
        self.calls.rockfall_close_scene(self.scene)


BY_TABLE = {"impact": {"table": "talus", "ratio": None}}


@pytest.mark.parametrize(
    ("maps", "changes"), [([], BY_TABLE), (["passages", "energy_q95", "speed_mean"], {})]
)
def test_a_run_by_the_library_has_the_bits_of_a_run_by_the_package(maps, changes):
    case = rockfall.read_case(ROOT / "cases/vaujany/case.nml").replace(
        case={"boulders": 300}, output={"maps": maps or None, "trajectories": 0}, **changes
    )
    expected = rockfall.run(case)
    scene = read_scene(case)
    library = Library(scene, scene.case.text())
    library.open_run(300, threads=2)
    for n in (1, 199, 100):
        library.advance(n)
    found = library.results()
    shared = [name for name in found if name in expected]
    assert {
        "status",
        "stop_x",
        "crossing_line",
        "crossing_boulder",
        "crossing_time",
        "impacts",
    } <= {*shared}
    for name in shared:
        assert np.array_equal(found[name].T, expected[name].values, equal_nan=True) or (
            np.array_equal(found[name], expected[name].values, equal_nan=True)
        ), name
    for name in maps:
        values = np.empty(expected[name].shape, "f4")
        at = ctypes.c_void_p(values.ctypes.data)
        about = name.encode(), ctypes.c_int64(1), at
        library.check(library.calls.rockfall_map(library.run, *about, library.message))
        assert np.array_equal(values, expected[name].values.astype("f4"), equal_nan=True), name
    library.close()
