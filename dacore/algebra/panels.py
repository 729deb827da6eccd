"""Orthonormal modes held in panels, and products with them taken a few rows at a time.

Nothing as large as a block of snapshots is made on the way: an inner product is applied to some rows,
used, and forgotten while it is still in the processor's cache.
"""

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array

from dacore.core.arrays import Array, Sparse
from dacore.errors import ShapeError

#: Rows handled at once: with 64 columns, 1 MB.
ROWS = 2048


class Rows:
    """An inner product M as bands of rows; each band shares the entries of the whole matrix.

    Parameters
    ----------
    product : (n, n) csr_array
    """

    def __init__(self, product: Sparse) -> None:
        self.n = product.shape[0]
        if product.shape != (self.n, self.n):
            raise ShapeError(f"inner product: got shape {product.shape}, expected a square matrix")
        self._bands: list[tuple[slice, Sparse]] = []
        for start in range(0, self.n, ROWS):
            stop = min(start + ROWS, self.n)
            first, last = product.indptr[start], product.indptr[stop]
            entries = (product.data[first:last], product.indices[first:last], product.indptr[start : stop + 1] - first)
            self._bands.append((slice(start, stop), csr_array(entries, shape=(stop - start, self.n))))

    def bands(self) -> Iterator[slice]:
        """Yield the rows of each band."""
        return (rows for rows, _ in self._bands)

    def images(self, block: Array) -> Iterator[tuple[slice, Array]]:
        """Yield the rows (k, columns) of M · block, band by band, for a C-contiguous block (n, columns)."""
        return ((rows, np.asarray(band @ block)) for rows, band in self._bands)

    def gram(self, block: Array) -> Array:
        """blockᵀ M block."""
        out = np.zeros((block.shape[1],) * 2)
        for rows, image in self.images(block):
            out += block[rows].T @ image
        return 0.5 * (out + out.T)


class Panels:
    """Modes (n, r) that are added to and rotated in place, a panel of them at a time.

    Parameters
    ----------
    rows : Rows
        Inner product in which the modes are orthonormal.
    width : int
        Modes a panel; room for at most so many is held without being used.
    """

    def __init__(self, rows: Rows, width: int = 64) -> None:
        self.rows, self.width = rows, width
        self.count = 0
        self._panels: list[Array] = []

    def _parts(self) -> Iterator[tuple[slice, Array]]:
        """Yield which modes each panel holds, and the panel's used rows (k, n)."""
        for number, panel in enumerate(self._panels):
            start = number * self.width
            stop = min(start + self.width, self.count)
            if stop > start:
                yield slice(start, stop), panel[: stop - start]

    def append(self, modes: Array) -> None:
        """Add modes (n, k)."""
        done = 0
        while done < modes.shape[1]:
            used = self.count % self.width
            if used == 0:
                self._panels.append(np.empty((self.width, self.rows.n)))
            step = min(self.width - used, modes.shape[1] - done)
            self._panels[-1][used : used + step] = modes[:, done : done + step].T
            done, self.count = done + step, self.count + step

    def observe(self, block: Array) -> tuple[Array, Array]:
        """Coefficients ΦᵀM·block (r, k) and squared norms (k,) of the columns of a block (n, k)."""
        found = np.zeros((self.count, block.shape[1]))
        squares = np.zeros(block.shape[1])
        for rows, image in self.rows.images(block):
            squares += np.einsum("ij,ij->j", block[rows], image)
            self._onto(found, rows, image)
        return found, squares

    def _onto(self, found: Array, rows: slice, image: Array) -> None:
        """Add what some rows of an image contribute to its products with the modes."""
        for part, panel in self._parts():
            found[part] += panel[:, rows] @ image

    def subtract(self, block: Array, coefficients: Array) -> None:
        """Take Φ·coefficients off a block (n, k), in place."""
        for rows in self.rows.bands():
            for part, panel in self._parts():
                block[rows] -= panel[:, rows].T @ coefficients[part]

    def news(self, modes: Array, least: float) -> Array:
        """Orthonormalise modes (n, k) against these and among themselves; they are overwritten.

        Gram–Schmidt by blocks, twice. Modes of which these hold all but `least` are left out.

        Returns
        -------
        (n, q) array
        """
        for _ in range(2):
            gram = np.zeros((modes.shape[1],) * 2)
            found = np.zeros((self.count, modes.shape[1]))
            for rows, image in self.rows.images(modes):
                gram += modes[rows].T @ image
                self._onto(found, rows, image)
            gram -= found.T @ found
            squares, vectors = np.linalg.eigh(0.5 * (gram + gram.T))
            new = squares > least**2
            self.subtract(modes, found)
            modes = self._turned(modes, vectors[:, new] / np.sqrt(squares[new]))
        return modes

    def _turned(self, modes: Array, matrix: Array) -> Array:
        """Modes · matrix, in place where the shape stays."""
        same = matrix.shape[0] == matrix.shape[1]
        out = modes if same else np.empty((modes.shape[0], matrix.shape[1]))
        for rows in self.rows.bands():
            out[rows] = modes[rows] @ matrix
        return out

    def rotate(self, matrix: Array) -> None:
        """Replace the modes by modes · matrix (r, k), k <= r, in place."""
        for rows in self.rows.bands():
            turned = self._rows(rows, matrix)
            for number, panel in enumerate(self._panels):
                piece = turned[number * self.width : (number + 1) * self.width]
                panel[: len(piece), rows] = piece
        self.count = matrix.shape[1]
        del self._panels[-(-self.count // self.width) :]

    def combine(self, matrix: Array) -> Array:
        """Modes · matrix, (n, k)."""
        out = np.empty((self.rows.n, matrix.shape[1]))
        for rows in self.rows.bands():
            out[rows] = self._rows(rows, matrix).T
        return out

    def _rows(self, rows: slice, matrix: Array) -> Array:
        """Some rows of modes · matrix, transposed: (k, rows)."""
        turned = np.zeros((matrix.shape[1], rows.stop - rows.start))
        for part, panel in self._parts():
            turned += matrix[part].T @ panel[:, rows]
        return turned
