"""The Gaussian kernel of the lattice, against scipy's."""

import numpy as np
import pytest
from scipy import ndimage

from tactile_localizer.paper.lattice_kernel import LatticeKernel


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("shape", [(1,), (5,), (300,), (2, 7), (134, 9), (40, 3, 4)])
@pytest.mark.parametrize("sigma", [0.9, 3.97, 20.0])
def test_the_kernel_of_a_lattice_is_that_of_scipy_with_its_axis_last(
    sigma: float, shape: tuple[int, ...], wraps: bool
) -> None:
    values = np.random.default_rng(0).random(shape)
    found = np.moveaxis(LatticeKernel(sigma, len(values), wraps).filter(values), -1, 0)
    mode, radius = "wrap" if wraps else "constant", int(np.ceil(8.5 * sigma))
    expected = ndimage.gaussian_filter1d(values, sigma, axis=0, mode=mode, radius=radius)
    np.testing.assert_allclose(found, expected, rtol=1e-12)
