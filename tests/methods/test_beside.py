"""A computation beside another, in a fork."""

import os
import signal

import numpy as np
import pytest

from gravcal.methods import beside as module
from gravcal.methods.beside import beside, each


@pytest.fixture
def two_cores(monkeypatch):
    """A second core, whatever this machine has."""
    monkeypatch.setattr(module, "_cores", lambda: 2)


def told(values):
    """Process that computes, and a sum."""
    return os.getpid(), float(np.sum(values))


def test_the_result_comes_from_another_process(two_cores):
    """Contract: computed in a fork, asked for twice and computed once."""
    with beside(told, np.arange(10.0)) as result:
        process, total = result()
        assert process != os.getpid()
        assert total == 45.0
        assert result() == (process, total)


def test_without_a_second_core_it_is_computed_here(monkeypatch):
    """Contract: a worker among many does not fork."""
    monkeypatch.setattr(module, "_cores", lambda: 1)
    with beside(told, np.arange(10.0)) as result:
        assert result() == (os.getpid(), 45.0)


def test_an_error_comes_where_the_result_is_asked_for(two_cores):
    """Contract: as if it had been called there."""
    with beside(np.linalg.inv, np.zeros((2, 2))) as result, pytest.raises(np.linalg.LinAlgError):
        result()


def test_a_fork_that_is_killed_costs_time_only(two_cores):
    """Contract: nothing is lost, the caller computes it himself."""
    here = os.getpid()

    def killed():
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return 7

    with beside(killed) as result:
        assert result() == 7


def test_without_memory_for_a_fork_it_is_computed_here(two_cores, monkeypatch):
    """Contract: a machine that refuses to fork gets its result all the same."""

    def refused():
        raise BlockingIOError("no more processes")

    monkeypatch.setattr(os, "fork", refused)
    with beside(told, np.arange(10.0)) as result:
        assert result() == (os.getpid(), 45.0)


def test_a_block_that_fails_leaves_no_process(two_cores):
    """Contract: the fork ends with the block."""
    import multiprocessing
    import time

    with pytest.raises(ValueError, match="wanted"), beside(time.sleep, 60):
        raise ValueError("wanted")
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("cores", [1, 2])
def test_each_gives_the_results_in_order(monkeypatch, cores):
    """Contract: as a plain loop, on one core or on two, of one item, of none and of two a call."""
    monkeypatch.setattr(module, "_cores", lambda: cores)
    numbers = list(range(50))
    assert each(lambda a, b: 10 * a + b, numbers, numbers) == [11 * n for n in numbers]
    assert each(str, [7]) == ["7"]
    assert each(str, []) == []


def test_an_error_in_each_comes_to_the_caller(two_cores):
    """Contract: as of a plain loop."""
    with pytest.raises(np.linalg.LinAlgError):
        each(np.linalg.inv, [np.eye(2), np.zeros((2, 2))])
    with pytest.raises(ValueError, match="shorter"):
        each(divmod, [1, 2], [3])


def test_a_fork_does_not_start_threads(two_cores, monkeypatch):
    """Contract: it is one of two already."""
    monkeypatch.undo()
    with beside(module._cores) as count:
        assert count() == 1
