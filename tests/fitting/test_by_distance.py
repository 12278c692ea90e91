"""Distances to the hull of silhouettes: analytic boxes, and what a class comes up with for an object it cannot make."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from recon.evaluate.data.true_views import all_round
from recon.fitting import refine
from recon.fitting.by_distance import DistanceSearch, widest_gap
from recon.fitting.hull_target import Hull
from recon.fitting.refine import RefineOptions
from recon.fitting.search import solve
from recon.geometry.object_windows import object_crops
from recon.scene import Scene

CHAIR = {"width": 0.62, "depth": 0.47, "leg_height": 0.41, "legs": "basic", "arms": "solid", "back": "hbar"}


def _hull(mesh: trimesh.Trimesh) -> tuple[Hull, Scene]:
    scene = all_round(mesh, 16, 0)
    crops = [object_crops(scene, size) for size in (224, 112)]
    return Hull(*crops, scene.canonical, -0.25), scene


@pytest.fixture(scope="module")
def box():
    return _hull(trimesh.creation.box((1, 0.6, 0.5)))


def test_the_hull_holds_the_object_and_little_beside_it(box):
    inside = np.random.default_rng(0).uniform(-0.48, 0.48, (500, 3)) * (1, 0.6, 0.5)
    assert (box[0].sticking_out(inside) == 0).all()
    low, high = box[0].triangles.reshape(-1, 3).min(0), box[0].triangles.reshape(-1, 3).max(0)
    # Views from above do not see the middle of the top, and 16 of them leave the corners blunt.
    assert (np.abs([low, high]) < np.array([0.5, 0.3, 0.25]) + 0.09).all()


def test_places_outside_count_by_their_distance_and_places_inside_do_not(box):
    away = np.array([(0.53, 0, -0.1), (0.0, -0.35, 0), (0.9, 0, 0), (0, 0, -0.35)])
    assert box[0].sticking_out(away) == pytest.approx([0.03, 0.05, 0.4, 0.1], abs=0.05)
    assert (box[0].sticking_out(np.array([(0, 0, 0), (0.48, 0.28, 0.2)])) == 0).all()


def test_outlines_that_cover_the_hull_leave_nothing_and_missing_ones_leave_their_distance(box):
    hull, scene = box
    drawn = object_crops(scene, 112).masks >= 0.5
    assert hull.left_empty(drawn)[0].max() < 0.03
    shorter = all_round(trimesh.creation.box((0.6, 0.6, 0.5)), 16, 0)
    short = object_crops(shorter.standing(scene.canonical), 112).masks >= 0.5
    ends = np.abs(hull.points[:, 0]) > 0.49
    assert 0.1 < np.median(hull.left_empty(short)[0][ends]) < 0.25  # 0.2 is missing at each end


@pytest.fixture(scope="module")
def searched(chair):
    """A search for a lounge chair on slanted thick legs, which no parameter can make."""
    seat = trimesh.creation.box((0.6, 0.62, 0.2)).apply_translation((0, 0, 0))
    back = trimesh.creation.box((0.6, 0.14, 0.55)).apply_translation((0, 0.27, 0.25))
    feet = [
        trimesh.creation.cone(0.09, 0.4).apply_translation((x, y, -0.45)) for x in (-0.22, 0.22) for y in (-0.2, 0.2)
    ]
    mesh = trimesh.util.concatenate([seat, back, *feet])
    mesh.apply_translation(-mesh.bounds.mean(0)).apply_scale(1 / np.ptp(mesh.bounds, axis=0).max())
    scene = all_round(mesh, 16, 1)
    problem = refine.problem_of(chair, scene, RefineOptions(size=96))
    return DistanceSearch(problem, scene), scene.canonical


def test_an_answer_stands_on_the_floor_as_long_as_the_object(searched):
    search, place = searched
    floating = place.world_from_canonical @ np.diag([0.8, 0.8, 0.8, 1])
    floating[:3, 3] += place.world_from_canonical[:3, 2] * 0.2
    state = search.anywhere.state(CHAIR, floating)
    assert not search.placed(state)
    stood = search.outlines.posed(search.stood(state)).target_from_shape
    assert search.placed(replace(state, place=stood))
    assert np.linalg.norm(stood[:3, 0]) == pytest.approx(place.scale, rel=0.03)


@pytest.fixture(scope="module")
def nearest(searched):
    search, place = searched
    start = search.anywhere.state(CHAIR, place.world_from_canonical)
    return solve(search.distances, search.starts(start), search.options.search).state, search.stood(start)


def test_the_nearest_answer_is_nearer_than_the_start(searched, nearest):
    found, start = nearest
    assert searched[0].distances.loss(found) < 0.5 * searched[0].distances.loss(start)


def test_a_floating_answer_is_replaced_by_one_that_stands(searched, nearest):
    search, place = searched
    lifted = search.distances.posed(nearest[0]).target_from_shape.copy()
    lifted[:3, 3] += 0.1 * place.world_from_canonical[:3, 2]
    found = search.better(replace(nearest[0], place=lifted))
    assert search.placed(replace(found, place=search.distances.posed(found).target_from_shape))
    assert search.distances.loss(found) <= 1.05 * search.distances.loss(nearest[0])


def test_one_mask_with_a_hole_does_not_pierce_a_forgiving_hull(box):
    scene = box[1]
    masks = scene.silhouettes
    holed = masks.masks[3].copy()
    rows, columns = np.nonzero(holed)
    middle, across = int(rows.mean()), int(columns.mean())
    holed[middle - 25 : middle + 25, across - 25 : across + 25] = False
    masks = replace(masks, masks=(*masks.masks[:3], holed, *masks.masks[4:]))
    crops = [object_crops(replace(scene, silhouettes=masks), size) for size in (224, 112)]
    strict, forgiving = (Hull(*crops, scene.canonical, -0.25, f) for f in (False, True))
    inside = np.random.default_rng(0).uniform(-0.45, 0.45, (500, 3)) * (1, 0.6, 0.5)
    assert (strict.sticking_out(inside) > 0).any()
    assert (forgiving.sticking_out(inside) == 0).all()


def _near(model, scene, masks):
    seen = replace(scene, silhouettes=masks)
    return refine._near(refine.problem_of(model, seen, RefineOptions()), seen)


def test_masks_that_contradict_each_other_leave_the_answer_as_it_is(chair, box):
    scene = box[1]
    masks = scene.silhouettes
    apart = tuple(np.roll(m, 260 * (-1) ** i, 1) for i, m in enumerate(masks.masks))
    assert _near(chair, scene, replace(masks, masks=apart)) is None


def test_views_from_one_side_leave_no_hull_to_measure_from(chair, box):
    poses, masks, place = box[1].poses, box[1].silhouettes, box[1].canonical
    assert widest_gap(poses.cameras, place) < 60
    centres = (poses.cameras.centres() - place.world_from_canonical[:3, 3]) @ place.world_from_canonical[:3, :3]
    front = masks.used & (centres[:, 1] < 0)
    assert 170 < widest_gap(poses.cameras.subset(np.flatnonzero(front)), place) < 260
    assert widest_gap(poses.cameras.subset([0]), place) == 360
    assert _near(chair, box[1], replace(masks, used=front)) is None
