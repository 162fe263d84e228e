#!/usr/bin/env python3
"""Exact answers for random walks that break ordinary solvers, in rational arithmetic.

Writes walk_truth.json beside this file: graphs as `supergaussian selection solve` reads them, and p and q of each node as
the double nearest to the exact rational. Conductances are taken as the doubles they are, so no digit is lost anywhere.

    python3 services/selection/tests/walk_truth.py
"""

import json
import math
import pathlib
import random
from fractions import Fraction


def exact(nodes, edges, foreground, background, leak):
    """p and q by eliminating the unknowns' Laplacian over the rationals; 0 where no terminal is reached."""
    weight = [dict() for _ in range(nodes)]
    for u, v, w in edges:
        if u != v and w > 0:
            weight[u][v] = weight[u].get(v, Fraction(0)) + Fraction(w)
            weight[v][u] = weight[v].get(u, Fraction(0)) + Fraction(w)
    both = set(foreground) & set(background)
    green, red = set(foreground) - both, set(background) - both
    # Terminals are two nodes of their own; a leak is a share of the degree to the background.
    f, b = nodes, nodes + 1
    rows = {u: {} for u in range(nodes) if u not in green and u not in red}
    for u, row in rows.items():
        for v, w in weight[u].items():
            end = f if v in green else b if v in red else v
            row[end] = row.get(end, Fraction(0)) + w
        if leak and weight[u]:
            row[b] = row.get(b, Fraction(0)) + Fraction(leak) * sum(weight[u].values())
    order = []
    left = {u: dict(row) for u, row in rows.items()}
    while left:
        k = min(left, key=lambda u: (len(left[u]), u))
        row = left.pop(k)
        total = sum(row.values(), Fraction(0))
        order.append((k, row, total))
        for i in row:
            if i >= nodes:
                continue
            share = left[i].pop(k) / total
            for j, w in row.items():
                if j != i:
                    left[i][j] = left[i].get(j, Fraction(0)) + share * w
    p, q = {f: Fraction(1), b: Fraction(0)}, {f: Fraction(0), b: Fraction(1)}
    for u in green:
        p[u], q[u] = Fraction(1), Fraction(0)
    for u in red:
        p[u], q[u] = Fraction(0), Fraction(1)
    for k, row, total in reversed(order):
        p[k] = sum((w * p[j] for j, w in row.items()), Fraction(0)) / total if total else Fraction(0)
        q[k] = sum((w * q[j] for j, w in row.items()), Fraction(0)) / total if total else Fraction(0)
    return [p[u] for u in range(nodes)], [q[u] for u in range(nodes)]


def mesh(rng, first, n, chords=2):
    edges = [(first + i, first + (i + 1) % n, rng.uniform(0.2, 2.0)) for i in range(n)]
    for i in range(n):
        for _ in range(chords):
            edges.append((first + i, first + (i + rng.randrange(2, 7)) % n, rng.uniform(0.2, 2.0)))
    return edges


def chain(weights):
    return [(i, i + 1, w) for i, w in enumerate(weights)]


def regions(rng, n, sharp):
    points = [[rng.random() + (1.4 * (i % 3) if a == 0 else 0.0) for a in range(3)] for i in range(n)]
    edges = []
    for i in range(n):
        for j in range(i):
            d = math.dist(points[i], points[j])
            if d < 0.75:
                edges.append((i, j, math.exp(-((sharp * d / 0.25) ** 2))))
    return edges


def cases():
    rng = random.Random(20)
    yield "ordinary, both brushes", 60, mesh(rng, 0, 60), [3, 4], [40], 0.0
    yield "ordinary, leak .03", 60, mesh(rng, 0, 60), [3, 4], [], 0.03
    for leak in (1e-8, 1e-12, 1e-20, 1e-50, 1e-100):
        yield f"leak {leak:.0e}", 40, mesh(rng, 0, 40), [0], [], leak
    for small in (1e-8, 1e-12, 1e-20, 1e-80):
        edges = mesh(rng, 0, 40) + [(7, 40, small), (30, 41, 2 * small)]
        yield f"island, conductance {small:.0e}", 42, edges, [40], [41], 0.0
    yield "chain w = 10^-i", 58, chain([10.0**-i for i in range(57)]), [0], [57], 0.0
    yield "chain w = 10^+i", 58, chain([10.0**i for i in range(57)]), [0], [57], 0.0
    yield "chain over 10^610", 37, chain([10.0 ** (17 * (i - 18)) for i in range(36)]), [0], [36], 0.0
    yield "tie on a symmetric chain", 101, chain([1.0] * 100), [0], [100], 0.0
    yield "three regions with gaps", 60, regions(rng, 60, 1.0), [0, 3], [2, 5], 0.0
    yield "three regions, sigma / 4", 60, regions(rng, 60, 4.0), [0, 3], [2, 5], 0.0
    yield "three regions, sigma / 4, leak .03", 60, regions(rng, 60, 4.0), [0, 3], [], 0.03
    yield "20 against 30 sigma", 3, [(0, 1, math.exp(-400.0)), (1, 2, math.exp(-700.0))], [0], [2], 0.0
    denormal = [(0, 1, 5e-324), (1, 2, 1e-310), (2, 3, 5e-324)]
    yield "denormal conductances", 4, denormal, [0], [3], 0.0
    largest = [(0, 1, 1.7e308), (1, 2, 1.7e308), (2, 3, 1e-300)]
    yield "the largest doubles", 4, largest, [0], [3], 0.0
    yield "all seeded", 4, chain([1.0, 2.0, 3.0]), [0, 2], [1, 3], 0.03
    yield "none seeded", 4, chain([1.0, 2.0, 3.0]), [], [], 0.0
    yield "foreground only, no leak", 6, chain([1.0, 2.0, 3.0]) + [(4, 5, 1.0)], [0], [], 0.0
    yield "background only, no leak", 6, chain([1.0, 2.0, 3.0]) + [(4, 5, 1.0)], [], [0], 0.0
    yield "one node named by both brushes", 5, chain([1.0, 2.0, 3.0, 4.0]), [0, 2], [4, 2], 0.0
    yield "one node", 1, [], [0], [], 0.03
    yield "one node, unseeded", 1, [], [], [], 0.03
    yield "a part without a seed", 50, mesh(rng, 0, 30) + mesh(rng, 30, 20), [1], [20], 0.0
    star = [(0, i, 10.0 ** (-i)) for i in range(1, 30)] + [(i, 30 + i, 10.0 ** (-2 * i)) for i in range(1, 30)]
    yield "a star of decaying arms", 60, star, [30 + i for i in range(1, 15)], [30 + i for i in range(15, 30)], 0.0


def main():
    out = []
    for name, nodes, edges, foreground, background, leak in cases():
        p, q = exact(nodes, edges, foreground, background, leak)
        assert all(a + b in (0, 1) for a, b in zip(p, q)), name
        out.append(
            {
                "name": name,
                "nodes": nodes,
                "edges": [[u, v, w] for u, v, w in edges],
                "foreground": foreground,
                "background": background,
                "leak": float(leak),
                "p": [float(x) for x in p],
                "q": [float(x) for x in q],
            }
        )
        print(f"{name}: {nodes} nodes")
    path = pathlib.Path(__file__).with_suffix(".json")
    rows = ",\n".join(json.dumps(case, separators=(",", ":")) for case in out)
    path.write_text("[\n" + rows + "\n]\n")


main()
