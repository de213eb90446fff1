"""Plain values of a result document (null where not finite, never NaN), and numbers formatted for readers."""

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
    """Nested lists of an array (...), None in place of NaN and infinity."""
    return as_plain(np.asarray(values, dtype=float).tolist())


def estimate(value, sigma):
    """{"value", "sigma"} of scalars or (3,); both null unless both are known."""
    value, sigma = np.asarray(value, dtype=float), np.asarray(sigma, dtype=float)
    known = np.isfinite(value) & np.isfinite(sigma)
    return {"value": numbers(np.where(known, value, np.nan)), "sigma": numbers(np.where(known, sigma, np.nan))}


def offset_block(offset, covariance, determined, name="offset", unit="um"):
    """{name_unit, sigma_unit, covariance_unit2} of a vector (3,) m, covariance (3, 3) m2; undetermined ones None."""
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
    """{"chi2", "dof", "p": probability of a larger chi-square}; None, 0, None where it cannot be tested."""
    chi2, dof = number(chi2), int(dof)
    if chi2 is None or dof <= 0:
        return {"chi2": None, "dof": 0, "p": None}
    return {"chi2": max(chi2, 0.0), "dof": dof, "p": float(chdtrc(dof, max(chi2, 0.0)))}


def as_plain(value):
    """Value as JSON types: dict, list, int, float (None if not finite), None; anything else as text."""
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
    """CSV text of heads and rows; None is an empty cell."""
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
    """Text of a number with a true minus sign, zero without; NOT_DETERMINED for None."""
    if value is None:
        return NOT_DETERMINED
    return f"{value:z.{digits}f}".replace("-", "−")


def plus_minus(value, sigma, total=None, digits=None):
    """Text "value ± sigma (total sigma)"; decimals by sigma unless stated."""
    if value is None or sigma is None:
        return NOT_DETERMINED
    if digits is None:
        digits = 1 if sigma >= 1 else 2 if sigma >= 0.1 else max(3, 1 - math.floor(math.log10(sigma or 1)))
    tail = f" ({total:.{digits}f})" if total is not None else ""
    return f"{signed(value, digits)} ± {sigma:.{digits}f}{tail}"


def both(estimate, digits=None, index=None):
    """Text "value ± sigma" of {"value", "sigma"}, both numbers or (index set) vectors."""
    value, sigma = (estimate[key] if index is None else estimate[key][index] for key in ("value", "sigma"))
    return plus_minus(value, sigma, digits=digits)


def scientific(value, digits=2):
    """Text of a number with a power of ten; NOT_DETERMINED for None."""
    return NOT_DETERMINED if value is None else f"{value:.{digits}e}"


def printed(record, index):
    """Text "value ± sigma" of one component of a Published record, with printed digits; record may be None."""
    if record is None or record.value[index] is None:
        return NOT_DETERMINED
    sigma = record.sigma[index]
    return f"{signed(record.value[index], 1)} ± {sigma:.{1 if sigma >= 0.1 else 2}f}"


def probability(value):
    """Text of a probability: two decimals, three below 0.095, "< 0.001"; NOT_DETERMINED for None."""
    if value is None:
        return NOT_DETERMINED
    return f"{value:.2f}" if value >= 0.095 else f"{value:.3f}" if value >= 0.001 else "< 0.001"


def chi_square(test, with_probability=True):
    """Text "chi-square / degrees of freedom, p" of a `chi_square_test`."""
    if test["chi2"] is None:
        return NOT_DETERMINED
    text = f"{test['chi2']:.1f} / {test['dof']}"
    return f"{text}, {probability(test['p'])}" if with_probability else text


SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k"}
PREFIXED = ("m", "rad", "T", "V", "N", "A", "s", "Hz", "F", "W")


def prefixed(size, unit):
    """(factor, text "nm s⁻²" or "%") from an SI unit ("m s-2", "1", "") to the prefixed unit that suits a size."""
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
    """Text of value and sigma in the unit that suits both, two digits of sigma: "2.00 ± 0.12 %"."""
    return " ".join(measured(value, sigma, unit)).rstrip()


def measured(value, sigma, unit):
    """("value ± sigma", unit) in the prefixed unit that suits both; NOT_DETERMINED for a value of None."""
    if value is None:
        return NOT_DETERMINED, unit
    factor, text = prefixed(max(abs(value), sigma or 0.0), unit)
    if not sigma:
        return f"{value * factor:.4g}".replace("-", "−"), text
    digits = decimals(sigma * factor)
    return f"{signed(value * factor, digits)} ± {sigma * factor:.{digits}f}", text


def decimals(sigma):
    """Number of decimals that shows two digits of an error, 1 for 0 or None."""
    return max(0, 1 - math.floor(math.log10(sigma))) if sigma else 1
