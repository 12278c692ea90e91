"""Is the stated confidence right? Own held-out shapes with masks as wrong as real ones, half to fit, half to check.

    python -m recon.evaluate calibration --class chair --class table --shapes 40

Each half of the shapes sets the numbers that the other half is checked with, for the plot: of the answers given with
90 %, how many are right? All of them together set recon/calibration.json.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import minimize
from tqdm import tqdm

from procmodels import Model, load
from procmodels.space import Params
from recon.evaluate.chair import from_silhouettes
from recon.evaluate.data.held_out import cases
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.evaluate.robust import grown
from recon.evaluate.rows import Row
from recon.fitting import refine
from recon.fitting.uncertainty import FILE, Calibration, chance, quantile
from recon.scene import ReconError, Silhouettes
from recon.system.whole_files import write_picture

LEVELS = (0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
TAILS = (1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 30.0)


@dataclass(frozen=True)
class CalibrationOptions:
    """What is measured."""

    classes: tuple[str, ...] = ("bed", "chair", "shelf", "table")
    shapes: int = 40  # of each class, off the grid
    views: tuple[int, int] = (4, 16)  # fewest and most masks of a set
    growth: int = 2  # px, masks are wrong by up to so many
    work: Path = Path(".cache/evaluate")


@dataclass(frozen=True)
class Sample:
    """One result: (error, spread) of every scalar in shares of its range, (right, gap) of every discrete parameter."""

    scalars: tuple[tuple[float, float], ...]
    choices: tuple[tuple[bool, float], ...]


def samples(options: CalibrationOptions) -> list[Sample]:
    """Results for held-out shapes of all classes, by turns; each is kept in the work folder."""
    out = []
    folder = options.work / "calibration"
    folder.mkdir(parents=True, exist_ok=True)
    for name in options.classes:
        model = load(name)
        for i, case in enumerate(tqdm(cases(model, "off", options.shapes), desc=name, disable=None)):
            file = folder / f"{name.replace('/', '-')}_{model.space.hash}_{i}.json"
            if not file.is_file():
                rng = np.random.default_rng([23, i])
                cameras, place = orbit(int(rng.integers(options.views[0], options.views[1] + 1)), seed=i)
                scene = drawn_scene(case.shape, cameras, place)
                scene = replace(scene, silhouettes=worn(scene.silhouettes, rng, options.growth))
                try:
                    found = from_silhouettes(model, scene)
                except ReconError:
                    continue
                file.write_text(json.dumps(asdict(_sample(model, found, case.params))))
            values = json.loads(file.read_text())
            out.append(Sample(tuple(map(tuple, values["scalars"])), tuple(map(tuple, values["choices"]))))
    return out


def worn(masks: Silhouettes, rng: np.random.Generator, growth: int) -> Silhouettes:
    """Masks that are too wide or too narrow together, and ragged each for itself."""
    if (radius := int(rng.integers(-growth, growth + 1))) != 0:
        masks = grown(radius)(masks, rng)
    out = []
    for mask in masks.masks:
        noise = cv2.GaussianBlur(rng.normal(size=mask.shape).astype(np.float32), (0, 0), 4)
        soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 2) + 0.15 * noise / noise.std()
        out.append(soft > 0.5)
    return replace(masks, masks=tuple(out))


def _sample(model: Model, found: refine.Refined, true: Params) -> Sample:
    sure = found.certainty
    assert sure is not None
    scalars = []
    for s in model.space.scalars:
        error = s.unit_from_value(float(found.params[s.name])) - s.unit_from_value(float(true[s.name]))
        scalars.append((abs(float(error)), sure.spreads[s.name]))
    right = [(bool(found.params[n] == true[n]), gap) for n, gap in sure.gaps.items()]
    return Sample(tuple(scalars), tuple(right))


def fitted(found: list[Sample]) -> Calibration:
    """The factor, floor and tail with which intervals of all levels hold most nearly as often as they say, and the
    logistic curve of most likelihood."""
    pairs = np.array([p for s in found for p in s.scalars])
    reaches = {tail: [quantile(level, tail) for level in LEVELS] for tail in TAILS}

    def off(floor: float, spread: float, tail: float) -> float:
        wide = pairs[:, 0] / np.hypot(floor, spread * pairs[:, 1] + 1e-12)
        return sum(abs((wide <= z).mean() - level) for level, z in zip(LEVELS, reaches[tail], strict=True))

    floors, spreads = (0.0, 0.002, 0.005, 0.01, 0.015, 0.02, 0.03), np.geomspace(0.5, 200, 60)
    tried = ((f, float(b), t) for f in floors for b in spreads for t in TAILS)
    floor, spread, tail = min(tried, key=lambda v: off(*v))
    # A right and a wrong answer at a hundredth of the unexplained are thrown in: choices that were all right would
    # have the curve say 100 % however small the gap.
    choices = [c for s in found for c in s.choices] + [(True, 0.01), (False, 0.01)]
    right = np.array([r for r, _ in choices], float)
    gaps = np.log(np.maximum([g for _, g in choices], 1e-4))

    def loss(x: np.ndarray) -> float:
        score = x[0] * gaps + x[1]
        # A weak prior: with few wrong answers the curve would become a step.
        return float((np.logaddexp(0, score) - right * score).sum() + 0.05 * (x[0] - 1) ** 2)

    slope, offset = minimize(loss, np.array([1.0, 3.0]), bounds=[(0.05, 5), (-5, 20)]).x
    return Calibration(spread, floor, float(slope), float(offset), tail)


def coverage(found: list[Sample], use: Calibration) -> dict[float, float]:
    """Stated level -> share of the intervals that hold the truth."""
    pairs = np.array([p for s in found for p in s.scalars])
    wide = np.hypot(use.floor, use.spread * pairs[:, 1])
    return {level: float((pairs[:, 0] <= quantile(level, use.tail) * wide).mean()) for level in LEVELS}


def reliability(found: list[Sample], use: Calibration, bins: int = 5) -> list[tuple[float, float, int]]:
    """(mean stated chance, share right, count) of the choices, in bins of equal counts."""
    pairs = sorted((chance(g, use), r) for s in found for r, g in s.choices)
    return [
        (float(np.mean([c for c, _ in part])), float(np.mean([r for _, r in part])), len(part))
        for part in (pairs[i * len(pairs) // bins : (i + 1) * len(pairs) // bins] for i in range(bins))
        if part
    ]


def run(options: CalibrationOptions, picture: Path, write: Path | None = FILE) -> list[Row]:
    """Measure, write the constants (unless `write` is None) and the plot; rows of shapes that did not set them."""
    found = samples(options)
    halves = found[::2], found[1::2]
    covered, curve = checked(halves)
    if write is not None:
        values = {**asdict(fitted(found)), "classes": list(options.classes), "shapes": len(found)}
        write.write_text(json.dumps(values, indent=1) + "\n")
    write_picture(picture, plot(covered, curve))
    worst = max(abs(level - share) for level, share in covered.items())
    stated = sum(c * n for c, _, n in curve) / sum(n for *_, n in curve)
    right = sum(r * n for _, r, n in curve) / sum(n for *_, n in curve)
    return [
        Row(f"{len(found)} shapes: intervals stated with 90 % that hold the truth, share", covered[0.9]),
        Row("largest error of stated coverage, 50 to 95 %", worst, "<= 0.05"),
        Row("choices: mean stated chance less share right", abs(stated - right), "<= 0.05"),
        Row("choices: share right", right),
    ]


def checked(halves: tuple[list[Sample], list[Sample]]) -> tuple[dict[float, float], list[tuple[float, float, int]]]:
    """Coverage and reliability of both halves, each with the numbers that the other half sets."""
    covered = {level: 0.0 for level in LEVELS}
    curve = []
    for rest, use in ((halves[0], fitted(halves[1])), (halves[1], fitted(halves[0]))):
        for level, share in coverage(rest, use).items():
            covered[level] += share * len(rest) / sum(map(len, halves))
        curve += reliability(rest, use)
    return covered, sorted(curve)


def plot(covered: dict[float, float], curve: list[tuple[float, float, int]], side: int = 460) -> np.ndarray:
    """(side, 2 side, 3) uint8 BGR: stated against measured, intervals left, choices right."""
    panels = []
    for title, points in (("intervals", list(covered.items())), ("choices", [(c, r) for c, r, _ in curve])):
        panel = np.full((side, side, 3), 250, np.uint8)
        edge, length = 56, side - 80

        def at(x: float, y: float, edge: int = edge, length: int = length) -> tuple[int, int]:
            low = 0.4
            return round(edge + length * (x - low) / (1 - low)), round(24 + length * (1 - (y - low) / (1 - low)))

        cv2.rectangle(panel, at(0.4, 1), at(1, 0.4), (120, 120, 120), 1)
        cv2.line(panel, at(0.4, 0.4), at(1, 1), (180, 180, 180), 1, cv2.LINE_AA)
        for tick in (0.4, 0.6, 0.8, 1.0):
            _write(panel, f"{tick:.1f}", (at(tick, 0.4)[0] - 10, side - 36))
            _write(panel, f"{tick:.1f}", (20, at(0.4, tick)[1] + 5))
        places = [at(max(x, 0.4), max(y, 0.4)) for x, y in points]
        cv2.polylines(panel, [np.array(places, np.int32)], False, (200, 110, 20), 2, cv2.LINE_AA)
        for place in places:
            cv2.circle(panel, place, 4, (200, 110, 20), -1, cv2.LINE_AA)
        _write(panel, f"{title}: stated (across), right (up)", (edge, side - 12))
        panels.append(panel)
    return np.hstack(panels)


def _write(panel: np.ndarray, text: str, at: tuple[int, int]) -> None:
    cv2.putText(panel, text, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (60, 60, 60), 1, cv2.LINE_AA)
