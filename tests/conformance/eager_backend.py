"""A backend whose module loads the library at once."""

import skfem

from tests.conformance.broken_backends import Sound


class LoadsAtOnce(Sound):
    name = "broken"

    def version(self):
        return skfem.__version__
