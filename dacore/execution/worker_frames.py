"""Where an error came from, also if that was in another process: a traceback does not travel."""

import sys
import traceback
from pathlib import Path

_NAME = "_dacore_frames"
_LIBRARIES = ("numpy", "scipy", "dacore")


def keep_frames(error: BaseException) -> None:
    """Write the files and lines of an error's traceback into the error, to be pickled with it."""
    setattr(error, _NAME, frames_of(error))


def frames_of(error: BaseException) -> list[tuple[str, int]]:
    """Files and lines on the way of an error, outermost first: here, and then where it was sent from."""
    here = [(frame.filename, frame.lineno or 0) for frame in traceback.extract_tb(error.__traceback__)]
    return [*here, *getattr(error, _NAME, ())]


def place_of(error: BaseException) -> str:
    """Return "file line N" of the innermost frame that is not in dacore, numpy or scipy, or else of the innermost."""
    frames = frames_of(error)
    loaded = [getattr(sys.modules.get(name), "__file__", None) for name in _LIBRARIES]
    roots = [Path(file).parent for file in loaded if file]
    own = [each for each in frames if not any(Path(each[0]).is_relative_to(root) for root in roots)]
    file, line = (own or frames or [("?", 0)])[-1]
    return f"{Path(file).name} line {line}"
