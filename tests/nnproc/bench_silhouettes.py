"""Times of the silhouette renderers, side by side in one run: `python -m tests.bench_silhouettes [--threads 1]`.

Every repeat runs each renderer in turn, for at least 0.1 s, so that other load falls on all of them alike and none is
measured only with the caches that another one left. Printed are the median and the best in ms of one forward and
backward pass with respect to the grid (or, where said, the cameras), the least processor time of one, and how many
times more each takes than the sparse operator.
On a busy machine trust the processor time with --threads 1: waiting for the other core counts for nothing there, while
with two threads it hits a pass of 5 ms far harder than one of 500 ms.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable
from datetime import date

import torch
from torch import Tensor

from nnproc.ray_marching import ray_march, render_silhouettes
from nnproc.ray_operator import RayOperator, ray_operator, visual_hull
from nnproc.rays import look_at_cameras, paper_cameras

SIZE = 128


def say(line: str = "") -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """ms by the clock and of processor time."""
    start, start_cpu = time.perf_counter(), time.process_time()
    call()
    return 1000 * (time.perf_counter() - start), 1000 * (time.process_time() - start_cpu)


def in_turn(calls: dict[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Median, best and least processor time, ms, of every call over the repeats; a first unmeasured round warms up."""
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in calls}
    for repeat in range(repeats + 1):
        for name, call in calls.items():
            spent = 0.0
            while spent < 100:
                taken = timed(call)
                spent += taken[0]
                if repeat > 0:
                    times[name].append(taken)
    summary = {}
    for name, taken_all in times.items():
        clock, cpu = zip(*taken_all, strict=True)
        summary[name] = [statistics.median(clock), min(clock), min(cpu)]
    return summary


def both_ways(draw: Callable[[Tensor], Tensor], *leaves: Tensor) -> Callable[[], object]:
    """A forward and backward pass with respect to the leaves."""
    return lambda: torch.autograd.grad(draw(leaves[0]).sum(), leaves)


def operator_pass(op: RayOperator, count: int) -> Callable[[], object]:
    return both_ways(op.render, (torch.randn(count, 64, 64, 64) - 4).requires_grad_())


def table(times: dict[str, list[float]], reference: str) -> None:
    say(f"| {'renderer':58} | median ms | best ms |  CPU ms | times the operator: median, best, CPU |")
    say(f"|{'-' * 60}|{'-' * 11}|{'-' * 9}|{'-' * 9}|{'-' * 39}|")
    for name, (median, best, cpu) in times.items():
        ratios = " ".join(f"{a / b:12.1f}" for a, b in zip((median, best, cpu), times[reference], strict=True))
        say(f"| {name:58} | {median:9.1f} | {best:7.1f} | {cpu:7.1f} | {ratios[1:]} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9, help="measured rounds (default 9)")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads(), help="torch threads for all renderers")
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(0)
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "unknown"
    machine = f"{processor()}, {os.cpu_count()} CPUs, load {load}"
    say(f"{date.today()}, {machine}; torch {torch.__version__}, {args.threads} threads for all")

    K, cam_from_canonical = (c.float() for c in paper_cameras(SIZE))
    start = time.perf_counter()
    op = ray_operator(K, cam_from_canonical, SIZE, SIZE)
    say(
        f"operator: {op.n_rays} rays, {len(op.weight.values())} crossings, built in {time.perf_counter() - start:.2f} s"
    )
    logits = (torch.randn(64, 64, 64) - 4).requires_grad_()
    cameras = K.clone().requires_grad_(), cam_from_canonical.clone().requires_grad_()
    say(f"\nThe paper's 4 views of {SIZE}^2, 64^3 grid, forward and backward:")
    one = "sparse operator, 1 grid"
    calls = {one: operator_pass(op, 1), "sparse operator, 8 grids": operator_pass(op, 8)}
    for samples in (96, 150):
        calls[f"grid_sample ray marching, {samples} samples a ray"] = both_ways(
            lambda x, n=samples: ray_march(torch.sigmoid(x), K, cam_from_canonical, SIZE, SIZE, n), logits
        )
    calls["render_silhouettes (gradients for the grid)"] = both_ways(
        lambda x: render_silhouettes(x, K, cam_from_canonical, SIZE, SIZE), logits
    )
    calls["render_silhouettes (gradients for K and cam_from_canonical)"] = lambda: torch.autograd.grad(
        render_silhouettes(logits.detach(), *cameras, SIZE, SIZE).sum(), cameras
    )
    table(in_turn(calls, args.repeats), one)

    say("\nViews of a whole object (distance 2.2, fov 35 degrees):")
    calls = {one + f", 4 views of {SIZE}^2": operator_pass(whole(4, SIZE), 1)}
    many = whole(28, 96)
    calls["sparse operator, 1 grid, 28 views of 96^2"] = operator_pass(many, 1)
    calls["sparse operator, 8 grids, 28 views of 96^2"] = operator_pass(many, 8)
    masks = many.scatter(many.render(torch.randn(64, 64, 64) - 4)) > 0.5
    calls["visual hull, 28 views of 96^2"] = lambda: visual_hull(many, masks)
    table(in_turn(calls, args.repeats), one + f", 4 views of {SIZE}^2")


def whole(views: int, size: int) -> RayOperator:
    azimuth = [360 * v / views for v in range(views)]
    return ray_operator(*look_at_cameras(azimuth, [20] * views, 2.2, 35, size), size, size)


if __name__ == "__main__":
    main()
