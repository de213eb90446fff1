"""The contract of a stage: reuse exactly what is unchanged, check, write, never change an input."""

import os
import re
from types import SimpleNamespace

import numpy as np
import pytest

from gravcal.errors import CatalogError, EstimationError, ProductError
from gravcal.store import housekeeping
from tasks import stage
from tasks.stage import read


def test_equal_content_makes_nothing(pipeline):
    """Contract: a file written anew, not path or time of change; a first stage that rounds to the same; 3 and 3.0."""
    pipeline.run()
    pipeline.raw.unlink()
    pipeline.raw.write_text("abc")
    assert pipeline.run()[0] == []
    assert pipeline.run(offset=0.25)[0] == ["start"]
    assert pipeline.run(gain_other=3)[0] == []


def test_a_product_damaged_after_it_was_found_is_made_again(pipeline):
    """Contract: reading verifies; the input is made again in the middle of a run."""
    pipeline.run()
    start = housekeeping.resolve(f"fake-1/{pipeline.name}.start").ref
    before = read(start)
    status = start.path.stat()
    start.path.write_bytes(bytes(status.st_size))
    os.utime(start.path, ns=(status.st_atime_ns, status.st_mtime_ns))
    pipeline.run(gain_one=7.0)
    assert read(start).identical(before)


def test_what_is_no_setting_and_no_input_is_refused(pipeline):
    """Contract: no NaN in a label, no missing and no unknown setting; the kinds a stage says; the units of a schema."""
    with pytest.raises(CatalogError, match="finite number"):
        pipeline.run(gain_one=float("nan"))
    with pytest.raises(CatalogError, match="expected int"):
        pipeline.run(count=2.5)
    _, ref = pipeline.run()
    with pytest.raises(TypeError, match="missing .'gain'.*unknown .'gian'"):
        pipeline.module("stages").scale(ref.__class__("e", f"{pipeline.name}.start"), gian=1.0)
    with pytest.raises(ProductError, match="join; expected .*start"):
        pipeline.module("stages").scale(ref, gain=1.0)
    scaled = 'dataset.assign(value=dataset["value"] * gain)'
    pipeline.replace("second.py", scaled, scaled + '.assign(value=("time", dataset["value"].values, {"units": "km"}))')
    with pytest.raises(ProductError, match="units is 'km', the schema says 'm'"):
        pipeline.run()


def test_a_body_called_with_datasets_cannot_change_what_others_read(pipeline):
    """Contract: unit tests need no store; readers share the arrays, which refuse changes, and have their own labels."""
    _, ref = pipeline.run()
    result = pipeline.module("stages").scale(read(ref), gain=2.0)
    assert result["value"].values.tolist() == (2 * read(ref)["value"]).values.tolist()
    for _ in range(2):  # from the file, and as kept
        dataset = read(ref)
        with pytest.raises(ValueError, match="read-only"):
            dataset["value"].values[:] = -1.0
        dataset["value"].attrs["units"] = dataset.attrs["title"] = "changed"
        dataset["value"] = -dataset["value"]
    again = read(ref)
    assert (again["value"].values >= 0).all()
    assert again["value"].attrs["units"] != "changed"
    assert "title" not in again.attrs


def test_settings_are_handed_on_and_equations_that_cannot_be_solved_are_an_error_of_the_input():
    """Contract: each setting is in the label; event, stage and remedy; other errors stay what they are."""

    @stage.stage(reads=[], writes="any", version=1)
    def body(**settings):
        raise AssertionError(settings)

    call = stage.call_of(body, (), {"second": 2, "first": 1.5, "event": "e"})
    assert list(call.settings.items()) == [("first", 1.5), ("second", 2)]
    call = SimpleNamespace(event="demo", unmade=SimpleNamespace(stage="demo.fit"))
    found = stage._of_input(np.linalg.LinAlgError("SVD did not converge"), call)
    assert isinstance(found, EstimationError)
    assert re.search("demo: demo.fit found equations .* Check the input files", str(found))
    with pytest.raises(ValueError, match="infs or NaNs") as raised:
        np.asarray_chkfinite([np.inf])
    assert isinstance(stage._of_input(raised.value, call), EstimationError)
    for other in (KeyError("x"), ValueError("x")):
        assert stage._of_input(other, call) is other
