"""The published training set on two cores: time and memory of every stage, beside solving all samples in full.

Runs examples/brain/paper.toml three times with one cache: measured on one slice, on three, in the whole brain. Then
solves a few of the samples in full, one after the other in a process of its own, and multiplies.

    make paper
    python examples/brain/paper.py --out runs/paper --workers 2 --brute 4

Needs dacore with dacore-skfem, dacore-biot and dacore-imaging, as `make demo` installs them.
"""

import argparse
import json
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil

from dacore import open_scene
from dacore.algebra.threads import one_blas_thread
from dacore.dynamics.training import draw
from dacore.workflow.results import circumstances

SCENE = Path(__file__).with_name("paper.toml")
SLICES = "observation.slice.slices=[{}]"
MEASURED = {
    "one slice": [],
    "three slices": [SLICES.format(", ".join(f'{{axis = "z", position = {z}}}' for z in (6.5, 8.5, 10.5)))],
    "whole brain": [SLICES.format("")],
}
GIB = 2.0**30


def main() -> None:
    """Run everything and write paper.json and paper.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/paper"), help="folder of the results")
    parser.add_argument("--workers", type=int, default=2, help="processes that solve")
    parser.add_argument("--brute", type=int, default=4, help="samples to solve in full for the comparison")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="change the scene")
    parser.add_argument("--solve", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.solve:
        solve_in_full(options)
        return
    runs = {name: run(name, changes, options) for name, changes in MEASURED.items()}
    brute = json.loads(own_process(options, "--solve", "--brute", str(options.brute)))
    summary = {"runs": runs, "brute_force": brute, **versions(options)}
    training = runs["one slice"]["stages"]["training"]
    summary["times_less_processor_time"] = brute["cpu_of_all"] / training["cpu"]
    (options.out / "paper.json").write_text(json.dumps(summary, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    text = page(summary)
    (options.out / "paper.md").write_text(text, encoding="utf-8")
    sys.stdout.write(text)


def run(name: str, changes: list[str], options: argparse.Namespace) -> dict[str, object]:
    """Run the scene with one kind of measurement; what its stages took."""
    out, cache = options.out / name.replace(" ", "-"), options.out / "cache"
    command = [
        str(Path(sys.executable).with_name("dacore")),
        "run",
        str(SCENE),
        "--out",
        str(out),
        "--cache",
        str(cache),
    ]
    command += ["--workers", str(options.workers)]
    changes = [*options.set, *changes]
    for change in changes:
        command += ["--set", change]
    started = time.perf_counter()
    peak = watched(command)
    wall = time.perf_counter() - started
    results = json.loads((out / "results.json").read_text(encoding="utf-8"))
    records = {}
    for path in (cache / "costs").glob("*.json"):
        record = json.loads(path.read_text(encoding="utf-8"))
        records.setdefault(record["stage"], []).append((path.stat().st_mtime, record["cpu"]))
    stages = {}
    for stage, seconds in results["timings"].items():
        made = results["stages"].get(stage) == "run"
        cpu = max(records[stage])[1] if made and stage in records else None
        stages[stage] = {"wall": seconds, "cpu": cpu, "made": made}
    return {
        "wall": wall, "peak_gib": peak / GIB, "stages": stages, "values": results["observation"]["functionals"],
        "training": results["reduced_training"], "modes": results["background"]["modes"],
        "dofs": results["n_dofs"], "mean_errors": errors(results), "online": online(cache, changes),
    }  # fmt: skip


def watched(command: list[str]) -> float:
    """Run a command; the most memory that it and its workers held together, in bytes."""
    process = psutil.Popen(command, stdout=subprocess.DEVNULL)
    most, done = [0.0], threading.Event()

    def look() -> None:
        while not done.wait(0.25):
            total = 0.0
            for each in [process, *children(process)]:
                try:
                    total += each.memory_info().rss
                except psutil.Error:
                    continue
            most[0] = max(most[0], total)

    watcher = threading.Thread(target=look, daemon=True)
    watcher.start()
    code = process.wait()
    done.set()
    watcher.join()
    if code:
        raise SystemExit(f"{' '.join(command)}: ended with code {code}")
    return most[0]


def children(process: psutil.Popen) -> list[psutil.Process]:
    """Everything a process started that still runs."""
    try:
        return process.children(recursive=True)
    except psutil.Error:
        return []


def errors(results: dict) -> dict[str, dict[str, float]]:
    """Mean space–time errors of every estimator at every noise level."""
    return {
        f"{each['estimator']} at {each['noise']:g}": {label: error["mean"] for label, error in each["errors"].items()}
        for each in results["validation"]
    }


def online(cache: Path, changes: list[str]) -> dict[str, float]:
    """Seconds from the data of a whole series to the ventricular pressure, with everything prepared."""
    scene = open_scene(SCENE, changes, cache)
    with one_blas_thread():
        readout = scene.prepared("minimum_variance").readout(scene.quantities["ventricular_pressure"], noise_scale=1e-4)
    data = np.ascontiguousarray(scene.runner["measured"].data[:, :, :1])
    readout(data)
    times = []
    for _ in range(50):
        started = time.perf_counter()
        readout(data)
        times.append(time.perf_counter() - started)
    return {"seconds": float(np.median(times)), "values": int(data.size)}


def own_process(options: argparse.Namespace, *more: str) -> str:
    """Run this script again with other options; what it says."""
    command = [sys.executable, __file__, "--out", str(options.out), *more]
    for change in options.set:
        command += ["--set", change]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def solve_in_full(options: argparse.Namespace) -> None:
    """Solve a few samples of the training set as full training would, and say what they took."""
    scene = open_scene(SCENE, options.set, options.out / "cache")
    model, parameters, training = scene.model, scene.parameters, scene.scene.training
    samples = draw(parameters, training.samples, training.sampling, training.seed)
    chosen = np.linspace(0, len(samples) - 1, options.brute).astype(int)
    took = []
    with one_blas_thread():
        for number in chosen:
            started = time.process_time()
            model.solve(parameters.as_mapping(samples[number]))
            took.append(time.process_time() - started)
    told = {"samples": chosen.tolist(), "cpu": took, "cpu_of_all": float(np.mean(took)) * len(samples)}
    sys.stdout.write(json.dumps(told))


def versions(options: argparse.Namespace) -> dict[str, object]:
    """Versions and machine."""
    return circumstances(open_scene(SCENE, options.set, options.out / "cache").builder)


def page(summary: dict) -> str:
    """Everything as Markdown."""
    runs, brute = summary["runs"], summary["brute_force"]
    first = runs["one slice"]
    training = first["training"]
    names = list(dict.fromkeys(stage for each in runs.values() for stage in each["stages"] if stage != "total"))
    lines = [
        f"{first['dofs']:,} degrees of freedom, {training['solved_in_full']} samples solved in full "
        f"({training['motions_each']} motions each), {training['dimension']} modes; "
        f"largest estimated error {percents(training['largest_estimate'])}.",
        "",
        "| stage: wall s (CPU s) | "
        + " | ".join(f"{name}, m = {each['values']:,}" for name, each in runs.items())
        + " |",
        "|---|" + "---|" * len(runs),
    ]
    for stage in names:
        cells = [stage_text(each["stages"].get(stage)) for each in runs.values()]
        if any(cell not in ("–", "0.0", "kept") for cell in cells):
            lines.append(row(stage, cells))
    lines += [
        row("**everything, wall**", [f"**{each['wall']:.0f}**" for each in runs.values()]),
        row("most memory, GiB, all processes", [f"{each['peak_gib']:.1f}" for each in runs.values()]),
        row("p_v of a series, ms", [f"{1e3 * each['online']['seconds']:.3f}" for each in runs.values()]),
        "",
        f"Solving {len(brute['cpu'])} samples in full took {np.mean(brute['cpu']):.1f} CPU s each "
        f"({min(brute['cpu']):.1f} to {max(brute['cpu']):.1f}): {brute['cpu_of_all']:,.0f} for all of them, "
        f"{summary['times_less_processor_time']:.0f} times the training stage.",
        "",
    ]  # fmt: skip
    if unseen := training.get("unseen_cases"):
        worst = {name: max(values) for name, values in unseen["error"].items()}
        lines += [
            f"Worst error of the reduced model on {len(unseen['error']['u'])} unseen cases: {percents(worst)}.",
            "",
        ]
    return "\n".join(lines)


def row(title: str, cells: list[str]) -> str:
    """One line of a table."""
    return "| " + " | ".join([title, *cells]) + " |"


def stage_text(stage: dict | None) -> str:
    """Wall and processor seconds of a stage."""
    if stage is None:
        return "–"
    if not stage["made"] and stage["wall"] < 0.5:
        return "kept"
    cpu = "" if stage["cpu"] is None else f" ({stage['cpu']:.1f})"
    return f"{stage['wall']:.1f}{cpu}"


def percents(values: dict[str, float]) -> str:
    """Named relative errors as percentages."""
    return ", ".join(f"{name} {100 * value:.2g}%" for name, value in values.items())


if __name__ == "__main__":
    main()
