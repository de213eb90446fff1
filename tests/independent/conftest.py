"""A small event that the tests of this folder share, and plain reading of the files."""

from pathlib import Path

import numpy as np
import pytest

from . import make_event


def table(truth, product):
    """All columns of a file that are numbers, by plain numpy."""
    body = Path(truth["files"][product]).read_text().split("# End of YAML header\n")[1]
    rows = [line.split() for line in body.splitlines()]
    return np.array([[float(x) if x[-1] in "0123456789" else np.nan for x in row] for row in rows])


@pytest.fixture(scope="session")
def event(tmp_path_factory):
    """One noisy pitch manoeuvre with short quiet times, and its states."""
    short = {"manoeuvres": [("pitch", "high")], "window_s": (20.0, 20.0), "keep_scenes": True}
    return make_event(tmp_path_factory.mktemp("event"), 11, **short)
