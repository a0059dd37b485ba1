# SPDX-License-Identifier: BSD-3-Clause
"""Results made once per session, by the first worker that needs them."""

import contextlib
import pickle
import shutil
from pathlib import Path


class Gallery:
    """Folders with files that must not be changed: a test that changes files uses a copy."""

    def __init__(self, root):
        self.root = root
        root.mkdir(exist_ok=True)

    def folder(self, name, make):
        """Folder in which `make(folder)` has written its files."""
        place, made = self.root / name, self.root / f"{name}.pickle"
        with _locked(self.root / f"{name}.lock"):
            if not made.exists():
                shutil.rmtree(place, ignore_errors=True)  # left by a worker that failed
                place.mkdir()
                value = make(place)
                for path in place.rglob("*"):
                    if path.is_file():
                        path.chmod(0o444)
                made.write_bytes(pickle.dumps(value))
        return place

    def copy(self, name, make, target):
        """Copy the folder to `target`, where files may be changed; return `target`."""
        source = self.folder(name, make)
        shutil.copytree(source, target, copy_function=shutil.copyfile, dirs_exist_ok=True)
        return Path(target)

    def value(self, name, make):
        """Copy of what `make(folder)` returned."""
        self.folder(name, make)
        return pickle.loads((self.root / f"{name}.pickle").read_bytes())


@contextlib.contextmanager
def _locked(path):
    """Hold a lock until the block or the process ends; no lock on Windows, where tests have one
    worker."""
    with open(path, "w") as file:
        with contextlib.suppress(ImportError):
            import fcntl

            fcntl.flock(file, fcntl.LOCK_EX)
        yield
