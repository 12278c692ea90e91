"""One engine: its derivatives are exact with every target and placement, and known parameters are found again."""

from __future__ import annotations

import itertools
from dataclasses import replace

import cv2
import numpy as np
import pytest

from datasets.voxels import surface_grid
from recon.evaluate.data.scenes import drawn_scene, orbit
from recon.fitting import moves, undecided
from recon.fitting.found_cameras import Cameras
from recon.fitting.gauss_newton import descended, polish
from recon.fitting.hull_target import Hull
from recon.fitting.mask_target import Level, Masks
from recon.fitting.placement import Fixed, Similarity, Standing, Upright, yaw
from recon.fitting.problem import Problem
from recon.fitting.search import Schedule, Search, solve
from recon.fitting.state import State
from recon.fitting.surface_target import Surface, VoxelGrid
from recon.geometry.object_windows import Crops, object_crops
from recon.geometry.raster import coverage, coverage_slopes
from recon.geometry.triangles import Triangles
from recon.scene import Cameras as Views
from recon.scene import Canonical, cam_from_canonical
from tests.fitting.toy_models import boards

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "round", "arms": "solid", "back": "hbar"}
NEAR = {**CHAIR, "width": 0.7, "depth": 0.53, "leg_height": 0.36}
AWAY = {**NEAR, "arms": "none", "back": "vbar"}
LEVELS = (Level(4, 1), Level(2), Level(1))
SHORT = Schedule(sweeps=2, tries=2, steps=(3, 2, 6), fronts=False)


def windows(model, params, views=8, size=112) -> tuple[Crops, Canonical]:
    """Windows on the exact masks of a shape, and where it stands."""
    cameras, place = orbit(views, seed=3)
    return object_crops(drawn_scene(model.build(params), cameras, place), size), place


def nudge(seed: int, degrees: float = 4, shift: float = 0.03, growth: float = 1.04) -> np.ndarray:
    """(4, 4) a small similarity."""
    rng = np.random.default_rng(seed)
    out = yaw(np.radians(degrees))
    out[:3, :3] *= growth
    out[:3, 3] = rng.uniform(-shift, shift, 3)
    return out


@pytest.fixture(scope="module")
def seen(chair):
    return windows(chair, CHAIR)


def before_cameras(crops: Crops, count: int = 2, **options) -> Cameras:
    """Views whose poses and focal length are unknown."""
    cameras = crops.cameras.subset(range(count))
    return Cameras(Views(cameras.names, cameras.K, np.tile(np.eye(4), (count, 1, 1)), cameras.sizes), **options)


def camera_place(placement: Cameras, crops: Crops, place: Canonical, zoom: float = 1.0) -> np.ndarray:
    count = len(placement.views)
    return placement.place(cam_from_canonical(crops.cameras.subset(range(count)), place), zoom)


# Derivatives


@pytest.fixture(scope="module")
def problems(chair, seen) -> dict[str, tuple[Problem, State]]:
    """A problem with every placement and target, and a state that is not the answer."""
    crops, place = seen
    masks = Masks.of(crops, LEVELS)
    world = place.world_from_canonical
    surface = Triangles.of(chair.build(CHAIR))
    points = surface.at(surface.places(4000))[0]
    loose = Upright([np.eye(4), yaw(np.pi)], loose=True)
    cameras = before_cameras(crops, usual_depth=(0.08, 0.2))
    two = Masks(crops.masks[:2], crops.valid[:2], LEVELS)
    standing = Standing(crops.cameras, world)
    hull = Hull(crops, crops, place, -0.5)
    out = {
        "fixed": (masks, Fixed(crops.cameras, world), np.zeros(0)),
        "standing": (masks, standing, standing.start(world)),
        "similarity": (masks, Similarity(crops.cameras), world @ nudge(0)),
        "cameras": (two, cameras, camera_place(cameras, crops, place, 1.1)),
        "mesh": (Surface(points, (300, 800), surface), loose, np.array([0.05, 0.01, 0.02, -0.01, 0.1])),
        "cloud": (Surface(points, (800,), None, 0.02, 0.15), loose, np.array([0.05, 0.01, 0.02, -0.01, 0.1])),
        "hull": (hull, standing, standing.start(world)),
    }
    made = {name: (Problem(chair, target, where), p) for name, (target, where, p) in out.items()}
    return {name: (problem, problem.state(AWAY, p)) for name, (problem, p) in made.items()}


