"""params.json read back: the class, its values, and the real size. docs/params.schema.json says what it may hold."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from procmodels.export import Asset
from procmodels.model import Model
from procmodels.model_file import ModelError
from procmodels.registry import load
from procmodels.space import ParameterError, Params

LARGEST = 10_000_000  # bytes; a result's has some thousand


class ParamsError(ValueError):
    """A file of parameters, or what is asked of it, cannot be used; the message says why and what to do."""

    exit_code = 2


@dataclass(frozen=True)
class Described:
    """What a params.json describes.

    height                metres, None where the real size is not known
    world_from_canonical  (4, 4) float, None where the file has none
    warning               what the user should know, or ""
    """

    model: Model
    params: Params
    height: float | None = None
    world_from_canonical: np.ndarray | None = None
    warning: str = ""


def read(path: Path, model_name: str | None = None) -> Described:
    """The shape that a file describes; `model_name` instead of the file's class.

    Raises ParamsError, and ModelError when the class cannot be loaded.
    """
    content = _content(path)
    if not isinstance(content.get("values"), dict):
        raise ParamsError(
            f'{path} has no "values"; it must hold {{"class": NAME, "values": {{PARAMETER: VALUE, ...}}}}'
        )
    name = model_name or content.get("class")
    if not isinstance(name, str):
        raise ParamsError(f'{path} does not say of which "class" it is; add it, or give --class')
    if model_name is None and name.endswith(".py"):
        raise ParamsError(f"{path} names the file {name} as its class; a file is run only when --class names it")
    try:
        model = load(name)
    except ModelError as error:
        raise ModelError(f"{path}: {error}; --class names another" if model_name is None else str(error)) from error
    try:
        params = model.space.validate(content["values"])
    except ParameterError as error:
        raise ParamsError(f"{path}: {error}") from error
    told = content.get("space_hash")
    warning = f"{path} was written by another version of the class {name}: the shape may differ a little"
    return Described(
        model,
        params,
        _height(path, content),
        _matrix(path, content),
        "" if told in (None, model.space.hash) else warning,
    )


def asset_of(found: Described, height: float | None = None) -> Asset:
    """The shape as files have it; `height` in metres instead of the file's."""
    shape, height = found.model.build(found.params), height or found.height
    metres = None if height is None else height / float(np.ptp(shape.bounds(), axis=0)[2])
    lengths = {} if metres is None else found.model.lengths(found.params, metres)
    return Asset(
        shape, found.model.space, found.params, metres, found.world_from_canonical, found.model.live_object, lengths
    )


def _content(path: Path) -> dict[str, Any]:
    try:
        if path.is_dir() or path.stat().st_size > LARGEST:
            raise ParamsError(f"{path} is no params.json: {'a folder' if path.is_dir() else 'it is far too large'}")
        content = json.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        raise ParamsError(f"{path} cannot be read ({error.strerror or error})") from error
    except (ValueError, RecursionError) as error:
        raise ParamsError(f"{path} is not JSON ({error})") from error
    if not isinstance(content, dict):
        raise ParamsError(f"{path} is no params.json: it must hold an object")
    return content


def _height(path: Path, content: dict[str, Any]) -> float | None:
    """The object keeps its height where values were changed: what they measure is mostly told in shares of it."""
    value = content.get("height_metres")
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < 1e4:
        raise ParamsError(f'{path}: "height_metres" is {value!r}; it is a length in metres, or null')
    return float(value)


def _matrix(path: Path, content: dict[str, Any]) -> np.ndarray | None:
    value = content.get("world_from_canonical")
    if value is None:
        return None
    try:
        matrix = np.array(value, float)
    except (TypeError, ValueError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not math.isfinite(matrix.sum()):
        raise ParamsError(f'{path}: "world_from_canonical" is no 4 x 4 matrix of numbers')
    return matrix
