"""One function of many items on the cores of a process."""

import os

import numpy as np
import pytest

from gravcal.discovery.problem import parallel


@pytest.mark.parametrize("cores", [1, 2])
def test_parallel_gives_the_results_in_order(monkeypatch, cores):
    """Contract: as a plain loop, on one core or on two, of one item, of none and of two a call."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(cores))
    numbers = list(range(50))
    assert parallel(lambda a, b: 10 * a + b, numbers, numbers) == [11 * n for n in numbers]
    assert parallel(str, [7]) == ["7"]
    assert parallel(str, []) == []


def test_an_error_comes_to_the_caller(monkeypatch):
    """Contract: as of a plain loop."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: range(2))
    with pytest.raises(np.linalg.LinAlgError):
        parallel(np.linalg.inv, [np.eye(2), np.zeros((2, 2))])
    with pytest.raises(ValueError, match="shorter"):
        parallel(divmod, [1, 2], [3])
