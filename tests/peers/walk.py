"""The random walk as one solves it with scipy, pyamg and CHOLMOD: the peers that ours is timed against.

    walk.py DIR --on clusters|gaussians

reads `walk-ON-edges.npy` (u, v, w), `walk-ON-seeds.npy` and our `walk-ON-p.npy` (a row for each of our ways of solving),
solves L_uu p = w_uf with the leak in the diagonal, and prints one JSON object: for each solver its milliseconds (median;
assembling the matrix and, where there is one, the set-up apart), processor milliseconds, and how far its p is from ours. Ours by elimination without subtraction is exact to about 1e-15 in
every entry, so on clusters that distance is the peer's error; on Gaussians ours is an iteration, and CHOLMOD's or
scipy's direct solution is the reference for both.
"""

import argparse
import json
import time

import numpy as np
import pyamg
from scipy.sparse import coo_matrix, diags
from scipy.sparse.linalg import cg, spsolve

try:
    from sksparse.cholmod import cholesky
except ImportError as error:
    cholesky, without = None, str(error)


def system(edges, seeds, leak):
    u, v, w = edges[:, 0].astype(np.int64), edges[:, 1].astype(np.int64), edges[:, 2]
    n = len(seeds)
    weights = coo_matrix((np.r_[w, w], (np.r_[u, v], np.r_[v, u])), (n, n)).tocsr()
    degree = np.asarray(weights.sum(1)).ravel()
    unknown = np.flatnonzero((seeds == 0) & (degree > 0))
    laplacian = diags(degree * (1 + leak)) - weights
    right = np.asarray(weights[unknown][:, seeds == 1].sum(1)).ravel()
    return laplacian[unknown][:, unknown].tocsc(), right, unknown


def timed(f, repeats):
    """Median milliseconds by the clock, mean milliseconds of the processor, and what came of it."""
    times, used = [], time.process_time()
    for _ in range(repeats):
        start = time.perf_counter()
        out = f()
        times.append(1e3 * (time.perf_counter() - start))
    return float(np.median(times)), 1e3 * (time.process_time() - used) / repeats, out


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder")
    parser.add_argument("--on", choices=["clusters", "gaussians"], required=True)
    parser.add_argument("--leak", type=float, default=0.03)
    arguments = parser.parse_args()
    name = f"{arguments.folder}/walk-{arguments.on}"
    edges, seeds, ours = (np.load(f"{name}-{what}.npy") for what in ("edges", "seeds", "p"))
    small = len(seeds) <= 5000
    repeats = 51 if small else 3
    assemble_ms, _, (matrix, right, unknown) = timed(lambda: system(edges, seeds, arguments.leak), 3)
    rows, solutions = [], {}

    def row(solver, setup, solve_ms, solve_cpu_ms, p):
        solutions[solver] = p
        times = {"setup_ms": setup[0], "setup_cpu_ms": setup[1], "solve_ms": solve_ms, "solve_cpu_ms": solve_cpu_ms}
        rows.append({"solver": solver} | times)

    if small or len(unknown) < 250_000:
        row("scipy spsolve", (0.0, 0.0), *timed(lambda: spsolve(matrix, right), repeats if small else 1))
    if cholesky is not None:
        *setup, factor = timed(lambda: cholesky(matrix), repeats)
        row("CHOLMOD", setup, *timed(lambda: factor(right), repeats))
    *setup, levels = timed(lambda: pyamg.ruge_stuben_solver(matrix.tocsr()), 3)
    row("pyamg 1e-10", setup, *timed(lambda: levels.solve(right, tol=1e-10, accel="cg"), repeats))
    inverse = diags(1.0 / matrix.diagonal())
    row("scipy cg 1e-6", (0.0, 0.0), *timed(lambda: cg(matrix, right, rtol=1e-6, M=inverse)[0], repeats))
    p = ours[0, unknown]
    reference = p if small else solutions.get("CHOLMOD", solutions.get("scipy spsolve", p))
    for r in rows:
        off = np.abs(solutions[r["solver"]] - reference)
        r["largest_difference"] = float(off.max())
        positive = reference > 0
        r["largest_relative_difference"] = float((off[positive] / reference[positive]).max())
    report = {
        "on": arguments.on,
        "unknowns": len(unknown),
        "assemble_ms": assemble_ms,
        "ours_largest_differences": [float(np.abs(own[unknown] - reference).max()) for own in ours],
        "peers": rows,
    }
    if cholesky is None:
        report["left_out"] = f"CHOLMOD: {without}"
    print(json.dumps(report))


if __name__ == "__main__":
    main()
