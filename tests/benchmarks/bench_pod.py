"""POD of many snapshots: dacore and pyMOR on the same data, in one run.

Every method runs in a process of its own and reads the same files block by block, a trajectory of 40 snapshots a
block. Memory is what the process's peak rises by once libraries and inner product are loaded. The error is measured
afterwards, in another process, by projecting every snapshot on the basis: no method's own word is taken for it.

    python -m tests.benchmarks.bench_pod --nodes 33k --field u --columns 4000 --spectrum 1e-12 --tolerance 1e-6
    python -m tests.benchmarks.bench_pod --nodes 5k --field p --trajectories 48

The first makes snapshots with known singular values, the second solves trajectories. pyMOR must be importable;
``python -m pip install pymor`` in an environment that holds dacore and its plugins.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from importlib.metadata import version
from importlib.util import find_spec
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_array, load_npz, save_npz

from dacore.algebra.hapod import hapod
from dacore.algebra.pod import pod
from dacore.algebra.threads import one_blas_thread
from dacore.workflow.machine import peak_memory

SCENE = Path(__file__).parents[2] / "examples" / "brain" / "demo.toml"
BLOCK = 40


def main() -> None:
    options = parser().parse_args()
    if options.child:
        child(options)
        return
    if find_spec("pymor") is None:
        sys.exit("bench_pod compares with pyMOR, which is not importable here: python -m pip install pymor")
    with tempfile.TemporaryDirectory() as folder:
        make(options, Path(folder))
        facts = json.loads((Path(folder) / "facts.json").read_text())
        print(f"{facts['n']:,} dofs, {facts['columns']:,} snapshots, tolerance {options.tolerance:g}")
        print(f"dacore {version('dacore')}, pyMOR {version('pymor')}, numpy {np.__version__}")
        print(f"{'method':<44}{'wall s':>9}{'CPU s':>9}{'MiB':>8}{'modes':>7}{'true error':>12}{'σ off by':>10}")
        for name in options.methods or METHODS:
            report(options, folder, name)


def report(options: argparse.Namespace, folder: str, name: str) -> None:
    """Run one method, then measure its basis, each in a fresh process."""
    command = [sys.executable, "-m", "tests.benchmarks.bench_pod", "--tolerance", str(options.tolerance)]
    try:
        found = subprocess.run(
            [*command, "--child", name, "--folder", folder], capture_output=True, text=True, timeout=options.limit
        )
    except subprocess.TimeoutExpired:
        print(f"{name:<44} not done after {options.limit:g} s", flush=True)
        return
    if found.returncode:
        print(f"{name:<44} failed: {found.stderr.strip().splitlines()[-1]}")
        return
    row = json.loads(found.stdout.splitlines()[-1])
    judged = subprocess.run(
        [*command, "--child", "judge", "--folder", folder], capture_output=True, text=True, check=True
    )
    row |= json.loads(judged.stdout.splitlines()[-1])
    print(
        f"{name:<44}{row['wall']:9.1f}{row['cpu']:9.1f}{row['mib']:8.0f}{row['modes']:7d}{row['error']:12.2e}"
        f"{row['off']:10.1e}",
        flush=True,
    )


def parser() -> argparse.ArgumentParser:
    """Command line."""
    out = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    out.add_argument("--nodes", default="33k", choices=["5k", "33k"])
    out.add_argument("--field", default="u", choices=["u", "p"])
    out.add_argument("--columns", type=int, default=4000, help="snapshots with known singular values")
    out.add_argument("--spectrum", type=float, default=1e-12, help="smallest singular value over the largest")
    out.add_argument("--trajectories", type=int, default=0, help="solve so many instead")
    out.add_argument("--tolerance", type=float, default=1e-6)
    out.add_argument("--limit", type=float, default=1800, help="seconds allowed to one method")
    out.add_argument("--methods", nargs="*", help=f"of: {', '.join(METHODS)}")
    out.add_argument("--child")
    out.add_argument("--folder", type=Path)
    return out


# The data


def make(options: argparse.Namespace, folder: Path) -> None:
    """Write the inner product, the snapshots block by block, and what is known of them."""
    from dacore.workflow.open import open_scene

    session = open_scene(SCENE, [f'domain.nodes="{options.nodes}"'], folder / "cache")
    space = session.model.space
    product = space.field_product(options.field)
    save_npz(folder / "product.npz", product)
    total = 0.0
    values: Any = None
    with (folder / "blocks.bin").open("wb") as file:
        if options.trajectories:
            rows = space.layout.block(options.field)
            blocks = (session.model.solve(one).states[rows] for one in draws(session, options.trajectories))
            columns = BLOCK * options.trajectories
        else:
            columns = options.columns // BLOCK * BLOCK
            values, blocks = known(product, columns, options.spectrum)
        for block in blocks:
            total += float(np.einsum("ij,ij->", block, product @ block))
            np.ascontiguousarray(block).tofile(file)
    facts = {"n": product.shape[0], "columns": columns, "total": total, "values": values}
    (folder / "facts.json").write_text(json.dumps(facts))


def draws(session: Any, count: int) -> list[dict[str, float]]:
    """Parameters of so many samples."""
    space = session.parameters
    samples = space.sample(np.random.default_rng(1), count, "latin_hypercube")
    return [space.as_mapping(sample) for sample in samples]


def known(product: csr_array, columns: int, smallest: float) -> tuple[list[float], Any]:
    """Singular values, and blocks Φ Σ Vᵀ of snapshots that have them; Φ of smooth and rough modes."""
    rng = np.random.default_rng(0)
    n, rank = product.shape[0], min(400, columns // 2)
    modes = rng.standard_normal((n, rank))
    for _ in range(2):
        modes = np.linalg.solve(np.linalg.cholesky(modes.T @ (product @ modes)), modes.T).T
    right = np.linalg.qr(rng.standard_normal((columns, rank)))[0]
    # Fast at first, then slower, as the singular values of trajectories fall.
    values = smallest ** np.sqrt(np.linspace(0.0, 1.0, rank))
    blocks = ((modes * values) @ right[start : start + BLOCK].T for start in range(0, columns, BLOCK))
    return values.tolist(), blocks


# The methods


def read(folder: Path, n: int) -> Any:
    """Yield the blocks (n, 40)."""
    with (folder / "blocks.bin").open("rb") as file:
        while (block := np.fromfile(file, count=n * BLOCK)).size:
            yield block.reshape(n, BLOCK)


def whole(folder: Path, facts: dict[str, Any], order: str = "C") -> Any:
    """All snapshots (n, K) at once."""
    out = np.empty((facts["n"], facts["columns"]), order=order)
    for k, block in enumerate(read(folder, facts["n"])):
        out[:, k * BLOCK : (k + 1) * BLOCK] = block
    return out


def chunks(folder: Path, facts: dict[str, Any], width: int) -> Any:
    """Yield pyMOR's vector arrays of `width` snapshots, in the order of storage it prefers."""
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    space = NumpyVectorSpace(facts["n"])
    filled, out = 0, np.empty((facts["n"], width), order="F")
    for block in read(folder, facts["n"]):
        done = 0
        while done < BLOCK:
            step = min(width - filled, BLOCK - done)
            out[:, filled : filled + step] = block[:, done : done + step]
            done, filled = done + step, filled + step
            if filled == width:
                yield space.from_numpy(out)
                filled, out = 0, np.empty((facts["n"], width), order="F")
    if filled:
        yield space.from_numpy(out[:, :filled].copy(order="F"))


