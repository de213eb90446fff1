"""Stub."""


def prepare(data, satellite, date, chosen):
    """Not yet."""
