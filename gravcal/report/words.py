"""Numbers of a report as people read them."""

NOT_DETERMINED = "–"


def signed(value, digits):
    """Number with a true minus sign; zero without one.

    Parameters
    ----------
    value : float
    digits : after the point
    """
    text = f"{value:.{digits}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


def plus_minus(value, sigma, total=None, digits=None):
    """Value with its error, and the total error in brackets; digits by the error unless given.

    Parameters
    ----------
    value, sigma, total : float or None
    digits : after the point, or None
    """
    if value is None or sigma is None:
        return NOT_DETERMINED
    digits = _digits(sigma) if digits is None else digits
    tail = f" ({total:.{digits}f})" if total is not None else ""
    return f"{signed(value, digits)} ± {sigma:.{digits}f}{tail}"


def _digits(sigma):
    """Two digits of the error, three at most after the point."""
    return 1 if sigma >= 1 else 2 if sigma >= 0.1 else 3


def printed(record, index):
    """Printed value and error of one component as in print.

    Parameters
    ----------
    record : Published or None
    index : of the component
    """
    if record is None or record.value[index] is None:
        return NOT_DETERMINED
    sigma = record.sigma[index]
    return f"{signed(record.value[index], 1)} ± {sigma:.{1 if sigma >= 0.1 else 2}f}"


def probability(value):
    """Probability with two digits.

    Parameters
    ----------
    value : float or None
    """
    if value is None:
        return NOT_DETERMINED
    return f"{value:.2f}" if value >= 0.095 else f"{value:.3f}" if value >= 0.001 else "< 0.001"


def chi_square(test, with_probability=True):
    """Chi-square over its degrees of freedom.

    Parameters
    ----------
    test : {"chi2", "dof", "p"}
    with_probability : bool
    """
    if test["chi2"] is None:
        return NOT_DETERMINED
    text = f"{test['chi2']:.1f} / {test['dof']}"
    return f"{text}, {probability(test['p'])}" if with_probability else text