def ours(width: int = 64, memory: float | None = None) -> Any:
    def run(folder: Path, product: csr_array, facts: dict[str, Any], tolerance: float) -> tuple[Any, Any]:
        blocks = read(folder, facts["n"])
        found = hapod(blocks, product, tolerance, facts["columns"], width, memory)
        return found.basis, found.singular_values

    return run


def ours_at_once(folder: Path, product: csr_array, facts: dict[str, Any], tolerance: float) -> tuple[Any, Any]:
    found = pod(whole(folder, facts), product, tolerance)
    return found.basis, found.singular_values


def incremental(width: int, omega: float = 0.9) -> Any:
    def run(folder: Path, product: csr_array, facts: dict[str, Any], tolerance: float) -> tuple[Any, Any]:
        from pymor.algorithms.hapod import inc_hapod
        from pymor.operators.numpy import NumpyMatrixOperator

        mean = tolerance * (facts["total"] / facts["columns"]) ** 0.5
        steps = ceil(facts["columns"] / width)
        modes, values, _ = inc_hapod(
            steps, chunks(folder, facts, width), mean, omega, product=NumpyMatrixOperator(product)
        )
        return modes.to_numpy(), values

    return run


def vectorarray(name: str, width: int, omega: float = 0.9) -> Any:
    def run(folder: Path, product: csr_array, facts: dict[str, Any], tolerance: float) -> tuple[Any, Any]:
        from pymor.algorithms import hapod as theirs
        from pymor.operators.numpy import NumpyMatrixOperator
        from pymor.vectorarrays.numpy import NumpyVectorSpace

        mean = tolerance * (facts["total"] / facts["columns"]) ** 0.5
        array = NumpyVectorSpace(facts["n"]).from_numpy(whole(folder, facts, "F"))
        steps = ceil(facts["columns"] / width)
        modes, values, _ = getattr(theirs, name)(steps, array, mean, omega, product=NumpyMatrixOperator(product))
        return modes.to_numpy(), values

    return run


