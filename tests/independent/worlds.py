"""Cases of the independent forward models beside the project, where they are at hand."""

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[3] / "shared" / "worlds"
FIELDS = FOLDER / "fields"


def make(kind, seed, folder):
    """Folder of a case with "data" and truth; skips where the models are not at hand.

    Parameters
    ----------
    kind : "com", "kbr", "swing", "roll" or "sgrs"
    seed : int
    folder : where the case is made
    """
    script = FOLDER / "open" / "make_case.py"
    if not script.exists():
        pytest.skip("the independent forward models are not at hand")
    made = Path(folder) / f"{kind}{seed}"
    subprocess.run([sys.executable, script, kind, "--seed", str(seed), "--out", made], check=True, capture_output=True)
    return made
