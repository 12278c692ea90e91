"""What is installed from a wheel: all that the packages hold, and it works without the sources."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROOMS = tuple(sorted(p.parent.name for p in ROOT.glob("*/py.typed")))
DEMO = ("datasets", "samples", "chair", "photos")


def _is_of_a_package(path):
    return "__pycache__" not in path.parts and path.is_file() and path.suffix != ".partial"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel of a copy of the sources, since building leaves traces beside them."""
    folder = tmp_path_factory.mktemp("wheel")
    for room in ROOMS:
        shutil.copytree(ROOT / room, folder / "source" / room, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder / "source")
    build = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder)]
    subprocess.run([sys.executable, *build, str(folder / "source")], check=True)
    shutil.rmtree(folder / "source")
    (made,) = folder.glob("*.whl")
    return made


@pytest.mark.slow
def test_everything_in_the_packages_is_in_the_wheel(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    ours = {str(p.relative_to(ROOT)) for room in ROOMS for p in (ROOT / room).rglob("*") if _is_of_a_package(p)}
    assert ours - names == set()
    others = {n for n in names - ours if ".dist-info/" not in n}
    assert others == set()


@pytest.mark.long
def test_the_demo_runs_from_a_wheel_alone(wheel, tmp_path):
    """Installed without the sources, in a folder of its own: the shipped photos and a class of a file."""
    site = tmp_path / "site"
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--target", str(site), str(wheel)]
    subprocess.run([sys.executable, *install], check=True)
    environment = {**os.environ, "PYTHONPATH": str(site)}
    where = [sys.executable, "-c", "import recon, procmodels; print(recon.__file__, procmodels.load('chair').weights)"]
    told = subprocess.run(where, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True).stdout
    assert all(Path(word).is_relative_to(site) and Path(word).is_file() for word in told.split())
    words = [str(site / "bin" / "nnproc-recon"), str(site.joinpath(*DEMO)), "--class", "chair", "--out", "chair"]
    run = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "chair: " in run.stdout
    assert (tmp_path / "chair" / "model.blend").is_file()
