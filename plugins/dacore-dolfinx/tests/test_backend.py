"""DOLFINx keeps every promise of a backend."""

from dacore.testing.backends import backend_suite
from dacore_dolfinx.backend import DolfinxBackend

test_backend = backend_suite(DolfinxBackend()).as_test()
