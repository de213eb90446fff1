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
    is part of the error. Where the data do not determine them all, the cause stays as it was named.

    Parameters
    ----------
    result : Result
    """
    problem, width = result.problem, result.shared[1].size
    total, named = problem.gram.sum(axis=0), [one.index for one in result.findings]
    for position, index in enumerate(named):
        others = baseline_of(problem, [*named[:position], *named[position + 1 :]])
        widest = _widest(problem, index)
        found = attribution.ratio(attribution.projected(total, others), problem.places[widest], problem.size)
        if found.determined.all():
            named[position] = widest
    fixed = baseline_of(problem, named)
    covariance = attribution.inverse_of(total[np.ix_(fixed, fixed)])
    value, covariance = (covariance @ total[fixed, 0])[:width], covariance[:width, :width]
    ends = {"shared": value, "sigma": np.sqrt(np.diag(covariance)), "covariance": covariance}
    return replace(result, **{name: (getattr(result, name)[0], after) for name, after in ends.items()})


def named_parameters(result: Result, position: int) -> dict:
    """Parameters of a finding in the form that was named, {name: {"value", "sigma", "unit"}}.

    Parameters
    ----------
    result : Result
    position : of the finding
    """
    problem, index = result.problem, result.findings[position].index
    others = baseline_of(problem, [f.index for k, f in enumerate(result.findings) if k != position])
    gram = attribution.projected(problem.gram.sum(axis=0), others)
    found = attribution.ratio(gram, problem.places[index], problem.size)
    entry, sigma = problem.candidates[index], np.sqrt(np.diag(found.covariance))
    rows = zip(entry.names, found.value.tolist(), sigma.tolist(), entry.units, found.determined, strict=True)
    return {n: {"value": v if d else np.nan, "sigma": s if d else np.nan, "unit": u} for n, v, s, u, d in rows}


def _widest(problem, index):
    """Form of a cause that holds the parameters of one of its forms and most beside them."""
    mine = problem.candidates[index]
    forms = [k for k, c in enumerate(problem.candidates) if (c.cause, c.local) == (mine.cause, mine.local)]
    forms = [k for k in forms if mine.listed and set(mine.names) < set(problem.candidates[k].names)]
    return max(forms, key=lambda k: len(problem.candidates[k].names), default=index)
