"""What several tests of killed runs share."""

import pytest

from tests.end_to_end.test_kill import TRAIN


@pytest.fixture(scope="module")
def script(tmp_path_factory):
    """A script that trains a scene, as a file of its own that workers can import."""
    path = tmp_path_factory.mktemp("script") / "train.py"
    path.write_text(TRAIN)
    return path
