"""Plain values of a result document (what is not known becomes null, never NaN), and numbers as people read them."""

import csv
import datetime
import io
import math
import re

import numpy as np
from scipy.special import chdtrc

AXES = "xyz"
EPOCH = datetime.datetime(2000, 1, 1, 12)


def number(value):
    """Float of a scalar or an array of one element, None where it is not finite."""
    value = float(value)
    return value if math.isfinite(value) else None


def numbers(values):
    """Nested lists of an array (...) with None for what is not finite."""
    return as_plain(np.asarray(values, dtype=float).tolist())


def estimate(value, sigma):
    """{"value", "sigma"} of scalars or (3,); both null unless both are known."""
    value, sigma = np.asarray(value, dtype=float), np.asarray(sigma, dtype=float)
    known = np.isfinite(value) & np.isfinite(sigma)
    return {"value": numbers(np.where(known, value, np.nan)), "sigma": numbers(np.where(known, sigma, np.nan))}


def offset_block(offset, covariance, determined, name="offset", unit="um"):
    """Vector (3,) m with its covariance (3, 3) m2 in another unit; undetermined components are null everywhere."""
    factor = {"um": 1e6, "mm": 1e3}[unit]
    offset, matrix = (np.asarray(one, dtype=float) * factor**power for one, power in ((offset, 1), (covariance, 2)))
    variance = np.diag(matrix)
    known = np.asarray(determined, dtype=bool) & np.isfinite(offset) & np.isfinite(variance) & (variance >= 0)
    both = known[:, None] & known[None, :]
    matrix = np.where(both & np.isfinite(matrix), (matrix + matrix.T) / 2, np.nan)
    return {
        f"{name}_{unit}": numbers(np.where(known, offset, np.nan)),
        f"sigma_{unit}": numbers(np.sqrt(np.where(known, variance, np.nan))),
        f"covariance_{unit}2": numbers(matrix),
    }


def chi_square_test(chi2, dof):
    """Chi-square, its degrees of freedom, and the probability "p" of a larger one; null with dof 0 where untested."""
    chi2, dof = number(chi2), int(dof)
    if chi2 is None or dof <= 0:
        return {"chi2": None, "dof": 0, "p": None}
    return {"chi2": max(chi2, 0.0), "dof": dof, "p": float(chdtrc(dof, max(chi2, 0.0)))}


def as_plain(value):
    """Mappings, sequences and numbers as JSON has them; anything else as text."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): as_plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [as_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return as_plain(value.tolist())
    if isinstance(value, float):
        return number(value)
    return value if value is None or isinstance(value, int) else str(value)


def csv_text(heads, rows):
    """Table as the text of a CSV file; what is None is empty."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return text.getvalue()


def gps_text(seconds, digits=0):
    """Calendar form of GPS seconds past 2000-01-01 12:00:00, with digits of the fraction of a second."""
    scale = 10**digits
    whole, part = divmod(round(float(seconds) * scale), scale)
    text = (EPOCH + datetime.timedelta(seconds=whole)).strftime("%Y-%m-%d %H:%M:%S")
    return f"{text}.{part:0{digits}d}" if digits else text


NOT_DETERMINED = "–"


def signed(value, digits):
    """Number with a true minus sign; zero without one; what is None is not determined."""
    if value is None:
        return NOT_DETERMINED
    text = f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def plus_minus(value, sigma, total=None, digits=None):
    """Value with its error, and the total error in brackets; digits by the error unless given."""
    if value is None or sigma is None:
        return NOT_DETERMINED
    if digits is None:
        digits = 1 if sigma >= 1 else 2 if sigma >= 0.1 else 3
    tail = f" ({total:.{digits}f})" if total is not None else ""
    return f"{signed(value, digits)} ± {sigma:.{digits}f}{tail}"


def both(estimate, digits=None, index=None):
    """Value with its error of an {"value", "sigma"}, of one component of vectors."""
    value, sigma = (estimate[key] if index is None else estimate[key][index] for key in ("value", "sigma"))
    return plus_minus(value, sigma, digits=digits)


def scientific(value, digits=2):
    """Number with a power of ten; what is None is not determined."""
    return NOT_DETERMINED if value is None else f"{value:.{digits}e}"


def printed(record, index):
    """Printed value and error of one component as in print."""
    if record is None or record.value[index] is None:
        return NOT_DETERMINED
    sigma = record.sigma[index]
    return f"{signed(record.value[index], 1)} ± {sigma:.{1 if sigma >= 0.1 else 2}f}"


def probability(value):
    """Probability with two digits."""
    if value is None:
        return NOT_DETERMINED
    return f"{value:.2f}" if value >= 0.095 else f"{value:.3f}" if value >= 0.001 else "< 0.001"


def chi_square(test, with_probability=True):
    """Chi-square over its degrees of freedom."""
    if test["chi2"] is None:
        return NOT_DETERMINED
    text = f"{test['chi2']:.1f} / {test['dof']}"
    return f"{text}, {probability(test['p'])}" if with_probability else text


SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
PREFIXED = ("m", "rad", "T", "V", "N", "A", "s", "Hz", "F", "W")


def prefixed(size, unit):
    """Factor from an SI unit ("m s-2", "1", or empty) to the one that suits a size, and its text ("nm s⁻²", "%")."""
    power = 3 * math.floor(math.log10(size) / 3) if size > 0 and math.isfinite(size) else 0
    text = re.sub(r"-?\d+", lambda match: match[0].translate(SUPERSCRIPTS), "" if unit == "1" else unit)
    if unit == "1" and 1e-4 <= size < 10:
        return 100.0, "%"
    if unit.partition(" ")[0] in PREFIXED and power in PREFIXES:
        power = min(power, 0) if unit.partition(" ")[0] in ("s", "rad", "Hz", "V") else power
        return 10.0**-power, PREFIXES[power] + text
    if not unit or 1e-2 <= size < 1e4 or size == 0:
        return 1.0, text
    return 10.0**-power, f"×10{str(power).translate(SUPERSCRIPTS)} {text}".rstrip()


def quantity(value, sigma, unit):
    """Value with its error and a unit that suits both, two digits of the error: "2.00 ± 0.12 %"."""
    return " ".join(measured(value, sigma, unit)).rstrip()


def measured(value, sigma, unit):
    """Value with its error, and the unit that suits both."""
    if value is None:
        return NOT_DETERMINED, unit
    factor, text = prefixed(max(abs(value), sigma or 0.0), unit)
    if not sigma:
        return f"{value * factor:.4g}".replace("-", "−"), text
    digits = decimals(sigma * factor)
    return f"{signed(value * factor, digits)} ± {sigma * factor:.{digits}f}", text


def decimals(sigma):
    """Decimals that show two digits of an error."""
    return max(0, 1 - math.floor(math.log10(sigma))) if sigma else 1
