"""One way to refuse a file: where, what was found, what was expected, what to do."""

from typing import NoReturn

from gravcal.errors import ProductError


def refuse(where, found, expected, remedy, error=ProductError, **facts) -> NoReturn:
    """Raise a ProductError that says where, found, expected and remedy, and carries them as facts.

    Parameters
    ----------
    where : file, with the line or record number where there is one
    found, expected : what is there and what should be
    remedy : what the reader can do
    error : kind of ProductError
    **facts : further numbers for tables of failures
    """
    message = f"{where}: found {found}; expected {expected}. {remedy}"
    raise error(message, where=str(where), found=str(found), expected=str(expected), remedy=remedy, **facts)
