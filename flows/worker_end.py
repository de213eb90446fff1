"""How the worker processes of an embedded cluster end: at once, when Dask has closed them."""

import atexit
import os

from distributed import WorkerPlugin


class EndAtOnce(WorkerPlugin):
    """Leaves memory to the kernel: to tidy up libraries and kept arrays object by object takes a second."""

    def setup(self, worker):  # noqa: ARG002 - as Dask calls it
        """Ask for it in the worker process."""
        atexit.register(os._exit, 0)
