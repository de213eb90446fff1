"""Errors of gravcal: each message has place, found, expected and remedy; the numbers are kept as facts."""

from typing import NoReturn


class GravcalError(Exception):
    """Anything gravcal refuses to do; the numbers behind the message are in ``facts``.

    Parameters
    ----------
    message : str, where, found against expected with units, and the remedy
    **facts : the quantities of the message, for tables of failures
    """

    def __init__(self, message, **facts):
        super().__init__(message)
        self.facts = facts


class CatalogError(GravcalError):
    """A satellite, event, parameter or constant is missing or contradicts itself."""


class ProductError(GravcalError):
    """A file or product is missing, damaged, or not of the expected form."""


class NoDataError(ProductError):
    """There are no files of an event: nothing is wrong, and nothing can be done."""


class EstimationError(GravcalError):
    """The data do not determine the parameters to be estimated."""


def refuse(where, found, expected, remedy, error=ProductError, **facts) -> NoReturn:
    """Raise an error of that class: "where: found ...; expected .... remedy"; these texts and ``facts`` are its facts.

    ``where`` is the file, with the line or record number where there is one; facts are for tables of failures.
    """
    message = f"{where}: found {found}; expected {expected}. {remedy}"
    raise error(message, where=str(where), found=str(found), expected=str(expected), remedy=remedy, **facts)
