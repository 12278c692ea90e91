"""glTF's data: the JSON, the buffers that it names, and accessors as arrays."""

from __future__ import annotations

import base64
import json
import os
import urllib.parse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from recon.scene import InputError
from recon.system import limits

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")


def json_of(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON of a .gltf or .glb file, and the latter's own buffer. Raises InputError, or ValueError for damage."""
    if path.stat().st_size > limits.TEXT:
        raise InputError(f"{path} is a glTF file of more than {limits.TEXT >> 30} GB; decimate the mesh")
    data = path.read_bytes()
    if data[:4] != b"glTF":
        return json.loads(data.decode("utf-8-sig")), b""
    version = int.from_bytes(data[4:8], "little")
    if version != 2:
        raise InputError(f"{path} is a GLB file of version {version}, only 2 is read here; export it again as glTF 2.0")
    at, content, buffer = 12, b"", b""
    while at + 8 <= len(data):
        size, kind = int.from_bytes(data[at : at + 4], "little"), data[at + 4 : at + 8]
        chunk, at = data[at + 8 : at + 8 + size], at + 8 + size
        if len(chunk) < size:
            raise ValueError("it is cut short")
        if kind == b"JSON" and not content:
            content = chunk
        elif kind == b"BIN\0" and not buffer:
            buffer = chunk
    return json.loads(content.decode("utf-8-sig")), buffer


@dataclass
class Buffers:
    """The accessors of one file. Buffers are read once, when they are first needed."""

    path: Path
    tree: dict[str, Any]
    own: bytes
    _read: dict[int, bytes] = field(default_factory=dict)

    def accessor(self, index: int) -> np.ndarray:
        """(count, width) float or int; normalised integers become 0..1 or -1..1.

        Raises InputError, and ValueError for damage.
        """
        said = self.tree["accessors"][index]
        kind, width, count = np.dtype(_TYPES[said["componentType"]]), _WIDTHS[said["type"]], int(said["count"])
        if not 0 <= count <= 3 * limits.FACES:
            raise InputError(
                f"{self.path} claims an array of {count:,} rows, more than is read here; decimate the mesh"
            )
        if "bufferView" in said:
            values = self._rows(said["bufferView"], said.get("byteOffset", 0), kind, width, count)
        elif "sparse" in said:
            values = np.zeros((count, width), kind)
        else:
            raise InputError(
                f"{self.path} has data that are packed in a way unknown here{self._packing()}; export it without"
            )
        if "sparse" in said:
            values = self._replaced(values, said["sparse"])
        if not said.get("normalized") or kind.kind == "f":
            return values
        return np.maximum(values / np.iinfo(kind).max, -1.0)

    def _packing(self) -> str:
        required = self.tree.get("extensionsRequired", [])
        return f" ({', '.join(map(str, required))})" if required else ""

    def _replaced(self, values: np.ndarray, sparse: dict[str, Any]) -> np.ndarray:
        """With some rows in place of others."""
        count, where, new = int(sparse["count"]), sparse["indices"], sparse["values"]
        kind = np.dtype(_TYPES[where["componentType"]])
        rows = self._rows(where["bufferView"], where.get("byteOffset", 0), kind, 1, count)[:, 0]
        values = values.copy()
        values[rows] = self._rows(new["bufferView"], new.get("byteOffset", 0), values.dtype, values.shape[1], count)
        return values

    def _rows(self, view: int, offset: int, kind: np.dtype, width: int, count: int) -> np.ndarray:
        data, stride = self.view(view)
        row = kind.itemsize * width
        stride = stride or row
        if count == 0:
            return np.zeros((0, width), kind)
        if offset < 0 or offset + stride * (count - 1) + row > len(data):
            raise ValueError("an array reaches beyond its buffer")
        raw = np.frombuffer(data, np.uint8)[offset : offset + stride * (count - 1) + row]
        lines = np.lib.stride_tricks.as_strided(raw, (count, row), (stride, 1))
        return np.ascontiguousarray(lines).view(kind)

    def view(self, index: int) -> tuple[bytes, int]:
        """A buffer view's bytes, and its stride (0: rows follow one another)."""
        said = self.tree["bufferViews"][index]
        packed = next((e for e in _MESHOPT if e in said.get("extensions", {})), None)
        if packed and not self._is_there(said["buffer"]):
            raise InputError(
                f"{self.path} is packed with meshopt ({packed}), which is not read here; unpack it, as with "
                "`gltfpack -noq -i in.glb -o out.glb`, or export it without compression"
            )
        start, size = int(said.get("byteOffset", 0)), int(said["byteLength"])
        data = self._buffer(said["buffer"])[start : start + size]
        if start < 0 or len(data) < size:
            raise ValueError("a buffer is shorter than the file says")
        return data, int(said.get("byteStride", 0))

    def _is_there(self, index: int) -> bool:
        """Whether a buffer is more than a place that packed data are to be unpacked into."""
        said = self.tree["buffers"][index]
        return "uri" in said or (index == 0 and bool(self.own))

    def _buffer(self, index: int) -> bytes:
        if index not in self._read:
            said = self.tree["buffers"][index]
            self._read[index] = self._linked(said["uri"]) if "uri" in said else self.own
        return self._read[index]

    def _linked(self, uri: str) -> bytes:
        """Bytes inside the JSON, or of a file in this one's folder or below. Raises InputError for any other."""
        if uri.startswith("data:"):
            head, _, body = uri.partition(",")
            return base64.b64decode(body) if head.endswith(";base64") else urllib.parse.unquote_to_bytes(body)
        folder = Path(os.path.abspath(self.path.parent))
        if "://" in uri:
            raise InputError(f"{self.path} names the address {uri}, which is not followed; put that file beside it")
        for name in (urllib.parse.unquote(uri), uri):
            file = Path(
                os.path.normpath(folder / name.replace("\\", "/"))
            )  # links that the user laid there are followed
            if not file.is_relative_to(folder):
                raise InputError(
                    f"{self.path} names {uri}, which lies outside its folder and is not followed; put it beside it"
                )
            if file.is_file():
                if file.stat().st_size > limits.UNPACKED // 2:
                    raise InputError(f"{file} is larger than {limits.UNPACKED >> 31} GB; decimate the mesh")
                return file.read_bytes()
        raise InputError(
            f"{self.path} needs {urllib.parse.unquote(uri)}, which is not beside it; give both files, or a .glb"
        )
