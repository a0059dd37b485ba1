# SPDX-License-Identifier: BSD-3-Clause
"""Files of published field experiments and events: from a local folder, or downloaded once and
checked, with their sources, licences and checksums."""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from rockfall.errors import RockfallError, need

FOLDER = "ROCKFALL_FIELD_DATA"  # environment variable with a folder to use instead of downloads
CACHE = "rockfall"  # name of the download folder in the user's cache
#: Repository of tables derived from EnviDat data, at the commit of the checksums below.
DERIVED = "https://github.com/ofuhrer/rust_rockfall/raw/722f7c7"


class RemoteFile(NamedTuple):
    """Remote file: local name, address, and checksum as `algorithm:digest`."""

    name: str
    url: str
    checksum: str


@dataclass(frozen=True)
class Archive:
    """Files used from a published data set. `doi` identifies the data, `origin` is the source of
    the files, and `tried` is True if this program has ever read the real files."""

    title: str
    doi: str
    licence: str
    citation: str
    origin: str
    files: tuple[RemoteFile, ...]
    tried: bool = True

    @property
    def names(self) -> tuple[str, ...]:
        """Local names of the files."""
        return tuple(file.name for file in self.files)


def _tschamut(name: str, digest: str) -> RemoteFile:
    return RemoteFile(name, f"{DERIVED}/data/processed/tschamut2014/{name}", f"sha256:{digest}")


def _zenodo(name: str, digest: str) -> RemoteFile:
    return RemoteFile(name, f"doi:10.5281/zenodo.7257979/{name}", f"md5:{digest}")


ARCHIVES = {
    "tschamut2014": Archive(
        "Repetitive trajectory testing in Tschamut 2014",
        "10.16904/envidat.34",
        "ODbL, contents DbCL",
        "Volkwein, A. and Gerber, W. (2018): Repetitive trajectory testing in Tschamut 2014. "
        "EnviDat.",
        "tables and a terrain of 5 m derived in github.com/ofuhrer/rust_rockfall, commit 722f7c7",
        (
            _tschamut(
                "release_points.csv",
                "70baa2707cc3efff8e7f466fe2b9228763df8883a43b1464531143966069c203",
            ),
            _tschamut(
                "observed_deposition.csv",
                "8087131cb9b0807ca6d16ded63ed5eeffd44741928618e7ae797dd01d1bfeccb",
            ),
            _tschamut(
                "terrain.asc",
                "23fa4c3bc326987cbfa4343cbe568ace9ff1637f69e874fd2e5cfcc8b8b53620",
            ),
        ),
    ),
    "chant_sura_esurf2019": Archive(
        "Six impacts of a block of 780 kg on an alpine meadow",
        "10.5194/esurf-7-199-2019",
        "as of the article (CC BY 4.0)",
        "Caviezel, A. et al. (2019): Reconstruction of four-dimensional rockfall trajectories "
        "using remote sensing and rock-based accelerometers and gyroscopes. Earth Surf. Dynam. 7, "
        "199.",
        "a table derived in github.com/ofuhrer/rust_rockfall, commit 722f7c7",
        (
            RemoteFile(
                "impacts.csv",
                f"{DERIVED}/calibration/data/scarring_single_impact/"
                "chant_sura_esurf_2019_impacts.csv",
                "sha256:ad83c4fedffbf544d44625ed79308fa1a9a4db3f3792173a6a02362d105a0496",
            ),
        ),
    ),
    "mel_de_la_niva_2015": Archive(
        "Highly energetic rockfalls: Dataset of the 2015 event from the Mel de la Niva",
        "10.5281/zenodo.7257979",
        "CC BY 4.0",
        "Noël, F. et al. (2022): Highly energetic rockfalls: Dataset of the 2015 event from the "
        "Mel de la Niva, Switzerland. Zenodo.",
        "Zenodo; names and MD5 sums of the files as listed in github.com/ofuhrer/rust_rockfall",
        (
            _zenodo("3d_trajectories_epsg21781_lv03.zip", "dba538e90510c30eaa8cf9fcbdadad99"),
            _zenodo("gis_shapes_epsg21781_lv03.zip", "b88775690c74aff171f341a3681df4f8"),
            _zenodo("sfm_rasters_epsg21781_lv03.zip", "a17874b6c82d8739e2eda21455780515"),
        ),
        tried=False,
    ),
}


def fetch(name: str, folder: str | Path | None = None) -> dict[str, Path]:
    """Return the files of an archive by their local names.

    They are taken from `folder`, or from the folder in the environment variable
    ROCKFALL_FIELD_DATA, or from a subfolder with the archive's name. Without a folder they are
    downloaded once into the user's cache. Every file is checked against its checksum. Raises
    RockfallError for an unknown archive, and for missing or different files.
    """
    if name not in ARCHIVES:
        raise RockfallError(f"no archive {name!r}, known: {', '.join(ARCHIVES)}")
    archive = ARCHIVES[name]
    given = folder or os.environ.get(FOLDER)
    if given:
        return {file.name: _local(file, Path(given), name) for file in archive.files}
    need("downloading field data needs", "field", "pooch")
    return {file.name: _downloaded(file, archive, name) for file in archive.files}


def _local(file: RemoteFile, folder: Path, name: str) -> Path:
    """File of an archive in a folder, or in its subfolder `name`. Raises a RockfallError if the
    file is missing, unreadable or has another checksum."""
    if not folder.is_dir():
        raise RockfallError(f"{folder}: no such folder of field data")
    for path in (folder / name / file.name, folder / file.name):
        if path.is_file():
            break
    else:
        raise RockfallError(f"{folder}: has no {file.name}, nor {name}/{file.name}")
    algorithm, _, expected = file.checksum.partition(":")
    try:
        with path.open("rb") as stream:
            digest = hashlib.file_digest(stream, algorithm).hexdigest()
    except OSError as error:
        raise RockfallError(f"{path}: cannot be read: {error.strerror or error}") from None
    if digest != expected:
        raise RockfallError(
            f"{path}: {algorithm} {digest} differs from {expected} of {file.url}: download it again"
        )
    return path


def _downloaded(file: RemoteFile, archive: Archive, name: str) -> Path:
    """File in the user's cache, downloaded if missing. Raises a RockfallError if that fails."""
    import pooch

    text = f"{archive.title} (doi:{archive.doi}): {file.url}"
    try:
        path = pooch.retrieve(
            file.url, file.checksum, fname=file.name, path=pooch.os_cache(CACHE) / name
        )
    except ValueError as error:  # pooch found another checksum
        raise RockfallError(f"{text}: {error}") from None
    except OSError as error:  # no network, no such file, or no disk space
        advice = f"or give a folder with {', '.join(archive.names)} ({FOLDER}, --data)"
        raise RockfallError(f"{text}: cannot be downloaded: {error}; {advice}") from None
    return Path(path)
