"""Every picture of a run."""

from collections.abc import Iterator

from dacore.workflow.canvas import Canvas
from dacore.workflow.drawn import Drawn
from dacore.workflow.pictures_errors import draw_histories, draw_quantities, draw_summary
from dacore.workflow.pictures_fields import draw_hero, draw_measured, draw_worst
from dacore.workflow.pictures_parameters import draw_parameters
from dacore.workflow.pictures_spaces import draw_modes, draw_spaces


def draw_all(canvas: Canvas) -> Iterator[Drawn]:
    """Draw all figures of a scene, one after the other; slices only where the domain has some, states if asked for."""
    scene = canvas.session.scene
    if scene.report.states:
        yield from draw_hero(canvas)
    yield draw_summary(canvas)
    if canvas.has_slices:
        yield from draw_measured(canvas)
        if scene.report.states:
            for level in scene.noise.levels:
                yield from draw_worst(canvas, level)
            yield draw_modes(canvas)
    if scene.report.states:
        yield from draw_histories(canvas)
    yield from draw_quantities(canvas)
    yield from draw_parameters(canvas)
    yield from draw_spaces(canvas)
