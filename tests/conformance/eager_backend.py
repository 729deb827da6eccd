"""A backend whose module loads the library at once."""

import skfem

from tests.conformance.sound_backend import Sound, caught_by


@caught_by("the_library_is_loaded_late", "loads skfem")
class LoadsAtOnce(Sound):
    name = "broken"

    def version(self):
        return skfem.__version__
