"""Every case: an input, what is wrong with it, and the command's words; a seed chooses among them."""

from __future__ import annotations

import os
import shutil
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from datasets.sweethome3d import PROPERTIES
from tests.bad_inputs import huge
from tests.bad_inputs.damage import BYTES, SPECIAL, TEXT, Damage
from tests.bad_inputs.good import RUN, Good

Prepare = Callable[[Path, np.random.Generator], None]  # given the folder of the case


@dataclass(frozen=True)
class Case:
    """`base` is the good input that is copied, `prepare` spoils it, `words` are the command's."""

    name: str
    base: str
    words: tuple[str, ...]
    prepare: Prepare
    command: str = RUN


def chosen(goods: list[Good], count: int, seed: int) -> list[Case]:
    """The first `count` cases of an order in which those of every group are spread evenly."""
    rng = np.random.default_rng(seed)
    groups = [(1.0, [*_damaged(good)]) for good in goods]
    groups += [
        (0.5, [*_huge(goods)]),
        (1.0, [*_catalogues(goods)]),
        (2.0, [*_named(goods)]),
        (3.0, [*_options()]),
        (0.5, [*_folders()]),
    ]
    placed = []
    for rarity, group in groups:
        order, first = rng.permutation(len(group)), rng.random()
        placed += [(rarity * (first + i) / len(group), group[k]) for i, k in enumerate(order)]
    return [case for _, case in sorted(placed, key=lambda pair: pair[0])[:count]]


def _on(target: str, damage: Damage) -> Prepare:
    return lambda folder, rng: damage(folder / target, rng)


def _damaged(good: Good) -> Iterator[Case]:
    """All kinds of damage to each file of a good input."""
    kinds = {**BYTES, **SPECIAL, **(TEXT if good.text else {})}
    for target in good.targets:
        for name, damage in kinds.items():
            yield Case(f"{good.name}: {target}: {name}", good.name, good.words, _on(target, damage), good.command)


def _huge(goods: list[Good]) -> Iterator[Case]:
    """Headers that claim much, wherever such a file is taken."""
    places = [("photos-png", "photos/p0.png"), ("image-and-mask", "m.png"), ("mask", "m.png"), ("rgba-image", "a.png")]
    places += [("transforms", "masks/p0.png"), ("mask-folder", "masks/m1.png"), ("transforms", "photos/p1.png")]
    by_name = {good.name: good for good in goods}
    for base, target in places:
        for name, make in huge.PICTURES.items():
            yield Case(f"{base}: {target}: {name}", base, by_name[base].words, _written(target, make))
    for name, make in huge.SHAPES.items():
        yield Case(name, "class-file", ("huge.bin",), _written("huge.bin", make))
        for kind in ("cloud", "voxels", "mesh"):
            yield Case(f"{name} as {kind}", "class-file", ("huge.bin", "--input", kind), _written("huge.bin", make))
    for base, target in (("transforms", "transforms.json"), ("pix3d", "pix3d.json")):
        yield Case(f"{base}: wide", base, by_name[base].words, _written(target, huge.wide_json))
        yield Case(f"{base}: deep", base, by_name[base].words, _written(target, huge.deep_json))
    for good in (g for g in goods if g.name == "catalogue"):
        bomb = _written("a.sh3f", huge.catalogue_bomb)
        yield Case("catalogue: bomb", "catalogue", good.words, bomb, good.command)


def _catalogues(goods: list[Good]) -> Iterator[Case]:
    """The text within a catalogue."""
    for good in (g for g in goods if g.name == "catalogue"):
        for member in (PROPERTIES, "a/chair.obj"):
            for name, damage in {**TEXT, **BYTES}.items():
                prepare = _within("a.sh3f", member, damage)
                yield Case(f"catalogue: {member}: {name}", good.name, good.words, prepare, good.command)


def _within(target: str, member: str, damage: Damage) -> Prepare:
    """Damage to one file of a zip archive."""

    def prepare(folder: Path, rng: np.random.Generator) -> None:
        with zipfile.ZipFile(folder / target) as archive:
            files = {name: archive.read(name) for name in archive.namelist()}
        loose = folder.with_suffix(".member")
        loose.write_bytes(files[member])
        damage(loose, rng)
        (folder / target).write_bytes(huge.zipped({**files, member: loose.read_bytes()}))
        loose.unlink()

    return prepare


def _written(target: str, make: Callable[[], bytes]) -> Prepare:
    def prepare(folder: Path, rng: np.random.Generator) -> None:
        (folder / target).write_bytes(make())

    return prepare


def _named(goods: list[Good]) -> Iterator[Case]:
    """Names: too long, not UTF-8, with line ends, endings of other formats."""
    long, odd, lines = "n" * 240, os.fsdecode(b"caf\xe9\xff"), "two\nlines"
    for good in goods:
        target = Path(good.targets[0])
        for name in (long + target.suffix, odd + target.suffix, lines + target.suffix, "photo.jpg", "mesh.obj", "no"):
            words = tuple(w.replace(good.targets[0], str(target.with_name(name))) for w in good.words)
            yield Case(f"{good.name}: called {name[:20]!r}", good.name, words, _moved(target, name), good.command)
    for name in ("n" * 300, "n" * 255, "a/" * 3000, "\udcff", "no\nfile", "-", "~", "*", "$(touch x)", "/", ".", ".."):
        yield Case(f"INPUT {name[:20]!r}", "mask", (f"./{name}" if name == "-" else name,), _as_it_is)
        for flag in ("--out", "--masks", "--mask", "--cameras", "--pix3d", "--class"):
            yield Case(f"{flag} {name[:20]!r}", "mask", ("m.png", f"{flag}={name}"), _as_it_is)


