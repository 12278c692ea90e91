"""Whether the parts of a shape hold together: real contact between closed surfaces, not between boxes round them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import open3d as o3d

from procmodels.shape import Part


class Solid:
    """A closed part that answers how far points are from it, 0 within."""

    def __init__(self, part: Part) -> None:
        self.part = part
        self.low, self.high = part.vertices.min(0), part.vertices.max(0)
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            o3d.core.Tensor(np.ascontiguousarray(part.vertices, np.float32)),
            o3d.core.Tensor(part.triangles().astype(np.uint32)),
        )

    def depth(self, points: np.ndarray) -> np.ndarray:
        """(n,) signed distances: negative within."""
        tensor = o3d.core.Tensor(np.ascontiguousarray(points, np.float32))
        return self._scene.compute_signed_distance(tensor, nthreads=1).numpy()

    def samples(self) -> np.ndarray:
        """(n, 3) vertices, and places along the edges of its faces."""
        v = self.part.vertices
        edges = np.array([(f[i - 1], f[i]) for f in self.part.faces for i in range(len(f))])
        a, b = v[edges[:, 0]], v[edges[:, 1]]
        return np.concatenate([v, *(a + s * (b - a) for s in (0.25, 0.5, 0.75))])


def touch(a: Solid, b: Solid, slack: float = 2e-3) -> bool:
    """Whether two parts are nearer than `slack` (canonical units) or share space."""
    if (a.low > b.high + slack).any() or (b.low > a.high + slack).any():
        return False
    return bool(b.depth(a.samples()).min() < slack or a.depth(b.samples()).min() < slack)


def floating(parts: Sequence[Part], slack: float = 2e-3) -> list[str]:
    """Names of the parts that are not reached from the first over touching parts."""
    solids = [Solid(p) for p in parts]
    left, todo = set(range(1, len(solids))), [0]
    while todo:
        here = solids[todo.pop()]
        near = {i for i in left if touch(here, solids[i], slack)}
        left -= near
        todo += near
    return [parts[i].name for i in sorted(left)]


def all_touch(parts: Sequence[Part], slack: float = 2e-3) -> bool:
    """Whether every part is reached from the first over touching parts."""
    return not floating(parts, slack)
