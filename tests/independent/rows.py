"""Plain reading of the files, and the settings that the tests share."""

from pathlib import Path

import numpy as np

SHORT = {"manoeuvres": [("pitch", "high")], "window_s": (20.0, 20.0), "keep_scenes": True}
EXACT = SHORT | {"noise_scale": 0.0, "quantise": False}


def table(truth, product):
    """All columns of a file that are numbers, by plain numpy."""
    body = Path(truth["files"][product]).read_text().split("# End of YAML header\n")[1]
    rows = [line.split() for line in body.splitlines()]
    return np.array([[float(x) if x[-1] in "0123456789" else np.nan for x in row] for row in rows])
