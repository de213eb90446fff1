"""How much a cause gains that cannot be there: firings at wrong times, beside the causes that are."""

from __future__ import annotations

import numpy as np

from gravcal.estimation import least_squares

#: Shifts of all firings; multiples of a time that no period of control or orbit shares.
SHIFTS_S = tuple(sign * k * 97.0 for k in range(1, 11) for sign in (-1, 1))


def basis(own: np.ndarray) -> np.ndarray:
    """Orthonormal basis (n, k) of the columns that are not zero.

    Parameters
    ----------
    own : (n, k)
    """
    return np.linalg.qr(own[:, np.any(own != 0, axis=0)])[0]


def inflation(blocks: list[dict], bases: list, present: list[list[np.ndarray]], wrong) -> tuple[float, np.ndarray]:
    """Factor by which gains in chi-square exceed those of the measured noise, at least one.

    Quiet stretches are quieter than the rest of the day, so that the noise measured in them makes every gain look
    larger than it is. What firings at wrong times gain, with the causes that are there in the model, shows by how much.

    Parameters
    ----------
    blocks : fields of Block; bases : of their own columns
    present : columns (n, q) of each cause that is in the model, a list by block each
    wrong : iterable of columns (n, 3) by block, one for each wrong time

    Returns
    -------
    factor : mean gain over its expectation, at least 1
    gains : (k,) of each wrong time
    """
    rest = [less(q, b["observed"]) for q, b in zip(bases, blocks, strict=True)]
    columns = [
        less(q, np.concatenate(parts, axis=1)) for q, parts in zip(bases, zip(*present, strict=True), strict=True)
    ]
    inverse = least_squares.stable_inverse(sum(c.T @ c for c in columns))
    value = inverse @ sum(c.T @ y for c, y in zip(columns, rest, strict=True))
    rest = [y - c @ value for c, y in zip(columns, rest, strict=True)]
    gains, freedom = [], 0
    for one in wrong:
        tried = [less(q, c) for q, c in zip(bases, one, strict=True)]
        cross = sum(t.T @ c for t, c in zip(tried, columns, strict=True))
        normal = sum(t.T @ t for t in tried) - cross @ inverse @ cross.T
        right = sum(t.T @ y for t, y in zip(tried, rest, strict=True))
        gains.append(float(right @ least_squares.stable_inverse(normal) @ right))
        freedom += right.size
    return max(sum(gains) / freedom, 1.0), np.array(gains)


def less(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns (n, q) without their part in a basis (n, k)."""
    return columns - basis @ (basis.T @ columns)
