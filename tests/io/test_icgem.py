"""Gravity-field files."""

import numpy as np
import pytest

from gravcal.errors import ProductError
from gravcal.io import icgem

HEAD = """begin_of_head ====
modelname   small
earth_gravity_constant   3.986004415D+14
radius  6378136.3
max_degree 2
norm {norm}
errors formal
end_of_head ====
"""
LINES = "gfc 0 0 1.0 0.0 0 0\ngfct 2 0 {c} 0.0 1e-11 0 20050101\ntrnd 2 0 1e-11 0\n"
LINES += "gfc 2 2 2.4d-06 -1.4D-06 1e-11 1e-11\n"


def write(tmp_path, text):
    """A .gfc file."""
    (path := tmp_path / "small.gfc").write_text(text)
    return path


def test_the_shipped_field_is_that_of_the_earth():
    """Independent: GM, flattening and ellipticity of the equator as of GRS80; errors grow to both ends."""
    read = icgem.read_field(icgem.located("GGM05S"))
    assert (read.degree, read.gm, read.radius) == (180, 3.986004415e14, 6378136.3)
    assert np.sqrt(5) * -read.cosine[2, 0] == pytest.approx(1.08263e-3, rel=1e-5)
    assert np.hypot(read.cosine[2, 2], read.sine[2, 2]) * np.sqrt(5 / 12) == pytest.approx(1.8155e-6, rel=1e-4)
    assert np.all(read.cosine[1] == 0)
    assert 0 < read.cosine_sigma[60, 30] < read.cosine_sigma[2, 2] < read.cosine_sigma[180, 90] < 1e-9
    assert icgem.read_field(icgem.shipped(), highest=5).degree == 5


def test_fortran_exponents_static_parts_and_plain_norms_are_read(tmp_path):
    """Analytic: unnormalised C20 = -J2 is sqrt(5) times the normalised one."""
    normal = icgem.read_field(write(tmp_path, HEAD.format(norm="fully_normalized") + LINES.format(c=-4.84e-4)))
    plain = icgem.read_field(write(tmp_path, HEAD.format(norm="unnormalized") + LINES.format(c=-4.84e-4 * 5**0.5)))
    assert normal.gm == 3.986004415e14
    assert normal.cosine[2, 2] == 2.4e-6
    assert normal.sine[2, 2] == -1.4e-6
    assert plain.cosine[2, 0] == pytest.approx(normal.cosine[2, 0], rel=1e-14)
    assert plain.cosine[2, 2] == pytest.approx(2.4e-6 / np.sqrt(5 / 12), rel=1e-14)
    exact = HEAD.format(norm="fully_normalized").replace("formal", "no") + "gfct 2 0 -4.84e-4 0.0 20050101\n"
    assert not icgem.read_field(write(tmp_path, exact)).cosine_sigma.any()


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
    """Contract: file and line; of an unknown field the remedy names what ships."""
    with pytest.raises(ProductError, match=message):
        icgem.read_field(write(tmp_path, text))
    with pytest.raises(ProductError, match="GGM05S"):
        icgem.located("egm.gfc")
