"""One process that calibrates one folder, twice in two empty stores, and prints as JSON where the time went.

`python -m benchmarks.whole_day FOLDER`: the first time modules and compiled kernels are loaded on the way, the second
time they are there.
"""

from __future__ import annotations

import itertools
import json
import os
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    """Print a document with both runs."""
    from flows import com_offset, engine
    from gravcal import catalog
    from gravcal.store import memory

    folder, runs = Path(sys.argv[1]), []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as store:
            os.environ["GRAVCAL_PRODUCTS"] = store
            memory.clear()
            runs.append(_timed(engine, com_offset, catalog.parameters("com_offset"), folder))
    sys.stdout.write(json.dumps(runs) + "\n")


def _timed(engine, com_offset, chosen, folder):
    """Seconds of each stage, by the clock on the wall and of the processor; a stage ends when it is announced."""
    seen = []

    def note(name):
        seen.append((name, time.perf_counter(), time.process_time()))

    note("")
    engine.plan(com_offset.calibrate, com_offset.CALIBRATION.source(data=folder), chosen)
    note("plan")
    with engine.stage.using(engine.stage.inline, lambda call, _state, _ref: note(call.unmade.stage)):
        com_offset.calibrate(com_offset.CALIBRATION.source(data=folder), chosen)
    return [[b[0], b[1] - a[1], b[2] - a[2]] for a, b in itertools.pairwise(seen)]


if __name__ == "__main__":
    main()
