"""The contract of a stage: reuse exactly what is unchanged, check, write, never change an input."""

import os
import re
from types import SimpleNamespace

import numpy as np
import pytest

from gravcal.errors import CatalogError, EstimationError, ProductError
from gravcal.store import store
from tasks import stage
from tasks.stage import read


def test_a_changed_file_makes_everything_below_it(pipeline):
    """Contract: content of the input file is part of the key."""
    pipeline.run()
    pipeline.raw.write_text("abcd")
    assert pipeline.run()[0] == ["start", "scale.one", "scale.other", "join"]


def test_a_file_written_anew_with_equal_content_makes_nothing(pipeline):
    """Contract: the content counts, not path or time of change."""
    pipeline.run()
    pipeline.raw.unlink()
    pipeline.raw.write_text("abc")
    assert pipeline.run()[0] == []


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("helper.py", "FACTOR * values", "values * FACTOR + 1", ["start", "scale.one", "scale.other", "join"]),
        ("second.py", '["value"] * gain', '["value"] * gain + 1', ["scale.one", "scale.other", "join"]),
        (
            "stages.py",
            "second.scaled(started, gain)",
            "second.scaled(started, -gain)",
            ["scale.one", "scale.other", "join"],
        ),
        ("stages.py", '{name}.join", version=1', '{name}.join", version=2', ["join"]),
    ],
)
def test_changed_code_makes_its_dependants_only(pipeline, file, old, new, expected):
    """Contract: helper, science module, body and version of a stage are each part of the key of what they make."""
    pipeline.run()
    pipeline.replace(file, old.replace("{name}", pipeline.name), new.replace("{name}", pipeline.name))
    assert pipeline.run()[0] == expected


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("# a comment", "# another comment"),
        ('"""Twice."""', '"""Two times."""'),
        ("FACTOR * values", "(FACTOR  *  values)"),
    ],
)
def test_a_changed_comment_makes_nothing(pipeline, old, new):
    """Contract: comments, docstrings and layout are no code."""
    pipeline.run()
    pipeline.replace("helper.py", old, new)
    assert pipeline.run()[0] == []


def test_equal_content_upstream_stops_the_rerun(pipeline):
    """Contract: the first stage runs again and rounds to the same numbers, so nothing below it does."""
    pipeline.run()
    assert pipeline.run(offset=0.25)[0] == ["start"]


def test_whole_numbers_and_reals_share_a_key_where_a_real_is_expected(pipeline):
    """Contract: 3 and 3.0 mean the same gain."""
    pipeline.run()
    assert pipeline.run(gain_other=3)[0] == []


def test_a_product_damaged_after_it_was_found_is_made_again(pipeline):
    """Contract: reading verifies; the input is made again in the middle of a run."""
    pipeline.run()
    start = store.reference(*_latest(pipeline, "start"))
    before = read(start)
    status = start.path.stat()
    start.path.write_bytes(bytes(status.st_size))
    os.utime(start.path, ns=(status.st_atime_ns, status.st_mtime_ns))
    pipeline.run(gain_one=7.0)
    assert read(start).identical(before)


def test_wrong_units_are_refused(pipeline):
    """Contract: a body that contradicts the schema delivers nothing."""
    scaled = 'dataset.assign(value=dataset["value"] * gain)'
    pipeline.replace("second.py", scaled, scaled + '.assign(value=("time", dataset["value"].values, {"units": "km"}))')
    with pytest.raises(ProductError, match="units is 'km', the schema says 'm'"):
        pipeline.run()


def test_settings_without_meaning_are_refused(pipeline):
    """Contract: no NaN in a label, no missing and no unknown setting."""
    with pytest.raises(CatalogError, match="finite number"):
        pipeline.run(gain_one=float("nan"))
    with pytest.raises(CatalogError, match="expected int"):
        pipeline.run(count=2.5)
    with pytest.raises(TypeError, match="missing .'gain'.*unknown .'gian'"):
        pipeline.module("stages").scale(pipeline.run()[1].__class__("e", f"{pipeline.name}.start"), gian=1.0)


def test_the_wrong_kind_of_product_is_refused(pipeline):
    """Contract: a stage reads the kinds it says."""
    _, ref = pipeline.run()
    with pytest.raises(ProductError, match="join; expected .*start"):
        pipeline.module("stages").scale(ref, gain=1.0)


def test_a_stage_called_with_datasets_is_its_body(pipeline):
    """Contract: unit tests need no store."""
    _, ref = pipeline.run()
    dataset = read(ref)
    result = pipeline.module("stages").scale(dataset, gain=2.0)
    assert result["value"].values.tolist() == (2 * dataset["value"]).values.tolist()


def test_a_body_cannot_change_what_others_read(pipeline):
    """Contract: readers share the arrays, which refuse to be changed, and have labels of their own."""
    _, ref = pipeline.run()
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


def test_settings_are_handed_on_as_they_come():
    """Contract: a body that takes any settings has each of them in its label."""

    @stage.stage(reads=[], writes="any", version=1)
    def body(**settings):
        raise AssertionError(settings)

    call = stage.call_of(body, (), {"second": 2, "first": 1.5, "event": "e"})
    assert list(call.settings.items()) == [("first", 1.5), ("second", 2)]


def test_a_default_value_is_refused():
    """Contract: every setting comes from the catalogue."""
    from tasks.stage import stage

    with pytest.raises(TypeError, match="must not have a default"):

        @stage(reads=[], writes="x", version=1)
        def body(*, gain: float = 1.0):
            """Body."""


def _latest(pipeline, part):
    """Record and folder of the newest product of a stage."""
    from gravcal.store import location

    folder = (location.folder() / "latest" / "fake-1" / f"{pipeline.name}.{part}").resolve()
    return store.read_record(folder), folder


def test_equations_that_cannot_be_solved_are_an_error_of_the_input():
    """Contract: numbers of no sense end in a message with event, stage and remedy; other errors stay what they are."""
    call = SimpleNamespace(event="demo", unmade=SimpleNamespace(stage="demo.fit"))
    found = stage._of_input(np.linalg.LinAlgError("SVD did not converge"), call)
    assert isinstance(found, EstimationError)
    assert re.search("demo: demo.fit found equations .* Check the input files", str(found))
    infinite = np.array([np.inf])
    with pytest.raises(ValueError, match="infs or NaNs") as raised:
        np.asarray_chkfinite(infinite)
    assert isinstance(stage._of_input(raised.value, call), EstimationError)
    for other in (KeyError("x"), ValueError("x")):
        assert stage._of_input(other, call) is other
