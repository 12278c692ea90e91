"""Damped Gauss-Newton steps of a problem's state: within the scalars' ranges, and no further than derivatives tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from recon.fitting.problem import Problem
from recon.fitting.state import State

LONGEST = 0.25  # of a scalar's range, canonical units or radians: the longest step
DAMPED = 1e-2  # share of the Hessian's diagonal that is added at first
TRIALS = 3  # of a step, ever more damped
LEAST = 1e-4  # share of the residuals' squares that a step must win
ENOUGH = 1e-2  # a step that wins less is the last


def polish(problem: Problem, state: State, level: int, steps: int) -> State:
    """The state after at most so many steps at a level of the target; its residuals' squares never grow."""
    damping, n = DAMPED, len(state.units)
    for _ in range(steps if problem.free(state).any() else 0):
        here, J = problem.linearised(state, level)
        hessian, gradient, loss = J.block.T @ J.block, J.block.T @ here[J.rows], float(here @ here)
        free = problem.free(state) & (np.diag(hessian) > 0)
        # Scalars at an end of their ranges that want to leave it are held.
        free[:n] &= ~(((state.units <= 0) & (gradient[:n] > 0)) | ((state.units >= 1) & (gradient[:n] < 0)))
        for _ in range(TRIALS):
            trial = problem.moved(state, _step(hessian, gradient, free, damping))
            lower = float(np.square(problem.residuals(trial, level, state)).sum())
            if lower < loss * (1 - LEAST):
                break
            damping *= 8
        else:
            return state
        state, damping = trial, damping / 4
        if loss - lower < ENOUGH * loss:
            break
    return state


def _step(hessian: np.ndarray, gradient: np.ndarray, free: np.ndarray, damping: float) -> np.ndarray:
    """The damped step of what is free."""
    step = np.zeros(len(gradient))
    if free.any():
        some = np.ix_(free, free)
        diagonal = np.diag(hessian)[free]
        damped = hessian[some] + np.diag(damping * diagonal + 1e-9 * max(float(diagonal.max()), 1e-9))
        step[free] = -np.linalg.solve(damped, gradient[free])
    return np.clip(step, -LONGEST, LONGEST)


def descended(problem: Problem, state: State, steps: int, levels: Sequence[int] | None = None) -> State:
    """Polished coarse to fine, the best by loss of what was visited."""
    visited = [state]
    for level in range(problem.target.levels) if levels is None else levels:
        visited.append(polish(problem, visited[-1], level, steps))
    return min(visited, key=problem.loss)


def settled(problem: Problem, state: State, sizes: Sequence[float], rounds: int = 3) -> State:
    """Small steps by the loss itself: what counts whole pixels or voxels tells apart what smooth shares blur.

    Steps go along directions that change the residuals equally much and independently; `sizes` are root mean squares of
    that change, large to small.
    """
    loss = problem.loss(state)
    if loss <= 0 or not sizes or not problem.free(state).any():
        return state
    free = np.flatnonzero(problem.free(state))
    J = problem.linearised(state, problem.target.levels - 1)[1].block[:, free]
    values, vectors = np.linalg.eigh(J.T @ J + 1e-4 * problem.target.weight * np.eye(len(free)))
    directions = np.zeros((len(free), len(problem.free(state))))
    directions[:, free] = vectors.T
    for size in sizes:
        for _ in range(rounds):
            before = loss
            for direction, value in zip(directions, values, strict=True):
                step = direction * np.clip(size * np.sqrt(problem.target.weight / value), 0, 0.1)
                for trial in (problem.moved(state, step), problem.moved(state, -step)):
                    if (lower := problem.loss(trial)) < loss:
                        state, loss = trial, lower
                        break
            if loss in (0, before):
                break
    return state