@pytest.mark.parametrize("name", ["fixed", "standing", "similarity", "cameras"])
def test_a_state_moves_its_vertices_and_pixels_as_derivatives_say(problems, name):
    problem, state = problems[name]
    posed = problem.posed(state)
    sizes = problem.target.sizes

    def shares(at: State) -> np.ndarray:
        there = problem.posed(at)
        drawn = coverage(there.shape, there.K, there.cam_from_shape, sizes, dtype=np.float64)
        return np.concatenate([image.ravel() for image in drawn])

    velocities = problem.velocities(state, posed, problem.nearby(state))
    _, slopes = coverage_slopes(posed.shape, posed.K, posed.cam_from_shape, sizes)
    found = np.zeros((len(shares(state)), velocities.shape[-1]))
    found[slopes.pixels] = slopes.along(velocities)
    for i, step in enumerate(np.eye(len(problem.free(state)))):
        # Blender's vertices have 32 bits; a scalar's step must be larger than their grain.
        h = 3e-4 if i < len(state.units) else 1e-6
        here, ahead, behind = (shares(problem.moved(state, s * h * step)) for s in (0, 1, -1))
        expected = (ahead - behind) / (2 * h)
        if not problem.free(state)[i]:
            assert not expected.any()
            continue
        smooth = np.abs(ahead + behind - 2 * here) / h < 1e-2 * np.abs(expected).max()
        assert smooth.sum() > 0.8 * (expected != 0).sum()
        assert np.linalg.norm((found[:, i] - expected)[smooth]) < 5e-3 * np.linalg.norm(expected[smooth])


@pytest.mark.parametrize("name", ["fixed", "similarity", "cameras", "mesh", "cloud"])
def test_the_jacobian_is_that_of_the_residuals(problems, name):
    """Coarse residuals are nearly straight over a small step; priors and places are among them."""
    problem, state = problems[name]
    for level in range(problem.target.levels):
        np.testing.assert_allclose(problem.linearised(state, level)[0], problem.residuals(state, level), atol=1e-6)
    J = problem.linearised(state, 0)[1].dense()
    for i in np.flatnonzero(problem.free(state)):
        step = 2e-3 * np.eye(J.shape[1])[i]
        ahead, behind = (problem.residuals(problem.moved(state, s * step), 0, state) for s in (1, -1))
        expected = (ahead - behind) / 4e-3
        assert J[:, i] @ expected == pytest.approx(expected @ expected, rel=0.06)
        assert np.linalg.norm(J[:, i] - expected) < 0.2 * np.linalg.norm(expected)


def test_hull_distances_shrink_as_their_derivatives_say(problems):
    """Distances count whole pixels: what their squares sum to is the smoother."""
    problem, state = problems["hull"]
    here, J = problem.linearised(state, 0)
    np.testing.assert_allclose(here, problem.residuals(state, 0), atol=1e-9)
    gradient = 2 * here @ J.dense()
    for i in range(len(state.units)):
        step = 0.03 * np.eye(len(gradient))[i]
        ahead, behind = (np.square(problem.residuals(problem.moved(state, s * step), 0, state)).sum() for s in (1, -1))
        assert gradient[i] == pytest.approx((ahead - behind) / 0.06, rel=0.15, abs=0.1 * np.abs(gradient).max())


@pytest.mark.parametrize("scalars", [6, 25])
def test_a_jacobian_draws_once(scalars, monkeypatch):
    model = boards(scalars)
    crops, place = windows(model, model.space.sample(np.random.default_rng(0)))
    problem = Problem(model, Masks.of(crops, LEVELS), Similarity(crops.cameras))
    state = problem.state(model.space.sample(np.random.default_rng(1)), place.world_from_canonical)
    drawn = []
    for name in ("coverage", "coverage_slopes", "silhouettes"):
        original = getattr(__import__("recon.fitting.mask_target", fromlist=[name]), name)
        counting = lambda *a, original=original: drawn.append(1) or original(*a)  # noqa: E731
        monkeypatch.setattr(f"recon.fitting.mask_target.{name}", counting)
    builds = problem.builds
    assert problem.linearised(state, 1)[1].block.shape[1] == scalars + 7
    assert len(drawn) == 1
    assert problem.builds - builds <= scalars + 1


