"""Results come into their folder whole or not at all, and nothing that is another's goes.

Everything is first written to a folder within .recon. Then the manifest says what is coming, the files are moved, and
the manifest says that they are there. A run that is killed in between is completed by the next one.
"""

from __future__ import annotations

import contextlib
import logging
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from recon.scene import InputError, ReconError, ReconstructionError
from recon.system import manifest
from recon.system.manifest import WORK, Manifest
from recon.system.whole_files import disk_is_full

log = logging.getLogger("recon")
STAGING = "writing"  # in WORK


@contextlib.contextmanager
def replacing(out: Path) -> Iterator[Path]:
    """A fresh folder whose content becomes the results in `out` when the block succeeds; it vanishes in any case.

    Own files of an earlier run are replaced, or removed when they are not written again; a file that is in the way and
    is not this command's, or was changed since, is kept in `out`/kept-N. Raises InputError, or ReconstructionError when
    the disk is full; the earlier results are then as they were.
    """
    staging = out / WORK / STAGING
    try:
        complete(out)
        staging.mkdir(parents=True)
        yield staging
        names = [str(p.relative_to(staging)) for p in sorted(staging.rglob("*")) if p.is_file()]
        coming = {name: _stored(staging / name) for name in names}
        manifest.write(out, Manifest(manifest.read(out).files, coming))
        complete(out)
    except OSError as error:
        raise unwritable(error, out) from error
    finally:
        if manifest.read(out).coming is None:
            shutil.rmtree(staging, ignore_errors=True)


class DiskFull(ReconstructionError):
    """Writing failed for lack of space."""


def unwritable(error: Exception, out: Path) -> ReconError:
    """What to tell the user when writing failed."""
    if disk_is_full(error, out):
        return DiskFull(f"the disk is full ({error}); free some space and run again: earlier results are as they were")
    return InputError(f"the results cannot be written to {out} ({error}); choose another folder with --out")


def complete(out: Path) -> None:
    """Move what is coming to its place and sweep the staging folder; without anything coming only the latter."""
    known = manifest.read(out)
    staging = out / WORK / STAGING
    if known.coming is not None:
        shelf = _Shelf(out)
        for folder in sorted({(out / name).parent for name in known.coming}):
            shelf.make(folder)  # first, because only this needs space
        for name in known.coming:
            if (staging / name).exists():
                if not known.unchanged(out, name):
                    shelf.keep(name)
                (staging / name).replace(out / name)
        for name in known.files.keys() - known.coming.keys():
            if known.unchanged(out, name):
                (out / name).unlink()
            shelf.keep(name)
            _prune((out / name).parent, out)
        manifest.write(out, Manifest(known.coming))
    shutil.rmtree(staging, ignore_errors=True)


class _Shelf:
    """Takes what is not this command's out of the way, into a folder kept-N that is made when it is needed."""

    def __init__(self, out: Path) -> None:
        self.out = out
        number = next(n for n in range(1, 10**6) if not os.path.lexists(out / f"kept-{n}"))
        self.folder = out / f"kept-{number}"

    def keep(self, name: str) -> None:
        """Move `name`, a path relative to the results folder, if there is anything."""
        if not os.path.lexists(self.out / name):
            return
        (self.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (self.out / name).rename(self.folder / name)
        log.warning(
            "%s was put there or changed by someone else; it is kept as %s", self.out / name, self.folder / name
        )

    def make(self, folder: Path) -> None:
        """Make a folder of results and those above it, in place of files and links of that name."""
        for place in reversed([p for p in (folder, *folder.parents) if self.out in p.parents]):
            if not manifest.is_folder(place):
                self.keep(str(place.relative_to(self.out)))
                place.mkdir()


def _prune(folder: Path, out: Path) -> None:
    """Remove a folder of results, and those above it in `out`, when a removed file leaves it empty."""
    with contextlib.suppress(OSError):  # it holds something
        while folder != out:
            folder.rmdir()
            folder = folder.parent


def _stored(path: Path) -> str:
    """The hash of a file that is safely on the disk; raises OSError when there is no room for it."""
    with path.open("rb") as file:
        os.fsync(file.fileno())  # some file systems find out only here that they are full
    return manifest.file_hash(path)
