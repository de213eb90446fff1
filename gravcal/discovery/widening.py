"""What the calibration parameters become when every named cause is free with all its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gravcal.discovery import attribution
from gravcal.discovery.problem import baseline_of
from gravcal.discovery.rounds import Result


def widened(result: Result) -> Result:
    """Result whose calibration parameters and covariance after the extension leave named causes all their parameters.

    A cause is often named by one of its parameters; the others move the calibration too, and what the data say of them
    is part of the error.

    Parameters
    ----------
    result : Result
    """
    problem, width = result.problem, result.shared[1].size
    fixed = baseline_of(problem, [_widest(problem, one.index) for one in result.findings])
    total = problem.gram.sum(axis=0)
    covariance = attribution.inverse_of(total[np.ix_(fixed, fixed)])
    value, covariance = (covariance @ total[fixed, 0])[:width], covariance[:width, :width]
    ends = {"shared": value, "sigma": np.sqrt(np.diag(covariance)), "covariance": covariance}
    return replace(result, **{name: (getattr(result, name)[0], after) for name, after in ends.items()})


def _widest(problem, index):
    """Form of a cause that holds the parameters of one of its forms and most beside them."""
    mine = problem.candidates[index]
    forms = [k for k, c in enumerate(problem.candidates) if (c.cause, c.local) == (mine.cause, mine.local)]
    forms = [k for k in forms if mine.listed and set(mine.names) < set(problem.candidates[k].names)]
    return max(forms, key=lambda k: len(problem.candidates[k].names), default=index)
