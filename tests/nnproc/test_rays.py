"""Cameras, pixel rays and exact path lengths."""

from __future__ import annotations

import math

import pytest
import torch
from kornia.geometry.camera.perspective import project_points
from kornia.geometry.linalg import transform_points
from torch import Tensor

from nnproc.ray_operator import ray_operator
from nnproc.rays import look_at_cameras, path_lengths, pixel_rays, select_pixels


@pytest.fixture(scope="module")
def cameras() -> tuple[Tensor, Tensor]:
    return look_at_cameras([20, 145, 250], [10, 35, -5], 2.2, 40.0, 64)


class TestCameras:
    def test_orthonormal_and_at_distance(self):
        azimuth, elevation = [0, 90, 150, 30], [0, 20, 35, 90]
        K, cam_from_canonical = look_at_cameras(azimuth, elevation, 1.7, 30, 100)
        rotation = cam_from_canonical[:, :3, :3]
        assert torch.allclose(rotation @ rotation.mT, torch.eye(3, dtype=torch.float64).expand(4, 3, 3))
        assert torch.allclose(torch.linalg.det(rotation), torch.ones(4, dtype=torch.float64))
        centre = torch.linalg.inv(cam_from_canonical)[:, :3, 3]
        assert torch.allclose(centre.norm(dim=1), torch.full((4,), 1.7, dtype=torch.float64))
        assert K[0, 0, 0] == pytest.approx(50 / math.tan(math.radians(15)))

    def test_azimuth_convention(self):
        _, cam_from_canonical = look_at_cameras([0, 90], [0, 0], 2.0, 30, 64)
        centre = torch.linalg.inv(cam_from_canonical)[:, :3, 3]
        expected = torch.tensor([[0.0, -2.0, 0.0], [2.0, 0.0, 0.0]], dtype=torch.float64)
        assert torch.allclose(centre, expected, atol=1e-12)

    @pytest.mark.parametrize("azimuth", [0, 75, 200, 310])
    def test_top_projects_up_and_middle_to_the_middle(self, azimuth):
        K, cam_from_canonical = look_at_cameras([azimuth], [25], 2.0, 30, 64)
        points = torch.tensor([[[0, 0, 0.4], [0, 0, 0], [0, 0, -0.4]]], dtype=torch.float64)
        u, v = project_points(transform_points(cam_from_canonical, points), K[:, None])[0].unbind(-1)
        assert v[0] < v[1] < v[2]
        assert torch.allclose(torch.stack([u[1], v[1]]), torch.full((2,), 32.0, dtype=torch.float64))

    def test_front_left_is_image_left(self):
        K, cam_from_canonical = look_at_cameras([0], [0], 2.0, 30, 64)
        left = transform_points(cam_from_canonical, torch.tensor([[[-0.3, 0, 0]]], dtype=torch.float64))
        assert project_points(left, K[:, None])[0, 0, 0] < 32

    def test_rays_go_through_pixel_centres(self, cameras):
        K, cam_from_canonical = cameras
        index = torch.tensor([0, 63, 64 * 40 + 7])
        origin, directions = pixel_rays(K[1], cam_from_canonical[1], index, 64)
        points = transform_points(cam_from_canonical[1:2], (origin + 1.3 * directions)[None])
        uv = project_points(points, K[1:2, None])[0]
        expected = torch.tensor([[0.5, 0.5], [63.5, 0.5], [7.5, 40.5]], dtype=torch.float64)
        assert torch.allclose(uv, expected)

    def test_exceptions(self):
        with pytest.raises(ValueError, match="got 2 and 1"):
            look_at_cameras([0, 1], [0], 1.0, 30, 8)
        with pytest.raises(ValueError, match=r"one index tensor a view \(2\), got 1"):
            select_pixels([torch.tensor([0])], 2, 4, 4)
        with pytest.raises(ValueError, match=r"lie in \[0, 16\), got 0 to 16"):
            select_pixels([torch.tensor([0, 16])], 1, 4, 4)
        with pytest.raises(ValueError, match=r"bool mask .* got \(1, 4, 5\)"):
            select_pixels(torch.ones(1, 4, 5, dtype=torch.bool), 1, 4, 4)


class TestPathLengths:
    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_axis_aligned_ray(self, axis):
        origin = torch.tensor([[0.013, -0.201, 0.333]], dtype=torch.float64)
        origin[0, axis] = -3.0
        direction = torch.zeros(1, 3, dtype=torch.float64)
        direction[0, axis] = 2.5
        counts, voxels, lengths = path_lengths(origin, direction, 64)
        assert counts.tolist() == [64]
        assert lengths.sum() == pytest.approx(64)
        cells = torch.stack(torch.unravel_index(voxels.long(), (64, 64, 64)), -1)
        assert cells[:, axis].tolist() == list(range(64))
        others = [a for a in range(3) if a != axis]
        assert (cells[:, others] == ((origin[0, others] + 0.5) * 64).long()).all()

    def test_sum_is_the_chord_of_the_cube(self, cameras):
        """Against the chord found by clipping the ray with the six faces one by one."""
        K, cam_from_canonical = cameras
        operator = ray_operator(*cameras, 64, 64)
        total = torch.zeros(operator.n_rays).index_add_(
            0,
            torch.repeat_interleave(torch.arange(operator.n_rays), operator.weight.crow_indices().long().diff()),
            operator.weight.values(),
        )
        expected = []
        for k, camera in zip(K, cam_from_canonical, strict=True):
            origin, directions = pixel_rays(k, camera, torch.arange(64 * 64), 64)
            low, high = torch.zeros(64 * 64, dtype=torch.float64), torch.full((64 * 64,), 1e9, dtype=torch.float64)
            for axis in range(3):
                a, b = (-0.5 - origin[axis]) / directions[:, axis], (0.5 - origin[axis]) / directions[:, axis]
                low, high = torch.maximum(low, torch.minimum(a, b)), torch.minimum(high, torch.maximum(a, b))
            expected.append((high - low).clamp_min(0) * directions.norm(dim=1) * 64)
        assert torch.allclose(total.double(), torch.cat(expected), atol=1e-3)

    def test_camera_inside_the_cube_sees_forward_only(self):
        counts, _, lengths = path_lengths(torch.zeros(1, 3).double(), torch.tensor([[0.0, 0, 1]]).double(), 64)
        assert counts.tolist() == [32]
        assert lengths.sum() == pytest.approx(32)

    def test_a_similarity_scales_depth_only(self, cameras):
        K, cam_from_canonical = cameras
        bigger = cam_from_canonical.clone()
        bigger[:, :3] *= 3.7
        a, b = ray_operator(K, cam_from_canonical, 64, 64, 16), ray_operator(K, bigger, 64, 64, 16)
        assert torch.allclose(a.weight.to_dense(), b.weight.to_dense(), atol=1e-5)
