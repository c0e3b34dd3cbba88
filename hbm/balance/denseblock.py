"""What couples modes and harmonics in a Newton matrix, where it is kept."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hbm.fourier import Array


@dataclass(frozen=True)
class DenseBlock:
    """The coefficients whose parametric stiffness is kept in the Newton matrix.

    Attributes
    ----------
    cosines : (c,) array of int
        The pairs, in the order harmonic by harmonic, mode by mode.
    coefficients : (d,) array of int
        Their cosine, then their sine coefficients in the flat (2H+1, m) unknowns.
    products : (d, d) array of int
        Where each pair of coefficients finds its entry in the flat multiplication matrix of T.
    G : (d, d) array
        Shortening of the modes of each pair.
    """

    cosines: npt.NDArray[np.intp]
    coefficients: npt.NDArray[np.intp]
    products: npt.NDArray[np.intp]
    G: Array

    @staticmethod
    def of(strong: npt.NDArray[np.bool_], shortening: Array, size: int) -> "DenseBlock":
        """Block of the pairs `strong` (H+1, m); harmonic 0 whole."""
        cosines = np.flatnonzero(strong)
        sines = np.flatnonzero(strong[1:]) + strong.size  # behind the (H+1) m cosines
        coefficients = np.concatenate([cosines, sines])
        harmonic, mode = np.divmod(coefficients, strong.shape[1])
        products = harmonic[:, None] * size + harmonic
        return DenseBlock(cosines, coefficients, products, shortening[mode[:, None], mode])
