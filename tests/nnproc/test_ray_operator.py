"""The three silhouette renderers and the visual hull: values, outlines, gradients, errors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from kornia.geometry.camera.perspective import project_points
from kornia.geometry.linalg import transform_points
from scipy.ndimage import gaussian_filter
from scipy.spatial import Delaunay
from torch import Tensor
from torch.autograd import gradcheck

from nnproc import ray_operator as operator_file
from nnproc.ray_marching import ray_march, render_silhouettes
from nnproc.ray_operator import RayOperator, ray_operator, view_votes, visual_hull
from nnproc.rays import look_at_cameras, paper_cameras, path_lengths, pixel_rays

FULL, EMPTY = 20.0, -20.0


@pytest.fixture(scope="module")
def cameras() -> tuple[Tensor, Tensor]:
    return look_at_cameras([20, 145, 250], [10, 35, -5], 2.2, 40.0, 64)


@pytest.fixture(scope="module")
def operator(cameras) -> RayOperator:
    return ray_operator(*cameras, 64, 64)


@pytest.fixture(scope="module")
def ring() -> RayOperator:
    """Sixteen views all round, from two heights."""
    azimuth = [*range(0, 360, 45)] * 2
    return ray_operator(*look_at_cameras(azimuth, [5] * 8 + [45] * 8, 2.2, 35, 128), 128, 128)


@pytest.fixture(scope="module")
def box() -> Tensor:
    return box_grid((10, 20, 5), (40, 44, 60)) > 0


def hard(inside: Tensor) -> Tensor:
    return torch.where(inside, FULL, EMPTY)


def centres(resolution: int = 64) -> Tensor:
    """(R, R, R, 3) voxel centres in the canonical frame."""
    axis = (torch.arange(resolution, dtype=torch.float64) + 0.5) / resolution - 0.5
    return torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)


def box_grid(low: tuple[int, int, int], high: tuple[int, int, int], logit: float = FULL) -> Tensor:
    grid = torch.full((64, 64, 64), -logit)
    grid[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = logit
    return grid


def random_boxes(rng: np.random.Generator, boards: bool) -> Tensor:
    inside = torch.zeros(64, 64, 64, dtype=torch.bool)
    for _ in range(6):
        size = rng.integers(4, 30, 3)
        if boards:
            size[rng.integers(3)] = 1
        low = [int(rng.integers(1, 63 - s)) for s in size]
        inside[tuple(slice(a, a + int(s)) for a, s in zip(low, size, strict=True))] = True
    return torch.where(inside, 9.0, -9.0)


def smooth_noise(rng: np.random.Generator, sigma: float) -> Tensor:
    noise = gaussian_filter(rng.standard_normal((64, 64, 64)), sigma)
    return torch.from_numpy(6 * noise / noise.std() - 6).float()


def chair() -> Tensor:
    grid = box_grid((17, 17, 28), (47, 47, 31), 10.0)
    for low, high in [
        ((17, 44, 31), (47, 47, 63)),
        *(((i, j, 1), (i + 3, j + 3, 28)) for i in (17, 44) for j in (17, 44)),
    ]:
        grid = torch.maximum(grid, box_grid(low, high, 10.0))
    return grid


def rigid(twist: Tensor) -> Tensor:
    """(4, 4) motion from rotation vector and translation (6,)."""
    zero = twist.new_zeros(())
    x, y, z, a, b, c = twist.unbind()
    rows = [torch.stack(r) for r in ([zero, -z, y, a], [z, zero, -x, b], [-y, x, zero, c], [zero] * 4)]
    return torch.linalg.matrix_exp(torch.stack(rows))


def iou(a: Tensor, b: Tensor) -> float:
    return float((a & b).sum() / (a | b).sum())


class TestRayOperator:
    def test_smoke_and_shapes(self, operator):
        assert operator.render(torch.zeros(64, 64, 64)).shape == (3 * 64 * 64,)
        out = operator.render(torch.randn(2, 64, 64, 64) - 4)
        assert out.shape == (2, 3 * 64 * 64)
        assert out.dtype == torch.float32
        assert out.min() >= 0
        assert out.max() <= 1
        assert operator.scatter(out).shape == (2, 3, 64, 64)
        assert operator.weight.col_indices().dtype == torch.int32

    def test_equals_product_of_transparencies(self, cameras):
        op = ray_operator(*cameras, 64, 64, resolution=8, pixels=[torch.tensor([2080, 2200])] * 3, dtype=torch.float64)
        logits = torch.randn(8, 8, 8, dtype=torch.float64)
        product = ((1 - torch.sigmoid(logits)).flatten() ** op.weight.to_dense()).prod(-1)
        assert torch.allclose(op.render(logits), 1 - product)

    @pytest.mark.parametrize("has_mkl", [True, False])
    def test_gradcheck(self, monkeypatch, has_mkl):
        monkeypatch.setattr(operator_file, "_HAS_MKL", has_mkl and operator_file._HAS_MKL)
        op = ray_operator(*look_at_cameras([10, 150], [20, 35], 2.2, 30, 8), 8, 8, 4, dtype=torch.float64)
        logits = torch.randn(2, 4, 4, 4, dtype=torch.float64, requires_grad=True)
        assert gradcheck(op.render, (logits,))

    @pytest.mark.parametrize("count", [1, 3, 6])
    def test_batch_equals_loop(self, operator, count):
        logits = (torch.randn(count, 64, 64, 64, generator=torch.Generator().manual_seed(1)) - 4).requires_grad_()
        batch = operator.render(logits)
        loop = torch.stack([operator.render(one) for one in logits])
        assert torch.allclose(batch, loop, atol=1e-6)
        (a,) = torch.autograd.grad(batch.square().sum(), logits)
        (b,) = torch.autograd.grad(loop.square().sum(), logits)
        assert torch.allclose(a, b, atol=1e-5)

    def test_subset_has_the_same_values(self, cameras, operator):
        logits = torch.randn(64, 64, 64) - 4
        images = operator.scatter(operator.render(logits))
        crop = torch.zeros(3, 64, 64, dtype=torch.bool)
        crop[0, 10:30, 20:50] = crop[2, 5:60, 31:33] = True
        cropped = ray_operator(*cameras, 64, 64, pixels=crop)
        assert torch.allclose(cropped.render(logits), images[crop], atol=1e-6)
        assert torch.equal(cropped.gather(crop), torch.ones(cropped.n_rays, dtype=torch.bool))
        assert torch.allclose(cropped.scatter(cropped.render(logits)), images * crop, atol=1e-6)
        index = [torch.tensor([700, 5]), torch.tensor([], dtype=torch.int64), torch.tensor([2000])]
        listed = ray_operator(*cameras, 64, 64, pixels=index).render(logits)
        expected = torch.stack([images[0].flatten()[700], images[0].flatten()[5], images[2].flatten()[2000]])
        assert torch.allclose(listed, expected, atol=1e-6)

    def test_rays_that_miss_cost_nothing(self):
        op = ray_operator(*look_at_cameras([0], [0], 5.0, 40, 64), 64, 64)
        missed = op.weight.crow_indices().diff() == 0
        assert missed.float().mean() > 0.8
        assert (op.render(torch.zeros(64, 64, 64))[missed] == 0).all()

    def test_under_autocast(self, operator):
        logits = torch.randn(64, 64, 64) - 4
        with torch.autocast("cpu", torch.bfloat16):
            assert torch.equal(operator.render(logits), operator.render(logits.float()))
            assert operator.render(logits.bfloat16()).dtype == torch.float32

    def test_exceptions(self, cameras, operator):
        K, cam_from_canonical = cameras
        with pytest.raises(ValueError, match=r"K must be \(V, 3, 3\), got \(3, 4, 4\)"):
            ray_operator(cam_from_canonical, cam_from_canonical, 64, 64)
        with pytest.raises(ValueError, match=r"must be \(3, 4, 4\), got \(2, 4, 4\)"):
            ray_operator(K, cam_from_canonical[:2], 64, 64)
        with pytest.raises(ValueError, match=r"got \(32, 32, 32\)"):
            operator.render(torch.zeros(32, 32, 32))
        with pytest.raises(ValueError, match=r"got \(3, 32, 64\)"):
            operator.gather(torch.zeros(3, 32, 64))
        with pytest.raises(ValueError, match=r"got \(5,\)"):
            operator.scatter(torch.zeros(5))
        with pytest.raises(ValueError, match="0 rays"):
            ray_operator(K, cam_from_canonical, 64, 64, pixels=torch.zeros(3, 64, 64, dtype=torch.bool))


class TestOutlines:
    """Hard grids against outlines known in closed form, 128^2 images."""

    size = 128

    def analytic_cube(self, K: Tensor, cam_from_canonical: Tensor, half: float) -> Tensor:
        """(V, H, W): pixel centres inside the convex hull of the projected corners."""
        signs = torch.tensor([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=torch.float64)
        corners = transform_points(cam_from_canonical, (half * signs).expand(len(K), 8, 3))
        grid = np.stack(np.meshgrid(np.arange(self.size), np.arange(self.size)), -1).reshape(-1, 2) + 0.5
        hulls = [Delaunay(uv.numpy()).find_simplex(grid) >= 0 for uv in project_points(corners, K[:, None])]
        return torch.from_numpy(np.stack(hulls)).reshape(-1, self.size, self.size)

    def analytic_sphere(self, K: Tensor, cam_from_canonical: Tensor, radius: float) -> Tensor:
        """(V, H, W): rays within the cone that touches the sphere, whose half angle is asin(radius / distance)."""
        out = []
        for k, camera in zip(K, cam_from_canonical, strict=True):
            origin, directions = pixel_rays(k, camera, torch.arange(self.size**2), self.size)
            cosine = -(directions @ origin) / (directions.norm(dim=1) * origin.norm())
            out.append(cosine >= math.sqrt(1 - (radius / float(origin.norm())) ** 2))
        return torch.stack(out).reshape(-1, self.size, self.size)

    def outlines(self, logits: Tensor, K: Tensor, cam_from_canonical: Tensor) -> tuple[Tensor, Tensor]:
        """(V, H, W) bool from the operator and from the marcher."""
        op = ray_operator(K, cam_from_canonical, self.size, self.size, logits.shape[-1])
        marched = render_silhouettes(logits, K, cam_from_canonical, self.size, self.size)
        return op.scatter(op.render(logits)) > 0.5, marched > 0.5

    def test_cube(self):
        K, cam_from_canonical = look_at_cameras([30, 205], [25, -10], 2.2, 40.0, self.size)
        logits = hard((centres().abs() < 0.3125).all(-1))
        expected = self.analytic_cube(K, cam_from_canonical, 0.3125)
        for drawn in self.outlines(logits, K, cam_from_canonical):
            assert iou(drawn, expected) > 0.98

    def test_sphere(self):
        """Voxels wholly inside give the outline from within, voxels that it touches from without."""
        K, cam_from_canonical = look_at_cameras([30, 205], [25, -10], 2.2, 40.0, self.size)
        radius, resolution = 0.45, 96
        nearest = (centres(resolution).abs() - 0.5 / resolution).clamp_min(0).norm(dim=-1)
        farthest = (centres(resolution).abs() + 0.5 / resolution).norm(dim=-1)
        expected = self.analytic_sphere(K, cam_from_canonical, radius)
        inner, marched = self.outlines(hard(farthest <= radius), K, cam_from_canonical)
        assert iou(inner, expected) > 0.98
        assert iou(marched, expected) > 0.98
        outer, _ = self.outlines(hard(nearest < radius), K, cam_from_canonical)
        assert not (inner & ~expected).any()
        assert not (expected & ~outer).any()


class TestRenderSilhouettes:
    @pytest.mark.parametrize("kind", ["smooth2", "smooth4", "boxes", "boards"])
    def test_agrees_with_the_operator(self, kind):
        rng = np.random.default_rng(len(kind))
        K, cam_from_canonical = look_at_cameras(rng.uniform(0, 360, 3), rng.uniform(-10, 60, 3), 1.6, 45, 64)
        logits = smooth_noise(rng, int(kind[-1])) if kind[:6] == "smooth" else random_boxes(rng, kind == "boards")
        op = ray_operator(K, cam_from_canonical, 64, 64)
        exact = op.scatter(op.render(logits))
        assert 0.02 < exact.mean() < 0.98
        assert (render_silhouettes(logits, K, cam_from_canonical, 64, 64) - exact).abs().mean() < 0.01

    def test_shapes_subset_and_batch(self, cameras):
        logits = torch.randn(2, 64, 64, 64) - 4
        images = render_silhouettes(logits, *cameras, 64, 64)
        assert images.shape == (2, 3, 64, 64)
        assert torch.allclose(render_silhouettes(logits[1], *cameras, 64, 64), images[1], atol=1e-6)
        index = [torch.tensor([2080, 2000]), torch.tensor([2100]), torch.tensor([1900])]
        some = render_silhouettes(logits, *cameras, 64, 64, pixels=index)
        expected = torch.cat([image.flatten(1)[:, i] for image, i in zip(images.unbind(1), index, strict=True)], -1)
        assert torch.allclose(some, expected, atol=1e-6)

    def test_no_ray_hits(self):
        K, cam_from_canonical = look_at_cameras([0], [0], 3.0, 30, 8)
        cam_from_canonical[:, 2, 3] = -3  # behind the camera
        cam_from_canonical.requires_grad_()
        assert (render_silhouettes(torch.ones(8, 8, 8), K, cam_from_canonical, 8, 8) == 0).all()

    @pytest.mark.parametrize("sharpness", [1.0, 3.0])
    def test_gradcheck_grid_and_pose(self, sharpness):
        torch.manual_seed(0)
        K, cam_from_canonical = (c.requires_grad_() for c in look_at_cameras([20, 200], [15, 40], 2.0, 35, 4))
        logits = torch.randn(5, 5, 5, dtype=torch.float64, requires_grad=True)
        assert gradcheck(
            lambda *args: render_silhouettes(*args, 4, 4, sharpness=sharpness), (logits, K, cam_from_canonical)
        )

    def test_recovers_a_camera(self):
        """Off by 3 degrees and 3 % of the distance, one view of a thin-legged chair, by Adam."""
        size, steps = 48, 80
        K, cam_from_canonical = (c.float() for c in look_at_cameras([30], [25], 2.0, 40, size))
        op = ray_operator(K, cam_from_canonical, size, size)
        target = op.scatter(op.render(chair()))
        noise = torch.randn(2, 3, generator=torch.Generator().manual_seed(1))
        turn, shift = noise / noise.norm(dim=1, keepdim=True)
        start = rigid(torch.cat([turn * math.radians(3), shift * 0.03 * 2.0]))
        twist = torch.zeros(6, requires_grad=True)
        optimiser = torch.optim.Adam([twist], lr=0.01, betas=(0.9, 0.99))
        losses: list[float] = []
        for done in range(steps):
            optimiser.param_groups[0]["lr"] = 0.01 * (1 - done / steps)
            images = render_silhouettes(chair(), K, cam_from_canonical @ start @ rigid(twist), size, size)
            loss = (images - target).square().mean()
            losses.append(float(loss.detach()))
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
        error = (start @ rigid(twist)).detach()
        angle = math.degrees(math.acos(min(1.0, (float(error[:3, :3].trace()) - 1) / 2)))
        assert losses[-1] < losses[0] / 10
        assert angle < 1.5
        assert error[:3, 3].norm() < 0.015 * 2.0

    def test_exceptions(self, cameras):
        with pytest.raises(ValueError, match=r"logits must be .* got \(8, 8, 9\)"):
            render_silhouettes(torch.zeros(8, 8, 9), *cameras, 64, 64)
        with pytest.raises(ValueError, match=r"got 0\.5 and 1"):
            render_silhouettes(torch.zeros(8, 8, 8), *cameras, 64, 64, sharpness=0.5)
        with pytest.raises(ValueError, match=r"must be \(3, 4, 4\), got \(1, 4, 4\)"):
            render_silhouettes(torch.zeros(8, 8, 8), cameras[0], cameras[1][:1], 64, 64)


class TestRayMarch:
    def test_sees_the_same_outline(self):
        K, cam_from_canonical = paper_cameras(64)
        logits = box_grid((26, 20, 22), (36, 42, 40))
        op = ray_operator(K, cam_from_canonical, 64, 64)
        marched = ray_march(torch.sigmoid(logits), K, cam_from_canonical, 64, 64)
        assert marched.shape == (4, 64, 64)
        # It saturates half-full samples at outlines (no step length), so its silhouettes are fatter.
        assert iou(marched > 0.5, op.scatter(op.render(logits)) > 0.5) > 0.9

    def test_gradcheck(self):
        K, cam_from_canonical = look_at_cameras([20], [15], 1.1, 30, 3)
        occupancy = torch.rand(2, 4, 4, 4, dtype=torch.float64) * 0.5 + 0.1
        assert gradcheck(lambda o: ray_march(o, K, cam_from_canonical, 3, 3, samples=20), (occupancy.requires_grad_(),))

    def test_exception(self, cameras):
        with pytest.raises(ValueError, match=r"occupancy must be .* got \(4, 4\)"):
            ray_march(torch.zeros(4, 4), *cameras, 64, 64)


class TestVisualHull:
    def test_contains_the_box_and_is_close(self, ring, box):
        masks = ring.scatter(ring.render(hard(box))) > 0.5
        hull = visual_hull(ring, masks, fraction=1.0)
        assert hull.dtype == torch.bool
        assert hull.shape == (64, 64, 64)
        assert not (box & ~hull).any()
        assert iou(hull, box) > 0.85
        loose = visual_hull(ring, masks)
        assert not (hull & ~loose).any()
        assert iou(loose, box) > 0.6

    def test_tolerates_a_bad_view_when_asked(self, ring, box):
        masks = ring.scatter(ring.render(hard(box))) > 0.5
        masks[3] = False
        assert not visual_hull(ring, masks, fraction=1.0).any()
        assert not (box & ~visual_hull(ring, masks, fraction=0.9)).any()
        trust = torch.ones(16)
        trust[3] = 0
        assert not (box & ~visual_hull(ring, masks, fraction=1.0, trust=trust)).any()

    def test_full_masks_keep_all_that_is_seen(self, ring):
        assert visual_hull(ring, torch.ones(16, 128, 128), fraction=1.0).all()

    def test_votes_are_shares(self, operator):
        masks = torch.rand(3, 64, 64)
        inside, path = view_votes(operator, masks)
        assert inside.shape == path.shape == (3, 64, 64, 64)
        assert inside.min() >= 0
        assert inside.max() <= masks.max() + 1e-6

    def test_only_voxels_on_the_ray_of_a_one_pixel_mask_are_inside(self, cameras, operator):
        K, cam_from_canonical = cameras
        masks = torch.zeros(3, 64, 64)
        masks[1, 30, 34] = 1
        inside, _ = view_votes(operator, masks)
        origin, directions = pixel_rays(K[1], cam_from_canonical[1], torch.tensor([30 * 64 + 34]), 64)
        _, voxels, _ = path_lengths(origin[None], directions, 64)
        assert (inside[1].flatten().nonzero()[:, 0] == voxels.long().sort().values).all()
        assert not inside[[0, 2]].any()

    def test_min_views(self, operator):
        masks = torch.ones(3, 64, 64)
        seen = (view_votes(operator, masks)[1] > 0).sum(0)
        assert torch.equal(visual_hull(operator, masks, min_views=3), seen == 3)

    def test_exceptions(self, operator):
        with pytest.raises(ValueError, match=r"images must be \(3, 64, 64\), got \(2, 64, 64\)"):
            visual_hull(operator, torch.ones(2, 64, 64))
        with pytest.raises(ValueError, match=r"trust must be \(3,\), got \(2,\)"):
            visual_hull(operator, torch.ones(3, 64, 64), trust=torch.ones(2))
