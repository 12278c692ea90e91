"""Muon (Jordan et al. 2024): momentum whose matrix updates are orthogonalised, so that every direction learns.

Measured on the table, 3 minutes of one core each: discrete parameters right 96 % against 51 % with AdamW, Task 1 2.2 %
against 3.0 %. The losses of a grid and of a parameter differ by orders of magnitude; AdamW follows the loud directions
of a layer, an orthogonalised update moves along all of them alike.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

# Coefficients of the quintic iteration that takes singular values from (0, 1] to about 1 in five steps (the authors').
_A, _B, _C = 3.4445, -4.7750, 2.0315
_ITERATIONS = 5


# From this ratio of its sides on, a matrix is orthogonalised through the Gram matrix of its short side.
_LONG = 3


def orthogonalised(matrix: Tensor) -> Tensor:
    """(m, n) with the same singular vectors and singular values of about 1 (0.7 to 1.2)."""
    tall = matrix.shape[0] > matrix.shape[1]
    x = matrix.T if tall else matrix
    x = _of_long(x.float()) if x.shape[1] >= _LONG * x.shape[0] else _of_square(x.bfloat16())
    return x.T if tall else x


def _of_square(x: Tensor) -> Tensor:
    x = x / (x.norm() + 1e-7)
    for _ in range(_ITERATIONS):
        gram = x @ x.T
        x = _A * x + (_B * gram + _C * gram @ gram) @ x
    return x


def _of_long(x: Tensor) -> Tensor:
    """The same iterations on x (m, n), collected in one (m, m) factor: 128 x 12288 takes 6 ms instead of 38.

    Every iteration multiplies x by a polynomial of x x^T, so that x need only be touched twice. In float32: a Gram
    matrix squares the singular values, and rounded ones of a matrix of low rank turn negative and grow.
    """
    x = x / (x.norm() + 1e-7)
    gram = x @ x.T
    product = factor = _factor(gram)
    for _ in range(_ITERATIONS - 1):
        gram = factor @ gram @ factor
        factor = _factor(gram)
        product = factor @ product
    return product @ x


def _factor(gram: Tensor) -> Tensor:
    """(m, m) that one iteration multiplies x by, x x^T being `gram`."""
    factor = torch.addmm(gram, gram, gram, beta=_B, alpha=_C)
    factor.diagonal().add_(_A)
    return factor


class Muon(torch.optim.Optimizer):
    """Muon for matrices and convolutions (seen as out x rest), Adam for biases; one learning rate for both.

    A matrix moves by MATRIX_RATE times the learning rate, since its update has unit singular values.
    """

    MATRIX_RATE = 10.0
    MOMENTUM = 0.95
    BETAS = (0.9, 0.99)

    def __init__(self, parameters: Iterable[Tensor], lr: float = 2e-3) -> None:
        super().__init__(parameters, {"lr": lr})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """One update from the gradients."""
        for group in self.param_groups:
            for parameter in group["params"]:
                if parameter.grad is not None:
                    update = self._matrix_step if parameter.ndim > 1 else self._adam_step
                    update(parameter, parameter.grad, group["lr"])

    def _matrix_step(self, parameter: Tensor, grad: Tensor, lr: float) -> None:
        state = self.state[parameter]
        if not state:
            state["momentum"] = torch.zeros_like(parameter)
        state["momentum"].lerp_(grad, 1 - self.MOMENTUM)
        matrix = grad.lerp(state["momentum"], self.MOMENTUM).flatten(1)  # Nesterov
        scale = max(1.0, matrix.shape[0] / matrix.shape[1]) ** 0.5
        update = orthogonalised(matrix).reshape(parameter.shape).to(parameter.dtype)
        parameter.add_(update, alpha=-self.MATRIX_RATE * lr * scale)

    def _adam_step(self, parameter: Tensor, grad: Tensor, lr: float) -> None:
        state = self.state[parameter]
        if not state:
            state["step"] = torch.zeros(())
            state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
        state["step"] += 1
        (b1, b2), count = self.BETAS, float(state["step"])
        state["exp_avg"].lerp_(grad, 1 - b1)
        state["exp_avg_sq"].lerp_(grad.square(), 1 - b2)
        spread = (state["exp_avg_sq"] / (1 - b2**count)).sqrt_().add_(1e-8)
        parameter.addcdiv_(state["exp_avg"], spread, value=-lr / (1 - b1**count))
