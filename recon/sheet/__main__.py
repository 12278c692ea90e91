"""The sheet as a PDF file to print: python -m recon.sheet --paper A4 --out sheet.pdf

Exit codes: 0 done, 2 an option or the file cannot be used.
"""

from __future__ import annotations

import argparse
import io
import os
import sys
from pathlib import Path

from PIL import Image

from recon.scene import InputError
from recon.sheet.drawing import DPI, page
from recon.sheet.layout import PAPERS, Paper
from recon.system.whole_files import write_bytes


def parser() -> argparse.ArgumentParser:
    """The command line."""
    p = argparse.ArgumentParser("python -m recon.sheet", description="A sheet to print, which gives photos a size.")
    p.add_argument("--paper", default="A4", help=f"{', '.join(PAPERS)} (%(default)s); larger is read from farther off")
    p.add_argument("--count", type=int, default=1, metavar="N", help="different sheets, to lie about at once (1)")
    p.add_argument("--out", type=Path, default=Path("sheet.pdf"), help="a new PDF file (%(default)s)")
    return p


def pdf(paper: Paper, count: int) -> bytes:
    """The sheets 1 to `count` of a paper, a page each, at true size."""
    pages = [Image.fromarray(page(paper, i + 1)).convert("1") for i in range(count)]
    out = io.BytesIO()
    pages[0].save(
        out, format="PDF", resolution=DPI, save_all=True, append_images=pages[1:], title=f"{paper.name} sheet"
    )
    return out.getvalue()


def _run(args: argparse.Namespace) -> None:
    paper = {name.lower(): p for name, p in PAPERS.items()}.get(args.paper.lower())
    if paper is None:
        raise InputError(f"--paper {args.paper} is not known; {', '.join(PAPERS)} are")
    if not 1 <= args.count <= len(paper.numbers):
        raise InputError(f"--count {args.count}: there are {len(paper.numbers)} different sheets for {paper.name}")
    if os.path.lexists(args.out):
        raise InputError(f"{args.out} is there and is not replaced; choose another --out")
    if not args.out.parent.is_dir():
        raise InputError(f"the folder {args.out.parent} of --out does not exist; make it first")
    write_bytes(args.out, pdf(paper, args.count))


def main(argv: list[str] | None = None) -> int:
    """The command; returns the exit code."""
    args = parser().parse_args(argv)
    try:
        _run(args)
    except InputError as error:
        sys.stderr.write(f"error: {error}\n")
        return error.exit_code
    except OSError as error:
        sys.stderr.write(f"error: {args.out} cannot be written ({error.strerror or error})\n")
        return 2
    sys.stdout.write(f"{args.out}: print it at 100 %, and lay it on the floor beside the object\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
