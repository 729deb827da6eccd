"""The one place where MFEM is imported, and what every user of PyMFEM must know.

PyMFEM wraps C++ objects that point to each other. What a C++ object points to must be kept alive in
Python as long as that object is used: a form holds neither its coefficients nor its quadrature rule.
Arrays it hands out are views of memory that dies with its owner, so they are copied. A mixed form
deletes its integrators although Python owns them too: those added by ``AddDomainIntegrator`` are
handed over by PyMFEM itself. An error inside MFEM is printed to stderr before it is raised here.
"""

from typing import Any

import mfem.ser

mfem: Any = mfem.ser

__all__ = ["mfem"]
