# SPDX-License-Identifier: BSD-3-Clause
"""Results that are made once a session, by the worker that needs one first, and read by all."""

import contextlib
import pickle
import shutil
from pathlib import Path


class Gallery:
    """Folders whose files are not written again: a test that changes some has a copy."""

    def __init__(self, root):
        self.root = root
        root.mkdir(exist_ok=True)

    def folder(self, name, make):
        """The folder in which `make(folder)` has made its files."""
        place, made = self.root / name, self.root / f"{name}.pickle"
        with _locked(self.root / f"{name}.lock"):
            if not made.exists():
                shutil.rmtree(place, ignore_errors=True)  # of a worker that failed
                place.mkdir()
                value = make(place)
                for path in place.rglob("*"):
                    if path.is_file():
                        path.chmod(0o444)
                made.write_bytes(pickle.dumps(value))
        return place

    def copy(self, name, make, target):
        """A copy of the folder, with files that may be changed."""
        source = self.folder(name, make)
        shutil.copytree(source, target, copy_function=shutil.copyfile, dirs_exist_ok=True)
        return Path(target)

    def value(self, name, make):
        """What `make(folder)` returned; each caller has a copy."""
        self.folder(name, make)
        return pickle.loads((self.root / f"{name}.pickle").read_bytes())


@contextlib.contextmanager
def _locked(path):
    """Until the block or the process ends; not on Windows, where the tests have one worker."""
    with open(path, "w") as file:
        with contextlib.suppress(ImportError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