def test_a_scalar_whose_step_makes_other_vertices_is_probed_the_other_way_or_held():
    """A knob that is there from the middle of a range on."""
    model = boards(2)
    build = model.build_parts

    def with_knob(params):
        parts = build(params)
        return parts if params["height_0"] < 0.65 else [*parts, replace(parts[-1], name="knob")]

    odd = replace(model, build_parts=with_knob)
    problem = Problem(odd, VoxelGrid(np.zeros((64, 64, 64), bool)), Fixed())
    state = problem.state({"height_0": 0.6499, "height_1": 0.5}, np.zeros(0))
    steps = problem.nearby(state).steps
    assert steps[0][0] < 0 < steps[1][0]


# Known parameters are found again


def close(model, found, params, share: float) -> None:
    for s in model.space.scalars:
        assert found[s.name] == pytest.approx(params[s.name], abs=share * (s.high - s.low)), s.name
    assert all(found[p.name] == params[p.name] for p in model.space.discrete)


def test_from_masks_with_a_known_place(chair, seen):
    crops, place = seen
    placement = Fixed(crops.cameras, place.world_from_canonical)
    problem = Problem(chair, Masks.of(crops, LEVELS), placement)
    found = solve(problem, [problem.state(AWAY, placement.start())], SHORT)
    close(chair, problem.params(found.state), CHAIR, 0.02)
    assert found.loss < 0.02 < found.start


def test_from_masks_with_an_unknown_place_and_front(chair, seen):
    crops, place = seen
    problem = Problem(chair, Masks.of(crops, LEVELS), Similarity(crops.cameras))
    start = problem.state(AWAY, place.world_from_canonical @ yaw(np.pi).round() @ nudge(1))
    found = solve(problem, [start], replace(SHORT, fronts=True, sweeps=4)).state
    close(chair, problem.params(found), CHAIR, 0.03)
    assert found.front == 2
    assert found.place == pytest.approx(place.world_from_canonical, abs=0.01 * place.scale)


def test_from_two_masks_with_unknown_cameras(chair, seen):
    """The shape held, cameras and their common focal length are found; then all together."""
    crops, place = seen
    placement = before_cameras(crops)
    problem = Problem(chair, Masks(crops.masks[:2], crops.valid[:2], LEVELS), placement)
    start = problem.state(NEAR, placement.moved(camera_place(placement, crops, place), np.full(13, 0.03)))
    found = descended(problem, start, 12)
    assert problem.target.ious(problem.posed(start)).mean() < 0.85
    assert problem.target.ious(problem.posed(found)).mean() > 0.97


def test_a_known_pose_is_held(seen, chair):
    crops, place = seen
    placement = replace(before_cameras(crops, 1, known=True), views=crops.cameras.subset([0]))
    problem = Problem(chair, Masks(crops.masks[:1], crops.valid[:1], LEVELS), placement)
    start = problem.state(NEAR, placement.place(place.world_from_canonical[None], 1.0))
    found = descended(problem, start, 5)
    frames, zoom = placement.frames(found.place)
    assert zoom == 1
    assert frames[0, :3, :3] == pytest.approx(place.world_from_canonical[:3, :3])
    assert not list(moves.fronts(problem, found))
    assert problem.loss(found) < problem.loss(start)


def test_from_a_voxel_grid(chair):
    shape = chair.build(CHAIR)
    target = VoxelGrid(surface_grid(shape.vertices(), shape.triangles()))
    problem = Problem(chair, target, Fixed())
    found = solve(problem, [problem.state(AWAY, np.zeros(0))], replace(SHORT, coarse=True))
    assert found.loss < 0.01
    close(chair, problem.params(undecided.centred(problem, found.state)), CHAIR, 0.03)


