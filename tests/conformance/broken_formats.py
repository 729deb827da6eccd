"""Data formats that are wrong in one way each."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from dacore.core.data import Asked, DataFormat, SensorData
from dacore.errors import ShapeError, StoreError
from dacore.testing import format_suite
from tests.conformance.mutants import Mutant

MUTANTS = []

LABELS, TIMES = ("left", "right"), np.array([0.1, 0.2, 0.3])
VALUES = np.array([[1.0, 2.0, np.nan], [0.1, -3e-7, 4.0]])
EXPECTED = SensorData("any", VALUES, "cm", LABELS, times=TIMES, sigma=np.full((2, 3), 0.1))


def write(folder):
    """A line of times, then a line a sensor; the last line says that all is there."""
    lines = ["times," + ",".join(map(repr, TIMES.tolist()))]
    lines += [f"{label}," + ",".join(map(repr, row)) for label, row in zip(LABELS, VALUES.tolist(), strict=True)]
    path = folder / "values.log"
    path.write_text("\n".join([*lines, "end"]) + "\n", encoding="utf-8")
    return path


@dataclass(frozen=True)
class Sound(DataFormat):
    suffixes: ClassVar[tuple[str, ...]] = (".log",)

    def read(self, files, asked):
        (path,) = files
        text = self.text(path)
        return self.data(path, text, asked)

    def text(self, path):
        try:
            return path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise StoreError(f"{path}: cannot be read ({error})") from error

    def data(self, path, text, asked):
        if not text.endswith("\nend\n"):
            raise StoreError(f"{path}: the last line is not 'end'; the file is cut short, copy it again")
        rows = [line.split(",") for line in text.splitlines()[:-1]]
        numbers = np.array([row[1:] for row in rows], dtype=float)
        times = np.array(asked.times) if asked.times else numbers[0]
        labels = tuple(row[0] for row in rows[1:])
        values = numbers[1:]
        return SensorData(
            path.name, values, asked.unit or "cm", labels, times=times, sigma=np.full(values.shape, 0.1)
        )  # fmt: skip


def suite_of(cls):
    return format_suite(cls(), write, EXPECTED, Asked())


def caught_by(check, says="", also=()):
    def declare(cls):
        MUTANTS.append(Mutant(cls.__name__, lambda: suite_of(cls), (check, *also), says))
        return cls

    return declare


@caught_by("suffixes_are_declared", "should begin with a point")
class Pointless(Sound):
    suffixes = ("log",)


@caught_by("suffixes_are_declared", "expected a tuple of texts")
class OneText(Sound):
    suffixes = ".log"


@caught_by("suffixes_are_declared", "wrote values.log, expected a name in")
class OtherSuffix(Sound):
    suffixes = (".txt",)


@caught_by("what_was_written_is_read", r"values is .* at \(1, 0\), expected 0.1 \(2 differ\)")
class SinglePrecision(Sound):
    def data(self, path, text, asked):
        made = super().data(path, text, asked)
        return replace(made, values=made.values.astype(np.float32).astype(float))


@caught_by("what_was_written_is_read", r"sigma is None, expected")
class ForgetsSigma(Sound):
    def data(self, path, text, asked):
        return replace(super().data(path, text, asked), sigma=None)


@caught_by("what_was_written_is_read", r"times is 0.0001 at \(0,\), expected 0.1 \(3 differ\)")
class Milliseconds(Sound):
    def data(self, path, text, asked):
        made = super().data(path, text, asked)
        return replace(made, times=made.times if asked.times else 1e-3 * made.times)


@caught_by("what_was_written_is_read", r"labels is \('right', 'left'\)")
class OtherWayRound(Sound):
    def data(self, path, text, asked):
        made = super().data(path, text, asked)
        return replace(made, labels=made.labels[::-1])


@caught_by("what_was_written_is_read", r"values has shape \(2, 2\), expected \(2, 3\)")
class LeavesOut(Sound):
    def data(self, path, text, asked):
        made = super().data(path, text, asked)
        return replace(made, values=made.values[:, :2], sigma=made.sigma[:, :2], times=made.times[:2])


@caught_by("what_was_written_is_read", "gives a tuple, expected SensorData", ("the_same_again",))
class Tuple(Sound):
    def read(self, files, asked):
        made = super().read(files, asked)
        return made.values, made.times


@caught_by("the_same_again", "read again, values is")
class Random(Sound):
    calls: ClassVar[list[int]] = []

    def data(self, path, text, asked):
        made = super().data(path, text, asked)
        self.calls.append(1)
        return replace(made, values=made.values * (1 + 1e-9 * len(self.calls)))


@caught_by("the_same_again", "reading changes a file")
class Tidies(Sound):
    def text(self, path):
        text = super().text(path)
        path.write_text("\n" + text.lstrip("\n"), encoding="utf-8")
        return text


@caught_by("the_same_again", r"reading leaves files beside: \['Other values.log', 'index'\]")
class LeavesAnIndex(Sound):
    def text(self, path):
        text = super().text(path)
        (path.parent / "index").write_text("1", encoding="utf-8")
        return text


@caught_by("data_are_named_after_their_file", "data of values.log are named 'a file'")
class Nameless(Sound):
    def data(self, path, text, asked):
        return replace(super().data(path, text, asked), name="a file")


@caught_by("what_the_user_says_counts", "asked for the unit 'K' the data have 'cm'")
class KnowsTheUnit(Sound):
    def data(self, path, text, asked):
        return super().data(path, text, replace(asked, unit=None))


@caught_by("what_the_user_says_counts", "asked for the times .* the data have")
class KnowsTheTimes(Sound):
    def data(self, path, text, asked):
        return super().data(path, text, replace(asked, times=None))


@caught_by(
    "what_is_missing_is_refused", "a file that is not there raises FileNotFoundError .* expected StoreError",
    ("what_is_damaged_is_refused",),
)  # fmt: skip
class Unguarded(Sound):
    def text(self, path):
        return path.read_text(encoding="utf-8")


@caught_by("what_is_missing_is_refused", "a folder in place of a file raises IsADirectoryError")
class OnlyMissing(Sound):
    def text(self, path):
        try:
            return path.read_text(encoding="utf-8")
        except (FileNotFoundError, UnicodeDecodeError) as error:
            raise StoreError(f"{path}: cannot be read ({error})") from error


@caught_by("what_is_missing_is_refused", "a file that is not there is told without the name of the file")
class NamesNoFile(Sound):
    def text(self, path):
        try:
            return super().text(path)
        except StoreError as error:
            raise StoreError("a file cannot be read") from error


@caught_by("what_is_missing_is_refused", "is told in several lines")
class Talks(Sound):
    def text(self, path):
        try:
            return super().text(path)
        except StoreError as error:
            raise StoreError(f"{error}\nsorry") from error


@caught_by("what_is_damaged_is_refused", "an empty file is read as data")
class TakesNothing(Sound):
    def data(self, path, text, asked):
        return super().data(path, text, asked) if text else EXPECTED


@caught_by("what_is_damaged_is_refused", "a file of noise raises UnicodeDecodeError")
class NoNoise(Sound):
    def text(self, path):
        try:
            return path.read_text(encoding="utf-8")
        except OSError as error:
            raise StoreError(f"{path}: cannot be read ({error})") from error


@caught_by("what_is_cut_short_is_no_surprise", "a file that ends after . of 10 parts raises (Value|Index)Error")
class TrustsTheEnd(Sound):
    def data(self, path, text, asked):
        if not text:
            raise ShapeError(f"{path.name}: is empty")
        return super().data(path, text if text.endswith("\nend\n") else f"{text}\nend\n", asked)
