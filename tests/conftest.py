"""Fixtures that many tests share."""

import os

# Before torch loads: threads that spin while they wait starve the other core on small machines.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pytest

import procmodels


@pytest.fixture
def rng():
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def chair():
    return procmodels.load("paper/chair")
