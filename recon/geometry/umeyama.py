"""The similarity between two sets of matching points."""

from __future__ import annotations

import numpy as np


def similarity_between(source: np.ndarray, target: np.ndarray) -> np.ndarray:
    """(4, 4) similarity target_from_source that maps points (n, 3) best onto points (n, 3) (Umeyama 1991)."""
    mean_s, mean_t = source.mean(0), target.mean(0)
    s, t = source - mean_s, target - mean_t
    u, d, vt = np.linalg.svd(t.T @ s / len(s))
    sign = np.array([1, 1, np.sign(np.linalg.det(u) * np.linalg.det(vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = (d * sign).sum() / s.var(0).sum()
    out = np.eye(4)
    out[:3, :3] = scale * rotation
    out[:3, 3] = mean_t - scale * rotation @ mean_s
    return out