@pytest.mark.parametrize("known", ["mesh", "cloud"])
def test_from_a_surface_that_faces_another_way(chair, known):
    surface = Triangles.of(chair.build(CHAIR))
    points = surface.at(surface.places(6000))[0]
    loose = known == "cloud"
    ways = [yaw(a) for a in (0, np.pi / 2, np.pi, -np.pi / 2)]
    if loose:
        points = points @ nudge(2, 2, 0.02, 1.02)[:3, :3].T + nudge(2, 2, 0.02, 1.02)[:3, 3]
    target = Surface(points, (250, 1200), None if loose else surface)
    placement = Upright(ways, loose)
    problem = Problem(chair, target, placement)
    starts = [problem.state(AWAY, placement.start(), front) for front in range(4)]
    found = solve(problem, starts, SHORT).state
    assert found.front == 0
    close(chair, problem.params(found), CHAIR, 0.04)


def test_by_distance_from_a_hull(chair, seen):
    crops, place = seen
    standing = Standing(crops.cameras, place.world_from_canonical)
    problem = Problem(chair, Hull(crops, crops, place, -0.5), standing)
    start = problem.state(NEAR, standing.start(place.world_from_canonical))
    found = polish(problem, start, 0, 6)
    assert problem.loss(found) < 0.2 * problem.loss(start)
    low = problem.posed(found).in_target(problem.shape(found).vertices())
    up = place.world_from_canonical[:3, 2] / place.scale
    assert (low @ up).min() == pytest.approx(float(up @ place.world_from_canonical[:3, 3]) - 0.5 * place.scale)


def test_twenty_scalars_and_sixteen_choices():
    """A space far larger than any product of its values could be gone through."""
    model = boards(20, flags=15, kinds=6)
    truth = model.space.sample(np.random.default_rng(0))
    crops, place = windows(model, truth, views=6)
    placement = Fixed(crops.cameras, place.world_from_canonical)
    problem = Problem(model, Masks.of(crops, LEVELS), placement)
    rng = np.random.default_rng(4)
    off = {s.name: s.unit_from_value(float(truth[s.name])) + rng.uniform(-0.2, 0.2) for s in model.space.scalars}
    start = {**truth, **{s.name: s.value_from_unit(float(np.clip(off[s.name], 0, 1))) for s in model.space.scalars}}
    start |= {"knob_3": not truth["knob_3"], "knob_7": not truth["knob_7"], "rail": "kind_1"}
    found = solve(problem, [problem.state(start, placement.start())], replace(SHORT, sweeps=4, tries=3, far=3))
    assert all(problem.params(found.state)[p.name] == truth[p.name] for p in model.space.discrete)
    units = np.array([s.unit_from_value(float(truth[s.name])) for s in model.space.scalars])
    assert np.abs(found.state.units - units).max() < 0.05


@pytest.mark.parametrize(("scalars", "kinds"), [(4, 0), (0, 4), (0, 0)])
def test_classes_without_choices_or_without_scalars(scalars, kinds):
    model = boards(scalars, kinds=kinds)
    rng = np.random.default_rng(1)
    truth, start = model.space.sample(rng), model.space.sample(rng)
    crops, place = windows(model, truth)
    problem = Problem(model, Masks.of(crops, LEVELS), Similarity(crops.cameras))
    schedule = replace(SHORT, far=2, good=1e-9, settle=(0.02,), jumps=(0.5,), fronts=True)
    found = solve(problem, [problem.state(start, place.world_from_canonical @ nudge(3))], schedule)
    assert found.loss < 0.03
    assert undecided.likely(problem, undecided.centred(problem, found.state)).choices == {
        p.name: truth[p.name] for p in model.space.discrete
    }


# What a search promises


def test_no_start_is_made_worse_and_the_same_seed_gives_the_same(chair, seen):
    crops, place = seen
    placement = Fixed(crops.cameras, place.world_from_canonical)
    tight = Schedule(sweeps=1, tries=1, far=1, steps=(1, 1, 1), good=1e-6)
    for start in (CHAIR, {**AWAY, "legs": "office"}):
        answers = []
        for _ in range(2):
            problem = Problem(chair, Masks.of(crops, LEVELS), placement)
            answers.append(solve(problem, [problem.state(start, placement.start())], tight))
        assert answers[0].loss <= answers[0].start
        assert answers[0].state.key == answers[1].state.key


