"""Gravity fields in the ICGEM format (.gfc), and GGM05S, which ships with the package.

Format: Barthelmes and Foerste 2011, The ICGEM-format. Time-variable models are taken at their reference epoch: the
static part of a `gfct` line is used, trends and periodic terms (`trnd`, `dot`, `acos`, `asin`) are left out.
"""

from contextlib import suppress
from pathlib import Path

import numpy as np
from scipy.special import gammaln

from gravcal.errors import refuse
from gravcal.physics.gravity import Field

SHIPPED = "GGM05S.gfc"  # Tapley et al. 2013, UT CSR: ten years of GRACE, degree 180, calibrated errors, zero tide
KEYS = {"earth_gravity_constant": "gm", "gravity_constant": "gm", "radius": "radius", "max_degree": "degree"}
TEXTS = {"norm": "norm", "modelname": "name", "errors": "errors"}
STATIC, VARIABLE = ("gfc", "gfct"), ("trnd", "dot", "acos", "asin")


def shipped() -> Path:
    """Path of GGM05S, the field that ships with the package."""
    return Path(__file__).with_name(SHIPPED)


def located(name: str) -> Path:
    """Path of a gravity field: of a .gfc file, or of the one that ships by its name "GGM05S"."""
    path = shipped() if name in (SHIPPED, Path(SHIPPED).stem) else Path(name).expanduser()
    if not path.is_file():
        refuse(f"gravity field {name}", "no such file", "a .gfc file, or GGM05S", "Give the path of the file.")
    return path


def read_field(path: Path, highest: int | None = None) -> Field:
    """Field, fully normalised, from a .gfc file, up to its highest degree or, if lower, to ``highest``."""
    path = Path(path)
    lines = path.read_text(encoding="latin-1").splitlines()
    head, first = _head(lines, path)
    degree = head["degree"] if highest is None else min(highest, head["degree"])
    coefficients = np.zeros((4, degree + 1, degree + 1))
    listed = np.zeros((degree + 1, degree + 1), dtype=bool)
    for number, line in enumerate(lines[first:], first + 1):
        words = line.split()
        if not words or words[0] in VARIABLE:
            continue
        where = f"{path.name}, line {number}"
        if words[0] not in STATIC or len(words) < 5:
            refuse(where, f"{' '.join(words)[:40]!r}", "gfc, degree, order, C, S", "Remove or repair the line.")
        n, m = (int(_number(word, where)) for word in words[1:3])
        if not 0 <= m <= n <= head["degree"]:
            refuse(where, f"degree {n}, order {m}", f"0 <= order <= degree <= {head['degree']}", "Repair the line.")
        if n <= degree:
            values = [_number(word, where) for word in words[3 : 5 if head["errors"] == "no" else 7]]
            coefficients[: len(values), n, m] = values
            listed[n, m] = True
    if not listed[0, 0]:
        coefficients[0, 0, 0] = 1.0
    if head["norm"] == "unnormalized":
        n, m = np.arange(degree + 1)[:, None], np.arange(degree + 1)[None, :]
        ratio = gammaln(np.where(m <= n, n - m, 0) + 1) - gammaln(n + m + 1)
        coefficients = coefficients / np.where(m <= n, np.sqrt((2.0 - (m == 0)) * (2 * n + 1)) * np.exp(ratio / 2), 1.0)
    return Field(head["gm"], head["radius"], *coefficients, name=head["name"] or path.stem)


def _head(lines, path):
    """({"gm" m3 s-2, "radius" m, "degree", "norm", "name"}, index of the first line after the head)."""
    head = {"norm": "fully_normalized", "name": "", "errors": ""}
    for index, line in enumerate(lines):
        words = line.split()
        if words and words[0] == "end_of_head":
            missing = [key for key in ("gm", "radius", "degree") if key not in head]
            if missing:
                refuse(f"{path.name}, head", f"no {', '.join(missing)}", "gm, radius and degree", "Get the whole file.")
            return head, index + 1
        if len(words) > 1 and words[0] in KEYS:
            head[KEYS[words[0]]] = _number(words[1], f"{path.name}, line {index + 1}")
        elif len(words) > 1 and words[0] in TEXTS:
            head[TEXTS[words[0]]] = words[1]
        if "degree" in head:
            head["degree"] = int(head["degree"])
    return refuse(f"{path.name}", "no line end_of_head", "a head as in ICGEM files", "Is this a .gfc file?")


def _number(word, where):
    """Finite float of a word, whose exponent may be Fortran's D; ``where`` is for the message if it is none."""
    with suppress(ValueError):
        if np.isfinite(number := float(word.replace("D", "e").replace("d", "e"))):
            return number
    return refuse(where, f"{word!r}", "a finite number", "Repair the line.")
