"""Runs cases through the real commands, each in a child forked from a process that has loaded every library."""

from __future__ import annotations

import encodings
import hashlib
import importlib
import os
import pkgutil
import re
import resource
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recon.system import process
from tests.bad_inputs import cases as making
from tests.bad_inputs.cases import Case

MOST_MEMORY = 4 << 30  # bytes of resident memory
MOST_SECONDS = 60  # of computing
HANGS = 240  # seconds that go by: it waits for something that never comes
NOBODY = 65534
_SCRATCH = ("tmp", "nnproc-recon-", "one-image-", "masks-")  # how names of scratch files begin; Blender has its own
RESULTS = ("report.html", "report.json", "params.json", "mesh.glb", "mesh.obj", "model.blend", "contact_sheet.png")
_NOISE = re.compile(r"Warning:|^libpng|^\[(WARN|ERROR|Open3D)|OpenCV|^Corrupt|^TIFF|^Exception ", re.MULTILINE)


@dataclass(frozen=True)
class Outcome:
    """What a case came to; `wrong` is empty when all is well."""

    case: Case
    code: int
    seconds: float
    memory: int  # bytes
    said: str
    wrong: tuple[str, ...]


def load_everything(whole: bool) -> None:
    """What a command loads, before anything is forked. Without `whole` the searches for the shape are left out."""
    for found in pkgutil.iter_modules(encodings.__path__):  # a child without rights cannot load them itself
        with suppress(ImportError):  # of other systems
            importlib.import_module(f"encodings.{found.name}")

    import bpy  # noqa: F401

    for name in (
        "run_recon",
        "recon.evaluate.axes",
        "recon.evaluate.__main__",
        "recon.cameras.poses",
        "recon.pipelines.mask_set",
    ):
        importlib.import_module(name)
    for name in (
        "recon.pipelines.shape",
        "recon.pipelines.image",
        "recon.pipelines.photos",
        "open3d",
        "pillow_heif",
        "pycolmap",
    ):
        importlib.import_module(name)
    if whole:
        return
    from recon.cameras import poses
    from recon.fitting import shape_fit, view_starts
    from recon.pipelines import image
    from recon.scene import ReconstructionError

    def left_out(*args: object, **options: object) -> None:
        raise ReconstructionError("all was read, and the search is left out")

    for module, name in ((view_starts, "run"), (image, "search"), (poses, "run"), (shape_fit, "run")):
        setattr(module, name, left_out)


def run(cases: list[Case], good: Path, scratch: Path, seed: int = 0) -> Iterator[Outcome]:
    """The outcome of every case, one after the other; `good` holds the good inputs, `scratch` one folder a case."""
    for i, case in enumerate(cases):
        yield _outcome(case, good / case.base, scratch / f"{i:04d}", seed)


def _outcome(case: Case, base: Path, folder: Path, seed: int) -> Outcome:
    making.copy(base, folder)
    number = int.from_bytes(hashlib.sha256(case.name.encode("utf-8", "replace")).digest()[:4], "big")
    case.prepare(folder, np.random.default_rng([seed, number]))
    said = folder.with_suffix(".said")
    before = _seen(folder)
    pid = os.fork()
    if pid == 0:
        _child(case, folder, said)
    code, seconds, memory = _waited(pid)
    text = said.read_bytes().decode("utf-8", "replace")
    wrong = [*_words_wrong(code, text), *_files_wrong(code, folder, before)]
    wrong += [f"{memory / (1 << 30):.1f} GB of memory"] if memory > MOST_MEMORY else []
    wrong += [f"{seconds:.0f} s"] if seconds > MOST_SECONDS else []
    return Outcome(case, code, seconds, memory, text, tuple(wrong))


def _child(case: Case, folder: Path, said: Path) -> None:
    """Never returns."""
    code = 1
    try:
        os.setsid()
        words = os.open(said, os.O_WRONLY | os.O_CREAT, 0o666)
        for stream in (1, 2):
            os.dup2(words, stream)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.chdir(folder)
        scratch = folder.with_suffix(".tmp")
        scratch.mkdir()
        scratch.chmod(0o777)
        os.environ["TMPDIR"] = os.environ["HOME"] = tempfile.tempdir = str(scratch)
        resource.setrlimit(resource.RLIMIT_DATA, (2 * MOST_MEMORY, 2 * MOST_MEMORY))  # for the machine's sake
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        if case.name.endswith("unreadable") and os.getuid() == 0:  # the superuser reads everything
            os.setgid(NOBODY)
            os.setuid(NOBODY)
        sys.argv = [case.command, *case.words]
        main = importlib.import_module(case.command).main
        code = process.run(lambda: main(list(case.words)))
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _waited(pid: int) -> tuple[int, float, int]:
    """Exit code (negative: the signal), seconds of computing and bytes of memory of a child and its own."""
    started = time.monotonic()
    while True:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            code = os.waitstatus_to_exitcode(status)
            return code, used.ru_utime + used.ru_stime, used.ru_maxrss << 10
        if time.monotonic() - started > HANGS:
            os.killpg(pid, signal.SIGKILL)
        time.sleep(0.02)


def _words_wrong(code: int, text: str) -> Iterator[str]:
    if code not in (0, 2, 3):
        yield f"exit code {code}"
    if "Traceback" in text:
        yield "traceback"
    lines = text.strip().splitlines()
    errors = [line for line in lines if line.startswith("error: ")]
    if len(errors) != (code != 0) or errors != lines[-1:] * len(errors):
        yield f"{len(errors)} error lines"
    if any("failed at the stage" in line for line in errors):
        yield "the net"
    if _NOISE.search(text):
        yield "noise"


def _seen(folder: Path) -> dict[str, tuple[int, int, int]]:
    """What lies in a folder."""
    return {
        str(p.relative_to(folder)): (s.st_mode, s.st_size, s.st_mtime_ns * (not p.is_dir()))
        for p in folder.rglob("*")
        for s in [p.lstat()]
    }


def _files_wrong(code: int, folder: Path, before: dict[str, tuple[int, int, int]]) -> Iterator[str]:
    after = _seen(folder)
    if changed := [name for name, was in before.items() if after.get(name) != was]:
        yield f"{changed[0]!r} changed"
    if code and (found := [name for name in after.keys() - before.keys() if Path(name).name in RESULTS]):
        yield f"{found[0]!r} half-written"
    left = [p.name for p in folder.with_suffix(".tmp").glob("*") if p.name.startswith(_SCRATCH)]
    if left:
        yield f"{left[0]!r} left among scratch files"
