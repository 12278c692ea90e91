"""Names of the user's files: shown on one line whatever is in them, and made into new names that never clash."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

LONGEST = 180  # bytes of a name made here: file systems take 255, and endings are still to come


def shown(text: str) -> str:
    """The text in characters that every file and terminal takes: what is no text or ends a line becomes \\xE9."""
    return "".join(c if c.isprintable() else _escaped(c) for c in text)


def _escaped(character: str) -> str:
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:  # a byte of a file name that is not UTF-8
        return f"\\x{code - 0xDC00:02x}"
    return character.encode("unicode_escape").decode()


def all_shown(content: Any) -> Any:
    """What JSON is made of, with all its texts as `shown`."""
    if isinstance(content, str):
        return shown(content)
    if isinstance(content, dict):
        return {shown(k): all_shown(v) for k, v in content.items()}
    return [all_shown(v) for v in content] if isinstance(content, list | tuple) else content


def plain(name: str) -> str:
    """The name with letters, digits, dots, dashes and underscores alone, as other programs' text formats want it."""
    return re.sub(r"[^\w.\-]+", "_", name)


def unique(wanted: Iterable[str], taken: Iterable[str] = ()) -> tuple[str, ...]:
    """The wanted file names in their order, numbered before the ending where they clash and shortened where too long.

    Names that differ in capitals alone clash as well, since many file systems do not tell them apart.
    """
    used = {name.casefold() for name in taken}
    out: list[str] = []
    for name in map(_short, wanted):
        path, number, free = Path(name), 1, name
        while free.casefold() in used:
            number += 1
            free = f"{path.stem}-{number}{path.suffix}"
        used.add(free.casefold())
        out.append(free)
    return tuple(out)


def _short(name: str) -> str:
    """The name itself, or its beginning with a digest of the whole and its ending."""
    raw, ending = name.encode(errors="surrogateescape"), Path(name).suffix
    if len(raw) <= LONGEST:
        return name
    ending = ending if len(ending) <= 8 else ""
    head = raw[: LONGEST - 24].decode(errors="ignore")
    return f"{head}-{hashlib.sha256(raw).hexdigest()[:12]}{ending}"
