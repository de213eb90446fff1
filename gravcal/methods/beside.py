"""One computation beside another on a second core: in a fork, which has everything in memory and sends its result."""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import os
import warnings
from collections.abc import Callable, Iterator


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
    fork, receiver = _forked(function, arguments) if _spare() else (None, None)
    if fork is None:
        yield here
        return
    try:
        yield functools.cache(functools.partial(_received, receiver, here))
    finally:
        receiver.close()
        fork.kill()  # not asked to end: it has the signal handlers of this process
        fork.join()


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


def _spare():
    """Whether a second core is this process's own."""
    allowed = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else ()
    return len(allowed) > 1 and not multiprocessing.current_process().daemon


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
