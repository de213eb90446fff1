"""The numbers that a result document hands on, the same for every calibration: for tables, time lines, comparisons."""

import itertools
import math
from dataclasses import dataclass

AXES = "xyz"


@dataclass(frozen=True)
class Value:
    """One number of a result document, null where it is not determined.

    Attributes
    ----------
    satellite : letter where the document is of several, otherwise ""
    name : such as "x", "offset x", "k z"
    unit : of all three
    value, sigma : with its error by noise
    sigma_total : with all errors; None where it is not known
    """

    satellite: str
    name: str
    unit: str
    value: float | None
    sigma: float | None
    sigma_total: float | None

    @property
    def label(self):
        """Name with the satellite."""
        return f"{self.satellite} {self.name}".strip()


def values(document):
    """Numbers of a document, [] where it has no result.

    Parameters
    ----------
    document : dict

    Returns
    -------
    values : list of Value
    """
    read = KINDS.get(document.get("calibration"))
    return list(read(document)) if read else []


def text(known):
    """Values with their total errors on one line: "x 107.0 +- 1.9, y 3.6 +- 0.9 um"."""
    said = [one for one in known if one.value is not None]
    parts = []
    for one, following in itertools.zip_longest(said, said[1:]):
        unit = "" if following and following.unit == one.unit else f" {one.unit}"
        parts.append(f"{one.label} {_rounded(one.value, one.sigma_total or one.sigma)}{unit}")
    return ", ".join(parts)


def _rounded(value, sigma):
    """Value with two digits of its error."""
    if not sigma:
        return f"{value:.3g}"
    if not 1e-3 <= sigma < 1e4:
        return f"{value:.5g} +- {sigma:.1e}"
    digits = max(0, 1 - math.floor(math.log10(sigma)))
    return f"{value:.{digits}f} +- {sigma:.{digits}f}"


def _vector(satellite, prefix, unit, block, names=("value", "sigma", "sigma_total")):
    """Values of the three axes of a block."""
    columns = [block.get(name) or [None] * 3 for name in names]
    for axis, *numbers in zip(AXES, *columns, strict=True):
        yield Value(satellite, f"{prefix} {axis}".strip(), unit, *numbers)


def _com_offset(document):
    """Adopted offset."""
    adopted = (document.get("variants") or {}).get((document.get("adopted") or {}).get("variant"))
    if adopted:
        yield from _vector("", "", "um", adopted, ("offset_um", "sigma_um", "sigma_total_um"))


def _kbr_phase_centre(document):
    """Adopted phase centre of each satellite."""
    for letter, block in ((document.get("adopted") or {}).get("satellites") or {}).items():
        yield from _vector(letter, "", "mm", block, ("phase_centre_mm", "sigma_mm", "sigma_total_mm"))


def _inertial_sensor(document):
    """Offset and scale factors from the swing, bias from the roll."""
    swing, roll = document.get("swing") or {}, document.get("roll") or {}
    found = swing.get("adopted") or swing.get("com_to_test_mass_um")  # documents of before have no solution adopted
    yield from _vector("", "offset", "um", found) if found else ()
    for name, unit in (("k", "m s-2 V-1"), ("beta", "rad s-2 V-1")):
        for axis, one in (swing.get(name) or {}).items():
            if one:
                yield Value("", f"{name} {axis}", unit, one["value"], one["sigma"], one.get("sigma_total"))
    yield from _vector("", "bias", "m s-2", roll["bias"]) if roll.get("bias") else ()


def _gradient_torque(document):
    """Total sigma of each solution for the drag, and its error where the truth is known."""
    for name, one in (document.get("drag") or {}).items():
        yield Value("", name.replace("_", " "), "m s-2", one.get("sigma_total_rms"), None, None)
        if one.get("rms_error") is not None:
            yield Value("", f"{name.replace('_', ' ')} error", "m s-2", one["rms_error"], None, None)


KINDS = {
    "com_offset": _com_offset,
    "kbr_phase_centre": _kbr_phase_centre,
    "inertial_sensor": _inertial_sensor,
    "gradient_torque": _gradient_torque,
}