def _moved(target: Path, name: str) -> Prepare:
    return lambda folder, rng: (folder / target).rename(folder / target.with_name(name)) and None


def _as_it_is(folder: Path, rng: np.random.Generator) -> None:
    """Nothing is wrong with the file."""


def _options() -> Iterator[Case]:
    """Options with values of all kinds, with an input that takes them."""
    odd = ("", " ", "nan", "inf", "-inf", "-1", "0", "1e308", "1e-308", "9" * 400, "abc", "1,2", "1,2,3,4", "None")
    odd += (
        "0x10",
        "\uff11\uff12",
        "-5,-5,10,10",
        "nan,nan,nan,nan",
        "1e308,1e308,1e308,1e308",
        "0,0,0,0",
        ",,,",
        "🪑",
        "a\tb",
    )
    takes = {
        "mask": ("--height", "--seed", "--intrinsics", "--focal-mm", "--class", "--input", "--out", "--from", "--up"),
        "image-and-mask": ("--box", "--mask", "--pix3d", "--camera-off"),
        "video-mp4": ("--frames", "--seed", "--masks", "--cameras", "--from"),
        "mesh-obj": ("--up", "--front", "--height", "--seed", "--class", "--cameras", "--masks", "--frames"),
    }
    source = {"mask": "m.png", "image-and-mask": "a.jpg", "video-mp4": "v.mp4", "mesh-obj": "a.obj"}
    for base, flags in takes.items():
        for flag in flags:
            for value in odd:
                yield Case(f"{base} {flag} {value[:20]!r}", base, (source[base], f"{flag}={value}"), _as_it_is)
    for words in ((), ("--nothing",), ("a.obj", "b.obj"), ("a.obj", "--seed"), ("",), ("a.obj", "--height", "--force")):
        yield Case(f"words {words}", "mesh-obj", words, _as_it_is)
    for kind in ("photos", "video", "cameras", "image", "masks", "mesh", "cloud", "splat", "voxels"):
        for base, file in (*source.items(), ("mask-folder", "masks"), ("cloud-npz", "a.npz"), ("transforms", ".")):
            yield Case(f"{base} --input {kind}", base, (file, "--input", kind), _as_it_is)


def _folders() -> Iterator[Case]:
    """INPUT and --out that are no ordinary folders and files."""
    for name, damage in SPECIAL.items():
        yield Case(f"INPUT: {name}", "mask", ("m.png",), _on("m.png", damage))
        yield Case(f"--out: {name}", "mask", ("m.png", "--out", "old"), _out_is(damage))
    yield Case("an empty folder", "mask", ("empty",), lambda folder, rng: (folder / "empty").mkdir())
    yield Case("a folder of folders", "mask", ("a",), lambda folder, rng: (folder / "a/b/c").mkdir(parents=True))
    yield Case("masks: an empty folder", "transforms", ("photos", "--masks", "e"), lambda f, rng: (f / "e").mkdir())
    yield Case("out below a file", "mask", ("m.png", "--out", "m.png/out"), _as_it_is)
    yield Case("out is INPUT", "mask", ("m.png", "--out", "m.png"), _as_it_is)
    yield Case("a folder called a.jpg", "mask", ("a.jpg",), lambda folder, rng: (folder / "a.jpg").mkdir())
    yield Case("a huge file beside photos", "photos-jpg", ("photos",), _sparse("photos/movie.mov"))
    yield Case("a huge photo", "photos-jpg", ("photos",), _sparse("photos/p9.jpg"))
    yield Case("a huge mesh", "mask", ("a.obj",), _sparse("a.obj"))
    yield Case("a huge cloud", "mask", ("a.xyz",), _sparse("a.xyz"))
    yield Case("many files", "photos-jpg", ("photos",), _many)
    yield Case("mac's files", "transforms", ("photos", "--masks", "masks", "--cameras", "transforms.json"), _of_macs)


def _out_is(damage: Damage) -> Prepare:
    def prepare(folder: Path, rng: np.random.Generator) -> None:
        (folder / "old").write_text("x")
        damage(folder / "old", rng)

    return prepare


def _sparse(name: str) -> Prepare:
    """A file of 6 GB that takes no room."""

    def prepare(folder: Path, rng: np.random.Generator) -> None:
        with (folder / name).open("wb") as file:
            file.write(b"1 2 3\n" * 10)
            file.truncate(6 << 30)

    return prepare


def _many(folder: Path, rng: np.random.Generator) -> None:
    for i in range(30_000):
        (folder / "photos" / f"{i}.txt").touch()


def _of_macs(folder: Path, rng: np.random.Generator) -> None:
    for i in range(3):
        (folder / f"masks/._p{i}.png").write_bytes(b"\0\5\26\7Mac OS X")
        (folder / f"photos/._p{i}.png").write_bytes(b"\0\5\26\7Mac OS X")


def copy(base: Path, folder: Path) -> None:
    """The good input, in a folder where everybody may write."""
    shutil.copytree(base, folder)
    for path in (folder, *folder.rglob("*")):
        path.chmod(0o777 if path.is_dir() else 0o666)
