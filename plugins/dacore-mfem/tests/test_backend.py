"""MFEM keeps every promise of a backend."""

import pytest

from dacore.testing import backend_suite
from dacore_mfem.backend import MfemBackend

pytest.importorskip("mfem")

test_backend = backend_suite(MfemBackend()).as_test()