def at_once(method: str) -> Any:
    def run(folder: Path, product: csr_array, facts: dict[str, Any], tolerance: float) -> tuple[Any, Any]:
        from pymor.algorithms.pod import pod as theirs
        from pymor.operators.numpy import NumpyMatrixOperator
        from pymor.vectorarrays.numpy import NumpyVectorSpace

        array = NumpyVectorSpace(facts["n"]).from_numpy(whole(folder, facts, "F"))
        size = tolerance * facts["total"] ** 0.5
        modes, values = theirs(
            array, product=NumpyMatrixOperator(product), rtol=0.0, atol=0.0, l2_err=size, method=method
        )
        return modes.to_numpy(), values

    return run


METHODS: dict[str, Any] = {
    "dacore hapod": ours(),
    "dacore hapod, 20 at a time": ours(20),
    "dacore pod, all at once": ours_at_once,
    "pyMOR inc_hapod, 80 at a time": incremental(80),
    "pyMOR inc_hapod, 200 at a time": incremental(200),
    "pyMOR inc_hapod, 480 at a time": incremental(480),
    "pyMOR inc_vectorarray_hapod, 480 at a time": vectorarray("inc_vectorarray_hapod", 480),
    "pyMOR dist_vectorarray_hapod, 480 at a time": vectorarray("dist_vectorarray_hapod", 480),
    "pyMOR pod, method of snapshots": at_once("method_of_snapshots"),
    "pyMOR pod, qr_svd": at_once("qr_svd"),
}


def child(options: argparse.Namespace) -> None:
    """Run one method, or judge what the last one left, and print what came out as JSON."""
    folder: Path = options.folder
    facts = json.loads((folder / "facts.json").read_text())
    product = csr_array(load_npz(folder / "product.npz"))
    if options.child == "judge":
        print(json.dumps(judge(folder, product, facts)))
        return
    if options.child.startswith("pyMOR"):
        import pymor.algorithms.hapod
        import pymor.core.logger
        import pymor.operators.numpy

        pymor.core.logger.set_log_levels({"pymor": "ERROR"})
    method = METHODS[options.child]
    with one_blas_thread():
        np.ones((64, 64)) @ np.ones((64, 64))
        before = peak_memory()
        wall, cpu = time.perf_counter(), time.process_time()
        basis, values = method(folder, product, facts, options.tolerance)
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        peak = peak_memory()
    np.save(folder / "basis.npy", basis)
    np.save(folder / "values.npy", np.asarray(values))
    print(json.dumps({"wall": wall, "cpu": cpu, "mib": peak - before, "modes": basis.shape[1]}))


def judge(folder: Path, product: csr_array, facts: dict[str, Any]) -> dict[str, float]:
    """True relative error of the last basis, and how far its singular values are off, over the largest."""
    basis, values = np.load(folder / "basis.npy"), np.load(folder / "values.npy")
    # Not orthonormal to the last digit, so the projection solves with the modes' own Gram matrix.
    weighted = product @ np.ascontiguousarray(basis)
    gram = np.linalg.cholesky(basis.T @ weighted)
    left = 0.0
    for block in read(folder, facts["n"]):
        for _ in range(2):
            block = block - basis @ np.linalg.solve(gram.T, np.linalg.solve(gram, weighted.T @ block))
        left += float(np.einsum("ij,ij->", block, product @ block))
    off = float("nan")
    if facts["values"]:
        known_values = np.array(facts["values"])[: len(values)]
        off = float(np.abs(values[: len(known_values)] - known_values).max() / known_values[0])
    return {"error": float(np.sqrt(max(left, 0.0) / facts["total"])), "off": off}


if __name__ == "__main__":
    main()
