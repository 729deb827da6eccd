"""Pictures of data, their fit and fields without a truth."""

import numpy as np
import pytest

from dacore.domains.box import Box
from dacore.errors import ShapeError
from dacore.figures.data_fit import FitSeries, data_fit
from dacore.figures.reconstructed import Reconstructed, reconstructed
from dacore.figures.slices import View
from dacore.figures.style import png
from dacore.geometry.cut import cut_plane


@pytest.fixture(scope="module")
def view():
    mesh = Box().mesh()
    return View(cut_plane(mesh.points, mesh.cells, 2, 0.4 * mesh.points[:, 2].max()))


def series(sigma, n=50, name="u_x"):
    rng = np.random.default_rng(0)
    fitted = rng.standard_normal(n)
    return FitSeries(name, "cm", fitted + 0.1 * rng.standard_normal(n), fitted, np.full(n, sigma))


def test_data_and_fit_with_noise_and_without():
    noisy = data_fit([series(0.1), series(0.1, name="u_y")], "caption")
    left, right = noisy.axes
    assert left.get_xlim() == left.get_ylim()
    labels = [text.get_text() for text in noisy.legends[0].get_texts()]
    assert "what the stated noise gives" in labels
    assert right.get_xlabel() == "residual / sigma"
    exact = data_fit([series(0.0)])
    assert exact.axes[1].get_xlabel() == "residual / its root mean square"
    assert "what the stated noise gives" not in [text.get_text() for text in exact.legends[0].get_texts()]
    # The histogram holds every residual, in units of sigma.
    heights = np.array([patch.get_height() * patch.get_width() for patch in right.patches])
    assert heights.sum() == pytest.approx(1.0)
    assert png(noisy).startswith(b"\x89PNG")


def test_data_that_do_not_fit_together_are_refused():
    with pytest.raises(ShapeError, match="at least one series"):
        data_fit([])
    with pytest.raises(ShapeError, match="as many fitted values"):
        data_fit([FitSeries("u", "cm", np.zeros(3), np.zeros(2), np.ones(3))])


def test_fields_with_and_without_deviations(view):
    q = len(view.cut.points)
    both = reconstructed(
        view, [Reconstructed("p", "Pa", np.arange(q), np.ones(q)), Reconstructed("|u|", "cm", np.ones(q))]
    )
    titles = [axes.get_title() for axes in both.axes]
    assert "reconstruction" in titles
    assert "standard deviation" in titles
    alone = reconstructed(view, [Reconstructed("p", "Pa", np.arange(q))])
    assert "standard deviation" not in [axes.get_title() for axes in alone.axes]
    with pytest.raises(ShapeError, match="one value a point of the cut"):
        reconstructed(view, [Reconstructed("p", "Pa", np.zeros(q + 1))])
