"""Run an invented pipeline in a process of its own and say what was made."""

import importlib
import json
import sys
from pathlib import Path


def main(arguments):
    """Run the flow of the named package on a file."""
    name, raw = arguments
    from gravcal.io.archive import LevelOneFile
    from tasks.stage import inline, using

    made = []
    chosen = {"event": "fake-1", "count": 4, "offset": 0.0, "gain_one": 1.0, "gain_other": 3.0}
    flow = importlib.import_module(f"{name}.flow")
    with using(inline, lambda call, state, _: made.append(call.unmade.stage) if state == "made" else None):
        ref = flow.calibrate(LevelOneFile(Path(raw), None, "MAG1B", "C", "2020-02-01", "04"), chosen)
    sys.stdout.write(json.dumps({"made": made, "key": ref.key, "digest": ref.digest}))
