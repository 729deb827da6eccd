"""Where the work on a scene says how far it is."""

from dacore.dynamics.training import Progress


class ProgressBoard:
    """Where stages report how far they are; the command line draws it."""

    def meter(self, title: str) -> Progress | None:
        """Return a callback (done, total) for one piece of work, or None for silence."""
        return None

    def stage(self, name: str, event: str) -> None:
        """Hear that stage `name` starts ("start"), is done ("done"), or was kept ("cached")."""
