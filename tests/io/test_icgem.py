"""Gravity-field files."""

import numpy as np
import pytest
import shipped_field
from numpy.testing import assert_array_equal

from gravcal.errors import ProductError
from gravcal.io import icgem
from gravcal.physics import gravity_field

HEAD = """begin_of_head ====
modelname   small
earth_gravity_constant   3.986004415D+14
radius  6378136.3
max_degree 2
norm {norm}
errors formal
end_of_head ====
"""
LINES = (
    "gfc 0 0 1.0 0.0 0 0\ngfct 2 0 {c} 0.0 1e-11 0 20050101\ntrnd 2 0 1e-11 0\ngfc 2 2 2.4d-06 -1.4D-06 1e-11 1e-11\n"
)


def write(tmp_path, text):
    """A .gfc file."""
    path = tmp_path / "small.gfc"
    path.write_text(text)
    return path


def test_the_shipped_field_is_what_its_generator_makes():
    """Contract: bit for bit; it has no degree 1 and reaches degree 60."""
    read, made = icgem.read_field(icgem.located("gravcal-60")), shipped_field.generated()
    assert read.degree == 60
    assert np.all(read.cosine[1] == 0)
    for name in ("cosine", "sine", "cosine_sigma", "sine_sigma"):
        assert_array_equal(getattr(read, name), getattr(made, name))


def test_a_written_field_reads_back_exactly(tmp_path):
    """Contract: round trip."""
    field = gravity_field.truncated(shipped_field.generated(), 0, 12)
    read = icgem.read_field(icgem.write_field(tmp_path / "a.gfc", field, "a comment"))
    assert read.gm == field.gm
    assert read.radius == field.radius
    assert_array_equal(read.cosine, field.cosine)
    assert_array_equal(read.sine_sigma, field.sine_sigma)
    assert icgem.read_field(tmp_path / "a.gfc", highest=5).degree == 5


def test_fortran_exponents_static_parts_and_plain_norms_are_read(tmp_path):
    """Analytic: unnormalised C20 = -J2 is sqrt(5) times the normalised one."""
    normal = icgem.read_field(write(tmp_path, HEAD.format(norm="fully_normalized") + LINES.format(c=-4.84e-4)))
    plain = icgem.read_field(write(tmp_path, HEAD.format(norm="unnormalized") + LINES.format(c=-4.84e-4 * 5**0.5)))
    assert normal.gm == 3.986004415e14
    assert normal.cosine[2, 2] == 2.4e-6
    assert normal.sine[2, 2] == -1.4e-6
    assert plain.cosine[2, 0] == pytest.approx(normal.cosine[2, 0], rel=1e-14)
    assert plain.cosine[2, 2] == pytest.approx(2.4e-6 / np.sqrt(5 / 12), rel=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing\n", "end_of_head"),
        ("begin_of_head\nradius 6e6\nend_of_head\n", "no gm, degree"),
        (HEAD.format(norm="fully_normalized") + "gfc 3 0 1 0 0 0\n", "line 9"),
        (HEAD.format(norm="fully_normalized") + "gfc 2 0 x 0 0 0\n", "'x'"),
        (HEAD.format(norm="fully_normalized") + "what 2 0\n", "line 9"),
    ],
)
def test_damaged_files_are_refused_with_the_place(tmp_path, text, message):
    """Contract: file and line."""
    with pytest.raises(ProductError, match=message):
        icgem.read_field(write(tmp_path, text))


def test_an_unknown_field_is_refused():
    """Contract: the remedy names what ships."""
    with pytest.raises(ProductError, match="gravcal-60"):
        icgem.located("egm.gfc")
