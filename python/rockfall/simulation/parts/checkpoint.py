# SPDX-License-Identifier: BSD-3-Clause
"""Checkpoints of long runs: a part file is replaced atomically, so that a killed run can resume
from the last checkpoint. A failure to write it (a full disk) does not end the run. rockfall-batch
uses the same files, and either program can resume runs of the other."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from rockfall._core import rockfall_f2py as _core
from rockfall.errors import RockfallError
from rockfall.io.output_files import check_space
from rockfall.result.dataset import put_netcdf
from rockfall.simulation.parts.part_file import CLOCKS, boulders_in, make_part, read_part
from rockfall.simulation.tally import Tally, origin_of
from rockfall.system import replace, sync

REST = _core.constant("save_rest")  # minimum pause between saves / duration of the last save


def checkpoint_of(output: Path) -> Path:
    """Checkpoint path for a run to `output`."""
    return output.with_name(f"{output.name}.checkpoint")


class Checkpoint:
    """Checkpoint of a run, in a file next to its output, updated at intervals."""

    def __init__(
        self,
        output: str | Path,
        every: float,
        say: Callable[[str], None] = lambda _: None,
        keep: bool = False,
    ) -> None:
        self.output = output = Path(output)
        self.path = checkpoint_of(output)
        self.part = output.with_name(f".{output.name}.checkpoint")  # temporary name while writing
        self.every, self.say = every, say
        self.keep = keep  # keep the file of a complete run, which a caller may continue
        self.saved = 0  # number of boulders saved
        self.next = time.monotonic() + every

    def found(self) -> int:
        """Number of boulders in the file; 0 if it does not exist. A file that is not a checkpoint
        is refused."""
        if not os.path.lexists(self.path):
            return 0
        boulders = boulders_in(self.path)
        if boulders is None:
            raise RockfallError(
                f"{self.path}: exists but is not a readable checkpoint: remove it, or choose "
                "another output"
            )
        return boulders

    def check_space(self, tally: Tally) -> None:
        """Refuse a run whose rows do not fit on the output disk."""
        if not self.keep or np.isfinite(self.every):
            check_space(self.output, tally.row_bytes)

    def restore(self, tally: Tally) -> None:
        """Resume from the file, if any. A damaged file is refused, as is one from another case,
        input, version or range of boulders."""
        if not self.found():
            return
        part = read_part(self.path)
        own = range(tally.before + 1, tally.before + tally.boulders + 1)
        theirs = range(part.first, part.last + 1)
        if what := origin_of(tally).difference(part.origin, own, theirs):
            raise RockfallError(
                f"{self.path}: belongs to a different run ({what} differs): remove it, or choose "
                "another output"
            )
        part.load(tally.run)
        tally.wall, tally.cpu = (part.clocks[clock] for clock in CLOCKS)
        tally.done = self.saved = len(theirs)
        if not tally.restore_sources():
            raise RockfallError(f"{self.path}: is damaged: tally_shared_cell")

    def look(self, tally: Tally) -> None:
        """Write the file if the interval has passed."""
        if time.monotonic() >= self.next:
            self.save(tally)

    def save(self, tally: Tally) -> None:
        """Write the completed boulders, if checkpoints are enabled and more boulders are completed
        than at the last save. After a failure, no further checkpoints are written."""
        if np.isinf(self.every) or tally.done == self.saved:
            return
        begun = time.monotonic()
        try:
            self.part.unlink(missing_ok=True)  # left by a run killed while saving
            put_netcdf(make_part(tally), self.part, self.path)
            sync(self.part)
            replace(self.part, self.path)
            sync(self.path.parent)
            self.saved = tally.done
        except (OSError, RockfallError, MemoryError) as error:
            with suppress(OSError):
                self.part.unlink()
            what = getattr(error, "strerror", None) or str(error).removeprefix(f"{self.path}: ")
            what = what or "not enough memory"
            self.say(f"{self.path}: no further checkpoints are written: {what}")
            self.every = np.inf
        finally:
            tally.run.forget_part()
        end = time.monotonic()
        self.next = end + max(self.every, REST * (end - begun))

    @contextmanager
    def named(self) -> Iterator[None]:
        """Within the block, errors raised while a result is processed mention the checkpoint file,
        if any."""
        try:
            yield
        except RockfallError as error:
            if not (boulders := self.found()):
                raise
            kept = f"{self.path} contains {boulders:,} boulders: continue with --resume"
            raise RockfallError(f"{error}. {kept}", error.code) from error

    def remove(self) -> None:
        """Remove the file, and its temporary file; for use after the result is written."""
        for path in self.path, self.part:
            with suppress(OSError):
                path.unlink()
