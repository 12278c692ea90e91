"""Versions of everything that can change a result."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

PACKAGES = (
    "nnproc-recon",
    "torch",
    "numpy",
    "scipy",
    "bpy",
    "pycolmap",
    "kornia",
    "trimesh",
    "open3d",
    "scikit-image",
    "opencv-contrib-python-headless",
)


def versions() -> dict[str, str]:
    """Package to version, "missing" where it is not installed; asked of the metadata, so nothing is imported."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    return found
