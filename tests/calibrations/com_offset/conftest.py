"""Products and documents of an invented event, made once."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

import invented  # noqa: E402

from gravcal.calibrations.com_offset.page import result  # noqa: E402
from gravcal.report import documents  # noqa: E402


def document_of(products, event="grace-c-2020-02-01"):
    """Result document of invented products."""
    head = {"schema_version": "1.0", "calibration": "com_offset", "event": event}
    tail = {"settings": invented.SETTINGS, "provenance": invented.PROVENANCE}
    return documents.judged(head | result(products, invented.SETTINGS) | tail, (), [])


@pytest.fixture(scope="session")
def products():
    """Products of an event with three manoeuvres."""
    return invented.products()


@pytest.fixture(scope="session")
def quiet_products():
    """Products of a record without manoeuvre."""
    return invented.products(count=0)


@pytest.fixture(scope="session")
def document(products):
    """Document of the event with three manoeuvres."""
    return document_of(products)


@pytest.fixture(scope="session")
def quiet_document(quiet_products):
    """Document of the record without manoeuvre."""
    return document_of(quiet_products, "grace-c-2023-06-01")


@pytest.fixture
def documented():
    """Function that makes the document of products."""
    return document_of
