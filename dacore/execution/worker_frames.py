"""Where an error came from, also if that was in another process: a traceback does not travel."""

import traceback

_NAME = "_dacore_frames"


def keep_frames(error: BaseException) -> None:
    """Write the files and lines of an error's traceback into the error, to be pickled with it."""
    setattr(error, _NAME, frames_of(error))


def frames_of(error: BaseException) -> list[tuple[str, int]]:
    """Files and lines on the way of an error, outermost first: here, and then where it was sent from."""
    here = [(frame.filename, frame.lineno or 0) for frame in traceback.extract_tb(error.__traceback__)]
    return [*here, *getattr(error, _NAME, ())]
