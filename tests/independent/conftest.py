"""Two small events that the tests of this folder share."""

import pytest

from . import make_event
from .rows import EXACT, SHORT


@pytest.fixture(scope="session")
def event(tmp_path_factory):
    """One noisy pitch manoeuvre with short quiet times."""
    return make_event(tmp_path_factory.mktemp("event"), 11, **SHORT)


@pytest.fixture(scope="session")
def exact(tmp_path_factory):
    """The same without noise and quantisation."""
    return make_event(tmp_path_factory.mktemp("exact"), 11, **EXACT)
