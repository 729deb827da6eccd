"""Labels of logarithmic axes that let values be read, however little of a decade an axis shows."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.ticker import Formatter, LogFormatterSciNotation

# First digits that get a label where an axis shows this many decades or more; all of them where it shows less.
_DIGITS = ((0.75, (2, 5)), (0.4, (2, 3, 5, 7)))
_FEW = 4
_SHORT = 2.0


def number_label(value: float) -> str:
    """A plain number where that is short, a power of ten otherwise: 0.02, 500, 3·10⁻⁶."""
    if value == 0 or 1e-3 <= abs(value) < 1e5:
        return f"{value:.6g}"
    exponent = int(np.floor(np.log10(abs(value))))
    mantissa = f"{value / 10.0**exponent:.6g}"
    power = f"10^{{{exponent}}}"
    return f"${power}$" if mantissa == "1" else rf"${mantissa}\cdot{power}$"


class LogLabels(Formatter):
    """Labels powers of ten if an axis shows two of them or more, and numbers between them if it does not.

    Parameters
    ----------
    minor : bool
        Whether these are the labels between the powers.
    text : callable, optional
        Writes a value; `number_label`, and powers of ten where there are two or more, by default.
    """

    def __init__(self, minor: bool, text: Callable[[float], str] | None = None) -> None:
        self._minor, self._text = minor, text

    def __call__(self, value: float, position: int | None = None) -> str:
        """Label of one value, as among no others."""
        return self.format_ticks([value])[0]

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Labels of all ticks, empty where there is to be none."""
        low, high = sorted(float(end) for end in self.axis.get_view_interval())  # type: ignore[union-attr]
        powers = int(np.floor(np.log10(high) + 1e-9) - np.ceil(np.log10(low) - 1e-9)) + 1 if low > 0 else 2
        # Two digits, as percentages are written, do not tell neighbours on a short axis apart.
        own = self._text if low > 0 and high > _SHORT * low else None
        text = own or number_label
        if not self._minor:
            return [self._power(value) if own is None and powers >= 2 else text(value) for value in values]
        if powers >= 2:
            return [""] * len(values)
        inside = [value for value in values if low * (1 - 1e-9) <= value <= high * (1 + 1e-9)]
        chosen = _chosen(inside, float(np.log10(high / low)), 2 - powers)
        return [text(value) if value in chosen else "" for value in values]

    def _power(self, value: float) -> str:
        power = LogFormatterSciNotation()
        power.set_axis(self.axis)
        return str(power(value))


def _chosen(values: Sequence[float], decades: float, least: int) -> set[float]:
    """Values to label: all of a few, otherwise those with the best first digits, and at least `least`."""
    if len(values) <= _FEW:
        return set(values)
    for above, digits in _DIGITS:
        found = {value for value in values if _first_digit(value) in digits}
        if decades >= above and len(found) >= least:
            return found
    return set(values)


def _first_digit(value: float) -> int:
    return round(value / float(10.0 ** np.floor(np.log10(value) + 1e-9)))
