"""TLT files: angle of the turntable and reading of the tilt meter, one file a day."""

import re
from pathlib import Path

import numpy as np

from gravcal.errors import ProductError
from gravcal.io.archive import LevelOneFile

NAME = re.compile(r"(?P<product>TLT)_(?P<date>\d{4}-\d{2}-\d{2})_(?P<satellite>P)_(?P<release>\d{2})\.txt")
HEADER = "software_version: gravcal simulation\n# End of YAML header\n"


def inventory(folder):
    """All TLT files below a folder."""
    matches = [(path, NAME.fullmatch(path.name)) for path in sorted(Path(folder).rglob("TLT_*.txt"))]
    return [LevelOneFile(path, None, **match.groupdict()) for path, match in matches if match]


def read(file):
    """Time s, angle rad and reading rad, (n,) each."""
    text = file.path.read_text().partition("# End of YAML header\n")[2]
    columns = np.array([line.split() for line in text.splitlines()], dtype=float)
    if columns.ndim != 2 or columns.shape[1] != 3:
        raise ProductError(f"{file.path}: found {columns.shape} numbers, expected three columns. Fetch it again.")
    return columns.T


def write(folder, date, columns):
    """Write the file of an invented day."""
    lines = "\n".join(" ".join(map(repr, row)) for row in np.transpose(columns).tolist())
    (folder / f"TLT_{date}_P_01.txt").write_text(f"{HEADER}{lines}\n")
