"""Sequence-of-events file (TN-01; format TN-03), and vectors in the two forms of the missions: its lines, VCM1B files.

Fields of a line, split by blanks: GPS seconds, spacecraft, name, number of values, values, comment. A first field "x"
deletes a line; a value holds until the next line of its name. GRACE Level 1B Data Product User Handbook v1.3, section
4.8; CMCAL and KBRCAL (1 begin, 0 end) as groops, GraceSequenceOfEvents, reads them.

VCM is the centre of mass in SRF. Its origin is the centre of the proof mass, so the vector is proof mass to CoM.
"""

import functools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gravcal.errors import ProductError, refuse
from gravcal.io.writers import header_lines, label_header

SPACECRAFT = {f"GRACE{letter}": letter for letter in "ABCD"}
EXPECTED = "time GRACEC VCM 3 x y z comment"
LATEST_S = 6e10  # s, of a time, on either side: the calendar begins and ends beyond
CALIBRATIONS = {"CMCAL": "com_offset", "KBRCAL": "kbr_phase_centre"}  # events that bound manoeuvres: 1 begin, 0 end


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
    """Line turned into a comment, which `read_line` refuses, for values of an origin other than measured."""
    return f"# {origin.upper()} data, no line for the sequence-of-events file: {line}"


@dataclass(frozen=True)
class Entry:
    """One line of the sequence-of-events file: GPS seconds, letter, name, values, comment."""

    time: float
    satellite: str
    name: str
    values: tuple[float, ...]
    comment: str = ""


@dataclass(frozen=True)
class Session:
    """Calibration session of a satellite from start to stop, GPS seconds; None where the file has no such line."""

    calibration: str
    satellite: str
    start: float | None
    stop: float | None
    comment: str = ""


def read_line(line):
    """Entry of a line, None for a deleted line (first field ``x``); refused if it has another form."""
    fields = line.split(maxsplit=4)
    if fields and fields[0] == "x":
        return None
    where = f"sequence-of-events line {line.strip()!r}"
    wrong = functools.partial(refuse, where, expected=EXPECTED, remedy="Correct the line.")
    if len(fields) < 4 or fields[1] not in SPACECRAFT:
        wrong(f"{len(fields)} fields")
    try:
        time, spacecraft, name, count = float(fields[0]), *fields[1:3], int(fields[3])
        rest = "".join(fields[4:]).split(maxsplit=max(count, 0))
        values = tuple(float(one) for one in rest[:count])
    except (ValueError, OverflowError) as error:
        wrong(str(error))
    if len(values) != count or not np.all(np.isfinite([time, *values])):
        wrong(f"{len(values)} values")
    if abs(time) > LATEST_S:
        wrong(f"a time of {time:g} s")
    return Entry(time, SPACECRAFT[spacecraft], name, values, "".join(rest[count:]).strip())


def read_sequence(path):
    """Entries of a sequence-of-events file in the order of time; deleted, empty and # lines are left out."""
    entries = []
    for number, line in enumerate(Path(path).read_text(encoding="latin-1").splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                entries.append(read_line(line))
            except ProductError as error:
                raise ProductError(f"{path}, line {number}: {error}") from None
    return sorted((entry for entry in entries if entry is not None), key=lambda entry: entry.time)


def sessions(entries):
    """[Session], by time, between the CMCAL and KBRCAL lines (1 begin, 0 end) of entries; also without begin or end."""
    calibrations, begun = [], {}
    for one in entries:
        if one.name not in CALIBRATIONS or len(one.values) != 1:
            continue
        key, whose = (one.name, one.satellite), (CALIBRATIONS[one.name], one.satellite)
        if begun.get(key) and one.values[0]:
            calibrations.append(Session(*whose, begun[key].time, None, begun[key].comment))
        if one.values[0]:
            begun[key] = one
            continue
        first = begun.pop(key, None)
        calibrations.append(Session(*whose, first and first.time, one.time, first.comment if first else one.comment))
    unended = [Session(CALIBRATIONS[n], letter, e.time, None, e.comment) for (n, letter), e in begun.items() if e]
    return sorted(calibrations + unended, key=lambda one: (one.stop if one.start is None else one.start, one.satellite))


def in_force(entries, name, satellite, time):
    """Entry of this name and satellite that holds at a GPS second, None before the first."""
    fits = [e for e in entries if (e.name, e.satellite) == (name, satellite) and e.time <= time]
    return fits[-1] if fits else None


def vector_file(name, time, satellite, vector_b, source=""):
    """Text of a vector file with the 80-column header of VKB1B; the name is its own, ``VCM1B_2020-02-01_C_04.txt``.

    Vectors (n, 3) m in SRF hold from whole GPS seconds (n,) on; the source stands in the header.

    Notes
    -----
    A record holds length and direction cosines, vector = mag * (cosx, cosy, cosz); formats of VKB1B, release 04.
    """
    path, times = Path(name), np.atleast_1d(time)
    vectors = _checked(np.atleast_2d(vector_b), path, shape=(len(times), 3))
    if np.any(times != np.rint(times)):
        refuse(path, "times with fractions", "whole GPS seconds", "Round the time from which the vector holds.")
    body = ""
    for t, vector in zip(times, vectors, strict=True):
        length = float(np.linalg.norm(vector))
        cosines = " ".join(repr(float(item)) for item in (vector / length if length > 0 else vector))
        body += f"{int(t)} {satellite} {length!r} {cosines} 00000000\n"
    about = header_lines("vectors", satellite=satellite, path=path, source=source)
    return label_header("ipXXXVOF : 9", times.astype(np.int64) * 10**9, len(body), about) + body


def _checked(vector, where, shape=(3,)):
    """Floats of a shape, a list if that has one dimension, else an array; refused if one is not finite or None."""
    array = np.array([np.nan if item is None else item for item in np.ravel(vector)], dtype=float)
    if array.size != np.prod(shape) or not np.all(np.isfinite(array)):
        numbers = ", ".join(f"{item:g}" for item in array)
        refuse(where, f"({numbers})", f"finite numbers of shape {shape}", "Write determined vectors only.")
    return array.tolist() if len(shape) == 1 else array.reshape(shape)
