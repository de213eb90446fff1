"""One process that calibrates one folder, twice in two empty stores, and prints as JSON where the time went.

`python -m benchmarks.whole_day FOLDER`: the first time modules and compiled kernels are loaded on the way, the second
time they are there.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from pathlib import Path


def main() -> None:
    """Print a document with both runs."""
    from flows import com_offset, engine
    from gravcal.data import catalog, memory

    folder, runs = Path(sys.argv[1]), []
    for _ in range(2):
        with tempfile.TemporaryDirectory() as store:
            os.environ["GRAVCAL_PRODUCTS"] = store
            memory.clear()
            runs.append(_timed(engine, com_offset, catalog.parameters("com_offset"), folder))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024**2
    sys.stdout.write(json.dumps({"runs": runs, "peak_gib": peak}) + "\n")


def _timed(engine, com_offset, chosen, folder):
    """Seconds of a run: in all, of the processor, and of each stage; a stage ends when its product is announced."""
    stages, last = [], [0.0]

    def listen(call, _state, _ref):
        now = time.perf_counter()
        stages.append([call.unmade.stage, now - last[0]])
        last[0] = now

    processor, start = time.process_time(), time.perf_counter()
    steps, _ = engine.plan(com_offset.calibrate, com_offset.source(data=folder), chosen)
    last[0] = time.perf_counter()
    planned = last[0] - start
    source = com_offset.source(data=folder)
    with engine.stage.using(engine.stage.inline, listen):
        com_offset.calibrate(source, chosen)
    total = time.perf_counter() - start
    return {"total": total, "cpu": time.process_time() - processor, "plan": planned, "stages": stages}


if __name__ == "__main__":
    main()
