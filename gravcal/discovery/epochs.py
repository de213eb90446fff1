"""Causes that happen at an epoch: while they are searched for, each epoch is a cause of its own, "slug@epoch"."""

from __future__ import annotations

from dataclasses import replace

from gravcal.estimation.records import Candidate


def at(slug: str, epoch: float) -> str:
    """Name of a cause at an epoch, so that two of them are not taken for two forms of one.

    Parameters
    ----------
    slug : of the effect
    epoch : s
    """
    return f"{slug}@{epoch:.1f}"


def each_its_own(candidate: Candidate, slug: str) -> Candidate:
    """A candidate whose cause names its epoch if it is the one that happens at an epoch.

    Parameters
    ----------
    candidate : Candidate
    slug : of the cause whose candidates have the words "time <epoch> s" at the end of their form
    """
    return replace(candidate, cause=at(slug, of(candidate.form))) if candidate.cause == slug else candidate


def of(form: str) -> float:
    """Epoch s in the words of a form.

    Parameters
    ----------
    form : "time <epoch> s", after other words or none
    """
    return float(form.rpartition("time ")[2].removesuffix(" s"))


def plain(numbers: dict) -> dict:
    """Numbers with the slugs of the catalogue; a cause is not tied with itself at another epoch.

    Parameters
    ----------
    numbers : of `summary.summary`
    """
    for one in numbers["findings"]:
        one["cause"] = _slug(one["cause"])
        tied = dict.fromkeys(map(_slug, one["tied_with"]))
        one["tied_with"] = sorted(set(tied) - {one["cause"]})
        rows = {_slug(row["cause"]): row | {"cause": _slug(row["cause"])} for row in one["separation"]}
        one["separation"] = [row for name, row in rows.items() if name != one["cause"]]
    rows = {}
    for row in numbers["tried"]:
        rows.setdefault(_slug(row["cause"]), row | {"cause": _slug(row["cause"])})
    return numbers | {"tried": list(rows.values())}


def _slug(cause):
    return cause.partition("@")[0]
