"""Fixtures that every room's tests may use."""

import numpy as np
import pytest

from tests.robots import published_robot


@pytest.fixture
def rng():
    return np.random.default_rng(20)


@pytest.fixture(scope="session")
def robot():
    """The paper's robot with Eqs. (28) and (29)."""
    return published_robot()
