"""scikit-fem keeps every promise of a backend."""

from dacore.testing import backend_suite
from dacore_skfem.backend import SkfemBackend

test_backend = backend_suite(SkfemBackend()).as_test()
