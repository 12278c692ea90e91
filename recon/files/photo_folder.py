"""Which files of a folder are read as photos, and which are left and why."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from recon.files.photo import ENDINGS, looks_like_photo
from recon.files.raw_photo import is_raw
from recon.scene import InputError
from recon.system.folders import entries, is_file
from recon.system.manifest import is_own_picture

_MASK_NAME = re.compile(r"^masks?[._\- ]+(?=.)|(?<=.)[._\- ]+masks?$", re.IGNORECASE)


@dataclass(frozen=True)
class Chosen:
    """Files in natural order (photo2 before photo10), and what is left: (name, reason), by reason."""

    files: list[Path]
    left: tuple[tuple[str, str], ...] = ()

    def photos(self) -> list[Path]:
        """The files that are photos by their names."""
        return [f for f in self.files if looks_like_photo(f)]

    def said(self) -> str:
        """What is not used, in words, with a leading blank; "" when everything is."""
        reasons: dict[str, list[str]] = {}
        for name, reason in self.left:
            reasons.setdefault(reason, []).append(name)
        if others := [f.name for f in self.files if not looks_like_photo(f)]:
            reasons["no photos by their names"] = others
        parts = [f"{len(n)} {why} ({n[0]}{', ...' if len(n) > 1 else ''})" for why, n in reasons.items()]
        return f" (not used: {'; '.join(parts)})" if parts else ""


def choose(source: Path) -> Chosen:
    """The files of a folder (not of its subfolders), or the one file given. Raises InputError."""
    if is_file(source):
        return Chosen([source])
    if not source.exists():
        raise InputError(f"the folder {source} does not exist; give the folder that holds the photos")
    try:
        found = [p for p in entries(source) if not is_own_picture(p)]
    except OSError as error:
        raise InputError(f"the folder {source} cannot be read: {error.strerror or error}") from error
    files = sorted((p for p in found if is_file(p)), key=_natural)
    if not files:
        folders = sorted(p.name for p in found if p.is_dir())
        hint = f"; it holds folders, give one of them: {', '.join(folders[:5])}" if folders else ""
        raise InputError(f"the folder {source} is empty{hint}")
    odd = [(p.name, "no ordinary files") for p in found if p.suffix.lower() in ENDINGS and not is_file(p)]
    developed = {p.stem.lower() for p in files if p.suffix.lower() in ENDINGS}
    raw = [p for p in files if is_raw(p) and p.stem.lower() in developed]
    masks = [p for p in files if p not in raw and _is_mask_of(p, developed)]
    left = [*odd, *((p.name, "raw, beside the same photo developed") for p in raw)]
    left += [(p.name, "masks by their names, which --masks wants") for p in masks]
    return Chosen([p for p in files if p not in raw and p not in masks], tuple(left))


def _is_mask_of(path: Path, stems: set[str]) -> bool:
    """Whether a picture is called like another one with "mask" before or after the name."""
    plain = _MASK_NAME.sub("", path.stem).lower()
    return path.suffix.lower() in ENDINGS and plain != path.stem.lower() and bool({plain, Path(plain).stem} & stems)


def _natural(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key: runs of digits compare as numbers; the name itself decides between 1.jpg and 01.jpg."""
    parts = re.findall(r"[0-9]+|[^0-9]+", path.name.lower())
    return [(0, int(p), "") if p[0] in "0123456789" else (1, 0, p) for p in parts], path.name
