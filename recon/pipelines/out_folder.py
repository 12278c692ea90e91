"""A run's claim on its results folder: what it would cost the user is refused before minutes are spent.

Results replace only what this command wrote (recon.system.manifest), never what is read, and one run at a time writes.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path

from recon.files.photo import ENDINGS
from recon.outputs import publish
from recon.scene import InputError, ReconError
from recon.system import manifest, run_lock, scratch
from recon.system.manifest import FILES, FOLDERS, WORK
from recon.system.whole_files import disk_is_full

FIRST = ("frames", "shape", "mask", "masks")  # stages, of which each pipeline begins with one
_OWN_WORK = (  # one of them marks our WORK
    *(manifest.NAME, run_lock.NAME, publish.STAGING, "frames", "given", "video"),
    *(f"{stage}.json" for stage in FIRST),
)
_NOBODYS = {"thumbs.db", "desktop.ini"}  # file browsers leave them everywhere, besides hidden files
_ELSEWHERE = "choose another folder with --out"


@contextlib.contextmanager
def claimed(out: Path, reads: Mapping[str, Path | None]) -> Iterator[Path]:
    """Check and lock `out`, sweep what killed runs left half done, and give the work folder `out`/.recon.

    reads  what the run reads, by the option's name: {"INPUT": ..., "--masks": ...}
    A folder that was not there before, and in which no stage was finished, is removed again after a ReconError.
    Raises InputError naming the files that are in the way, or who else writes there; ReconstructionError when the disk
    becomes full.
    """
    check(out, reads)
    fresh = [p for p in (out / WORK, out) if not p.exists()]
    try:
        with contextlib.ExitStack() as stack:
            try:
                (out / WORK).mkdir(parents=True, exist_ok=True)
                stack.enter_context(run_lock.held(out / WORK, out))
                _sweep(out)
            except OSError as error:
                raise publish.unwritable(error, out) from error
            stack.enter_context(_explained(out, fresh))
            yield out / WORK
    finally:
        for folder in fresh:
            with contextlib.suppress(OSError):  # it holds something
                folder.rmdir()


@contextlib.contextmanager
def _explained(out: Path, fresh: list[Path]) -> Iterator[None]:
    """Says that the disk is full, and empties a work folder that is fresh and holds no finished stage."""
    try:
        yield
    except Exception as error:
        full = not isinstance(error, InputError | publish.DiskFull) and disk_is_full(error, out)
        failed = full or isinstance(error, ReconError)
        if failed and out / WORK in fresh and not list((out / WORK).glob("*.json")):
            for entry in (out / WORK).iterdir():
                shutil.rmtree(entry, ignore_errors=True)  # which leaves the lock, a file
        if full:
            raise publish.unwritable(error, out) from error
        raise


def check(out: Path, reads: Mapping[str, Path | None]) -> None:
    """Raise InputError when results in `out` would hit the user's files; changes nothing."""
    try:
        str(out.resolve()).encode()
    except UnicodeEncodeError as error:
        raise InputError(f"the name of {out} is not UTF-8, which many readers cannot open; {_ELSEWHERE}") from error
    for option, path in reads.items():
        if path is not None and path.exists():
            _check_read(out, option, path)
    _check_work(out / WORK)
    if found := [*_in_the_way(out)]:
        more = f" and {len(found) - 1} more" if len(found) > 1 else ""
        raise InputError(
            f"{found[0]}{more} would be replaced by results, and is not known as this command's own; {_ELSEWHERE}, or "
            "move it away"
        )


def _check_read(out: Path, option: str, path: Path) -> None:
    """Raise InputError when what is read would be replaced, or the results would lie among what is read."""
    for name in (*FILES, *FOLDERS, WORK):
        if any(_same(p, out / name) for p in (path.resolve(), *path.resolve().parents)):
            raise InputError(f"{option} {path} would be replaced by results, which go to {out / name}; {_ELSEWHERE}")
    if path.is_dir() and (_same(path, out) or _among_photos(out, path)):
        raise InputError(
            f"{option} {path} is read, and the next run would take results in {out} for photos, masks or cameras; "
            f"{_ELSEWHERE}, such as {out / 'out'}"
        )


def _among_photos(out: Path, folder: Path) -> bool:
    """Whether `out` lies in a folder that is read, and holds pictures itself."""
    inside = any(_same(parent, folder) for parent in out.resolve().parents)
    pictures = [p for p in out.iterdir() if p.suffix.lower() in ENDINGS] if inside and out.is_dir() else []
    return not all(manifest.is_own_picture(p) for p in pictures)


def _same(a: Path, b: Path) -> bool:
    """Whether two paths lead to one file or folder, however they are spelt or linked."""
    return a.exists() and b.exists() and a.samefile(b)


def _check_work(work: Path) -> None:
    """Raise InputError when .recon is somebody else's."""
    if work.is_symlink() or (work.exists() and not work.is_dir()):
        raise InputError(f"{work} is a link or a file, and results of stages go there; remove it, or {_ELSEWHERE}")
    entries = sorted(p for p in work.iterdir() if p.name[0] != ".") if work.is_dir() else []
    if entries and not any(entry.name in _OWN_WORK for entry in entries):
        raise InputError(f"{work} is not this command's own (it holds {entries[0].name}); {_ELSEWHERE}")
    if linked := [entry for entry in entries if entry.is_symlink()]:
        raise InputError(f"{linked[0]} is a link, and nothing is written through links; remove it, or {_ELSEWHERE}")


def _in_the_way(out: Path) -> Iterator[Path]:
    """What lies where results go and was not written by this command."""
    known = manifest.read(out)
    for name in FILES:
        path = out / name
        if (path.exists() or path.is_symlink()) and not (manifest.is_file(path) and known.knows(name)):
            yield path
    for name in FOLDERS:
        path = out / name
        if path.is_symlink() or (path.exists() and not path.is_dir()):
            yield path
            continue
        for inside in manifest.files_below(out, name):
            nobodys = Path(inside).name.lower() in _NOBODYS or Path(inside).name.startswith(".")
            if not (known.knows(inside) or nobodys):
                yield out / inside


def _sweep(out: Path) -> None:
    """Complete or remove what runs that were killed left behind."""
    publish.complete(out)
    for folder in (out / WORK).glob(f"{scratch.PREFIX}*"):
        shutil.rmtree(folder, ignore_errors=True)
    for folder in out.glob(".writing-????????"):  # of version 0.2.0, unless it holds what that was just replacing
        if manifest.is_folder(folder) and all(p.name in (*FILES, *FOLDERS) for p in folder.iterdir()):
            shutil.rmtree(folder, ignore_errors=True)
