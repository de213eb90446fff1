"""Computations beside each other where a process has more than one core to itself: in a fork, or in threads."""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import os
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor


@contextlib.contextmanager
def beside(function: Callable, *arguments) -> Iterator[Callable]:
    """Compute a function in a fork while the block goes on; what it yields waits for the result.

    Where there is no second core, or this process is itself one of many workers, the function is computed when its
    result is asked for; so it is if the fork dies. Errors come as if it had been called there.

    Parameters
    ----------
    function, arguments : what is computed; its result is pickled, the arguments are not

    Yields
    ------
    result : function without arguments
    """
    here = functools.cache(functools.partial(function, *arguments))
    fork, receiver = _forked(function, arguments) if _cores() > 1 else (None, None)
    if fork is None:
        yield here
        return
    try:
        yield functools.cache(functools.partial(_received, receiver, here))
    finally:
        receiver.close()
        fork.kill()  # not asked to end: it has the signal handlers of this process
        fork.join()


def each(function: Callable, *items: Iterable) -> list:
    """Results of a function of one item after the other, on all cores that this process has to itself.

    For functions that spend their time in numpy or compiled kernels, which leave the interpreter free. What they return
    is the same as of a plain loop, to the last bit and in the same order.

    Parameters
    ----------
    function : of one of each of the items
    items : of equal length
    """
    rows = list(zip(*items, strict=True))
    count = min(len(rows), _cores())
    if count < 2:
        return [function(*row) for row in rows]
    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(function, *zip(*rows, strict=True)))


def _forked(function, arguments):
    """Process that computes the function, and the end of the pipe for its result; none where a fork is refused."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    fork = context.Process(target=_send, args=(sender, receiver, function, arguments), daemon=True)
    with sender, warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads: it only computes
        try:
            fork.start()
        except OSError:
            receiver.close()
            return None, None
    return fork, receiver


def _cores():
    """Number of cores that are this process's own: one where it is one of many workers, or is itself a fork."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return 1 if multiprocessing.current_process().daemon else max(len(allowed), 1)


def _send(sender, receiver, function, arguments):
    """In the fork: the result, or nothing where there is none; the caller then computes it himself."""
    receiver.close()
    with contextlib.suppress(Exception):
        sender.send(function(*arguments))


def _received(receiver, here):
    """Result of the fork, or of this process where it sent none."""
    try:
        return receiver.recv()
    except (EOFError, OSError):
        return here()
