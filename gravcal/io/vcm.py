"""Results as vectors in the two forms of the missions: a line of the sequence-of-events file, a VCM1B or VKB1B file.

VCM is the centre of mass in SRF. Its origin is the centre of the proof mass, so the vector is proof mass to CoM.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gravcal.errors import refuse
from gravcal.io.readers import read
from gravcal.io.writers import label_header

SPACECRAFT = {f"GRACE{letter}": letter for letter in "ABCD"}


@dataclass(frozen=True, eq=False)
class VectorRecord:
    """One vector in force from ``time`` on: GPS seconds, letter, name ("VCM", "VKB"), (3,) m in SRF, comment."""

    time: float
    satellite: str
    name: str
    vector_b: np.ndarray
    comment: str


def vector_line(time, satellite, vector_b, name="VCM", comment=""):
    """Line of the sequence-of-events file, ``time GRACEC VCM 3 x y z comment``, without its end.

    It holds from a GPS second on: for "VCM" proof mass to centre of mass, for "VKB" centre of mass to antenna phase
    centre, (3,) m in b with all digits. Fields are split by blanks; GRACE Level 1B Data Product User Handbook v1.3,
    section 4.8.
    """
    x, y, z = _checked(vector_b, f"{name} line of GRACE-{satellite}")
    spacecraft = f"GRACE{satellite}"
    if spacecraft not in SPACECRAFT:
        refuse(f"{name} line", f"satellite {satellite!r}", "one of A, B, C, D", "Give the letter of the satellite.")
    text = " ".join(comment.split())
    return f"{float(time)!r}  {spacecraft} {name}  3  {x!r}  {y!r}  {z!r}  {text}".rstrip()


def commented(line, origin):
    """A line as a comment, which `read_vector_line` refuses: its values were not measured."""
    return f"# {origin.upper()} data, no line for the sequence-of-events file: {line}"


def read_vector_line(line):
    """VectorRecord of a line of the sequence-of-events file, None for a deleted line (first field ``x``)."""
    fields = line.split(maxsplit=7)
    if fields and fields[0] == "x":
        return None
    where = f"sequence-of-events line {line.strip()!r}"
    if len(fields) < 7 or fields[3] != "3" or fields[1] not in SPACECRAFT:
        refuse(where, f"{len(fields)} fields", "time GRACEC VCM 3 x y z comment", "Correct the line.")
    try:
        time, vector = float(fields[0]), np.array([float(field) for field in fields[4:7]])
    except ValueError as error:
        refuse(where, str(error), "numbers for time, x, y, z", "Correct the line.")
    return VectorRecord(time, SPACECRAFT[fields[1]], fields[2], vector, "".join(fields[7:]).strip())


def write_vector_file(path, time, satellite, vector_b, source=""):
    """Vector file with the 80-column header of VKB1B; by its path, ``VCM1B_2020-02-01_C_04.txt``, the product is known.

    Vectors (n, 3) m in SRF hold from whole GPS seconds (n,) on; the source stands in the header.

    Notes
    -----
    A record holds length and direction cosines, vector = mag * (cosx, cosy, cosz); formats of VKB1B, release 04.
    """
    path, times = Path(path), np.atleast_1d(time)
    vectors = _checked(np.atleast_2d(vector_b), path, shape=(len(times), 3))
    if np.any(times != np.rint(times)):
        refuse(path, "times with fractions", "whole GPS seconds", "Round the time from which the vector holds.")
    body = ""
    for t, vector in zip(times, vectors, strict=True):
        length = float(np.linalg.norm(vector))
        cosines = " ".join(repr(float(item)) for item in (vector / length if length > 0 else vector))
        body += f"{int(t)} {satellite} {length!r} {cosines} 00000000\n"
    about = {
        "REFERENCE DOCUMENTATION": "vectors in SRF: length, direction cosines",
        "SATELLITE NAME": f"GRACE {satellite}",
        "SENSOR NAME": "Nodef",
        "FILENAME": path.name,
        "PROCESS LEVEL (1A OR 1B)": "VO",
        "INPUT FILE NAME": source,
    }
    header = label_header("ipXXXVOF : 9", times.astype(np.int64) * 10**9, len(body), about)
    path.write_text(header + body, encoding="ascii")
    return path


def read_vector_file(path):
    """Vectors of a VCM1B, VKB1B or like file: GPS seconds (n,) from which each holds, and (n, 3) m in SRF."""
    observed = read(Path(path))
    cosines = np.stack([observed[name].values for name in ("cosx", "cosy", "cosz")], axis=-1)
    return observed["time_tag"].values, observed["mag"].values[:, None] * cosines


def _checked(vector, where, shape=(3,)):
    """Finite floats of the right shape; what was not determined cannot be written here."""
    array = np.array([np.nan if item is None else item for item in np.ravel(vector)], dtype=float)
    if array.size != np.prod(shape) or not np.all(np.isfinite(array)):
        found = ", ".join(f"{item:g}" for item in array)
        refuse(where, f"({found})", f"finite numbers of shape {shape}", "Write determined vectors only.")
    return array.tolist() if len(shape) == 1 else array.reshape(shape)