def test_starts_are_taken_as_they_are_needed(chair, seen):
    crops, place = seen
    placement = Fixed(crops.cameras, place.world_from_canonical)
    problem = Problem(chair, Masks.of(crops, LEVELS), placement)
    taken = []

    def starts():
        for i in itertools.count():
            taken.append(i)
            yield problem.state(CHAIR if i == 0 else AWAY, placement.start())

    solve(problem, starts(), Schedule(looked=3, batches=5, sweeps=0, steps=(1, 1, 1), good=0.5, lost=0.5))
    assert len(taken) == 3
    with pytest.raises(ValueError, match="at least one start"):
        solve(problem, [], Schedule())


def test_moves_are_values_and_combinations_are_sampled():
    model = boards(1, flags=80, kinds=4)  # more combinations than 64 bits can count
    problem = Problem(model, VoxelGrid(np.zeros((64, 64, 64), bool)), Fixed())
    state = problem.state(model.space.sample(np.random.default_rng(0)), np.zeros(0))
    some = list(moves.combinations(problem, 50, np.random.default_rng(0)))
    assert len(set(some)) == len(some) == 50
    few = list(moves.combinations(problem, 50, np.random.default_rng(0), ["rail", "knob_0"]))
    assert len(set(few)) == 8
    near = list(moves.choices(problem, state))
    assert len(near) == 83
    for move in near:
        assert len(moves.differing(move.applied(problem, state).choices, state.choices)) == 1
    assert str(near[-1]).startswith("rail = kind_")
    both = moves.Both(near[0], moves.Jump(0, 0.3)).applied(problem, state)
    assert both.units[0] == 0.3
    assert moves.differing(both.choices, state.choices) == [near[0].values[0][0]]


def test_fronts_turn_the_shape_where_it_stands(chair, seen):
    crops, place = seen
    problem = Problem(chair, Masks.of(crops, LEVELS), Similarity(crops.cameras))
    state = problem.state(CHAIR, place.world_from_canonical)
    found = {str(m): m.applied(problem, state) for m in moves.fronts(problem, state)}
    assert set(found) == {f"front turned by {d} degrees" for d in (90, 180, 270)}
    half = found["front turned by 180 degrees"]
    assert half.front == 2
    assert half.place == pytest.approx(place.world_from_canonical @ np.diag([-1, -1, 1, 1]))
    search = Search(problem, replace(SHORT, fronts=True))
    ranked = search.behind(state, search.polished_neighbours(state))
    assert [loss for _, loss in ranked] == sorted(loss for _, loss in ranked)
    assert {str(m) for m, _ in ranked} >= set(found)


def test_unknown_pixels_say_nothing(chair, seen):
    crops, place = seen
    state_of = lambda problem: problem.state(AWAY, place.world_from_canonical)  # noqa: E731
    nothing = Problem(chair, Masks(crops.masks, np.zeros_like(crops.valid), LEVELS), Similarity(crops.cameras))
    assert nothing.loss(state_of(nothing)) == 0
    assert not nothing.residuals(state_of(nothing), 0).any()
    assert not nothing.linearised(state_of(nothing), 1)[1].block.any()
    half = crops.valid.copy()
    half[:, :, :56] = False
    masks = np.where(half, crops.masks, 0)
    some = Problem(chair, Masks(masks, half, LEVELS), Fixed(crops.cameras, place.world_from_canonical))
    truth = some.state(CHAIR, np.zeros(0))
    assert some.loss(truth) < 0.02
    assert some.smooth(truth, 0) < 0.05 * some.smooth(some.state(NEAR, np.zeros(0)), 0)


def test_masks_may_have_any_shape(chair):
    """Windows that no level divides, wider than high."""
    crops, place = windows(chair, CHAIR, views=3)
    wide = np.stack([cv2.copyMakeBorder(m, 0, 0, 0, 21, cv2.BORDER_CONSTANT) for m in crops.masks])
    cameras = Views(crops.cameras.names, crops.cameras.K, crops.cameras.cam_from_world, np.tile((133, 112), (3, 1)))
    target = Masks(wide, np.ones(wide.shape, bool), LEVELS)
    problem = Problem(chair, target, Fixed(cameras, place.world_from_canonical))
    truth = problem.state(CHAIR, np.zeros(0))
    for level in range(3):
        near, away = (problem.smooth(problem.state(p, np.zeros(0)), level) for p in (NEAR, AWAY))
        assert problem.smooth(truth, level) < 0.1 * near < away
