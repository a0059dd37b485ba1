# SPDX-License-Identifier: BSD-3-Clause
"""No computing code uses the vector mathematics of the C library, which gfortran -O3 links by
default. It has errors of up to 2.5 units in the last place, and results that depend on the position
in an array."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import rockfall._core

VECTOR_SYMBOL = re.compile(rb"_ZGV[a-z][NM]\w+|libmvec\.so")  # present even in a stripped file


def vector_symbols(path):
    return sorted({*VECTOR_SYMBOL.findall(Path(path).read_bytes())})


@pytest.mark.parametrize("binary", ["kernel", "laboratory", "program"])
def test_no_vector_mathematics_is_linked(binary):
    if binary == "program":
        path = shutil.which("rockfall-batch")
    elif binary == "laboratory":
        path = pytest.importorskip("rockfall_lab._lab").__file__
    else:
        path = rockfall._core.__file__
    if path is None:
        pytest.skip("rockfall-batch is not built")
    assert vector_symbols(path) == []


@pytest.mark.parametrize("function", ["exp(x)", "x**1.7d0", "log(x)", "sin(x)", "cos(x)"])
def test_it_would_be_seen(function, tmp_path):
    if not ((compiler := shutil.which("gfortran")) and shutil.which("nm")):
        pytest.skip("gfortran or nm is not installed")
    loop = f"real(8) :: x(1000)\ncall random_number(x)\nx = {function}\nprint *, sum(x)\nend\n"
    (tmp_path / "loop.f90").write_text(loop)
    made = [compiler, "-O3", "loop.f90", "-o", "loop"]
    subprocess.run(made, cwd=tmp_path, check=True)
    listed = subprocess.run(["nm", "-D", "loop"], cwd=tmp_path, capture_output=True, text=True)
    if "_ZGV" not in listed.stdout:
        pytest.skip("this gfortran takes no vector mathematics by itself")
    symbols = vector_symbols(tmp_path / "loop")
    assert any(symbol.startswith(b"_ZGV") for symbol in symbols) and b"libmvec.so" in symbols
