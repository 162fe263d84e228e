"""Times our clustering and walk beside what one writes in Python, on the same scenes, in the same run.

    python3 -m venv peers && peers/bin/pip install -r tests/peers/requirements.txt
    peers/bin/python tests/peers/compare.py --ours target/release/supergaussian-eval --threads 2

Prints Markdown tables and writes every number to `peers.json` in the folder given by --out. The two sides take turns, ours
first, each in a process of its own.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

HERE = pathlib.Path(__file__).parent


def call(command, threads):
    environment = os.environ | {name: str(threads) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")}
    out = subprocess.run([str(c) for c in command], env=environment, check=True, stdout=subprocess.PIPE)
    return json.loads(out.stdout.decode().strip().splitlines()[-1])


def agreement(a, b):
    """Share of points whose label maps to theirs when each of our clusters takes the other side's most frequent label."""
    shared = np.zeros((a.max() + 1, b.max() + 1), np.int64)
    np.add.at(shared, (a, b), 1)
    return shared.max(1).sum() / len(a)


def clustering(arguments, n, folder):
    ours = [arguments.ours, "peer", "clusters", "--shape", arguments.shape, "--gaussians", n, "--threads", arguments.threads]
    exact = call([*ours, "--out", folder], arguments.threads)
    exact_labels = np.load(folder / "labels.npy")
    fast = call([*ours, "--fast", "--no-arrays", "--out", folder], arguments.threads)
    fast_labels = np.load(folder / "labels.npy")
    position, features = np.load(folder / "position.npy"), np.load(folder / "features.npy")
    features = features[:, np.abs(features).max(0) > 0]
    np.savez(folder / "points.npz", position=position, features=features)
    cell = float(np.load(folder / "cell.npy")[0])
    theirs = call(
        [sys.executable, HERE / "clustering.py", folder / "points.npz", "--seeds", folder / "seeds.npy", "--cell", repr(cell),
         "--threads", arguments.threads, "--out", folder / "their.npy"],
        arguments.threads,
    )
    their_labels = np.load(folder / "their.npy")
    return {
        "gaussians": n,
        "ours": exact,
        "fast": fast,
        "theirs": theirs,
        "agreement_ours_theirs": agreement(exact_labels, their_labels),
        "agreement_fast_exact": agreement(exact_labels, fast_labels),
    }


def walks(arguments, n, folder):
    ours = call(
        [arguments.ours, "peer", "walks", "--shape", arguments.shape, "--gaussians", n, "--threads", arguments.threads, "--out", folder],
        arguments.threads,
    )
    rows = []
    for own in ours:
        theirs = call([sys.executable, HERE / "walk.py", folder, "--on", own["on"]], arguments.threads)
        rows.append({"gaussians": n, "ours": own, "theirs": theirs})
    return rows


def table(head, rows):
    print("| " + " | ".join(head) + " |\n|" + " --- |" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--ours", type=pathlib.Path, required=True, help="the executable supergaussian-eval")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--gaussians", default="100000,400000,1000000")
    parser.add_argument("--walk-gaussians", default="100000,170000")
    parser.add_argument("--shape", default="chameleon")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("."))
    arguments = parser.parse_args()
    sizes = [int(n) for n in arguments.gaussians.split(",") if n]
    walk_sizes = [int(n) for n in arguments.walk_gaussians.split(",") if n]
    clusters, solved = [], []
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        for n in sizes:
            print(f"clustering {n}", file=sys.stderr)
            clusters.append(clustering(arguments, n, folder))
        for n in walk_sizes:
            print(f"walks {n}", file=sys.stderr)
            solved.extend(walks(arguments, n, folder))
    arguments.out.mkdir(parents=True, exist_ok=True)
    (arguments.out / "peers.json").write_text(json.dumps({"clustering": clusters, "walks": solved}, indent=1) + "\n")

    print(f"{arguments.threads} threads, shape {arguments.shape}; seconds by the clock (processor seconds).\n")
    timing = lambda r: f"{r['seconds']['total']:.2f} ({r['cpu_seconds']:.1f})"
    last = lambda r: r["objective"][-1]
    table(
        ["Gaussians", "exact", "fast", "scipy + numba", "exact is faster by", "fast again by", "Σ D: peer / exact − 1",
         "Σ D: fast / exact − 1", "labels: peer, fast", "bytes a Gaussian", "their kNN query s"],
        [
            [
                f"{c['gaussians']:,}", timing(c["ours"]), timing(c["fast"]), timing(c["theirs"]),
                f"×{c['theirs']['seconds']['total'] / c['ours']['seconds']['total']:.1f}",
                f"×{c['ours']['seconds']['total'] / c['fast']['seconds']['total']:.1f}",
                f"{last(c['theirs']) / last(c['ours']) - 1:+.1e}", f"{last(c['fast']) / last(c['ours']) - 1:+.3f}",
                f"{c['agreement_ours_theirs']:.3f}, {c['agreement_fast_exact']:.3f}",
                f"{c['ours']['peak_bytes_per_gaussian']:.0f}", f"{c['theirs']['seconds']['knn_query']:.2f}",
            ]
            for c in clusters
        ],
    )
    taken = lambda r, what: f"{r[what + '_ms']:.2f} ({r[what + '_cpu_ms']:.2f})"
    rows = []
    for s in solved:
        own, theirs = s["ours"], s["theirs"]
        name = f"{own['on']} ({own['nodes']:,} nodes, {own['edges']:,} edges)"
        for o, off in zip(own["solvers"], theirs["ours_largest_differences"]):
            rows.append([name, f"ours, {o['solver']}", taken(o, "setup"), taken(o, "solve"), f"{off:.0e}", ""])
        for p in theirs["peers"]:
            rows.append([name, p["solver"], taken(p, "setup"), taken(p, "solve"), f"{p['largest_difference']:.0e}",
                         f"{p['largest_relative_difference']:.0e}"])
        if "left_out" in theirs:
            print(theirs["left_out"] + "\n")
    table(["walk on", "solver", "set-up ms (processor)", "solve ms (processor)", "largest |p − reference|", "relative"], rows)


if __name__ == "__main__":
    main()
