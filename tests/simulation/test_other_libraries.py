# SPDX-License-Identifier: BSD-3-Clause
"""Other libraries that have started OpenMP threads in the process: results are bit-identical, with
the number of threads of the case."""

import importlib.util
import os
import subprocess
import sys

import pytest

#: Code run before rockfall is loaded: it computes on its own threads.
FIRST = {
    "torch": "import torch; torch.set_num_threads(2); torch.ones(500, 500) @ torch.ones(500, 500)",
    "sklearn": """
import numpy
from sklearn.cluster import KMeans
KMeans(3, n_init=2).fit(numpy.random.default_rng(1).random((20_000, 3)))
""",
    "numba": """
import numba, numpy
numba.config.THREADING_LAYER = "omp"
@numba.njit(parallel=True)
def total(x):
    found = 0.0
    for k in numba.prange(x.size):
        found += x[k]
    return found
total(numpy.ones(1_000_000))
assert numba.threading_layer() == "omp"
""",
    "mkl": """
import ctypes, glob, mkl, sys
rt = ctypes.CDLL(glob.glob(sys.prefix + "/lib/libmkl_rt.so*")[0])
n, one, zero = 500, ctypes.c_double(1), ctypes.c_double(0)
a, c = (ctypes.c_double * (n * n))(*[1.0] * (n * n)), (ctypes.c_double * (n * n))()
rt.cblas_dgemm(101, 111, 111, n, n, n, one, a, n, a, n, zero, c, n)
assert c[0] == n and "libiomp5" in open("/proc/self/maps").read()
""",
}
RUN = """
import hashlib, rockfall
from pathlib import Path
case = rockfall.read_case("case.nml").replace(case={"threads": 2})
result, digest = rockfall.run(case), hashlib.sha256()
for name in sorted(map(str, result.variables)):
    values = result[name].values
    digest.update(str(values.tolist()).encode() if values.dtype == "O" else values.tobytes())
print(digest.hexdigest(), result.attrs["threads"])
"""


def outcome(first, folder):
    """Hash of all variables of a run, and its number of threads, in a process that first executes
    the code `first`."""
    env = os.environ | {"OMP_NUM_THREADS": "2"}
    command = [sys.executable, "-c", first + RUN]
    done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@pytest.mark.all
@pytest.mark.parametrize("library", FIRST)
def test_bits_and_threads_next_to_another_openmp(library, few_boulders):
    if not importlib.util.find_spec(library):
        pytest.skip(f"{library} is not installed")
    digest, threads = outcome("", few_boulders.parent)
    assert threads == "2"
    assert outcome(FIRST[library], few_boulders.parent) == [digest, threads]
