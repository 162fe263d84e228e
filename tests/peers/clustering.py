"""The clustering as one writes it with scipy and numba: the peer that ours is timed against.

Same definitions (k-nearest-neighbour graph with symmetric union, D = (d/S)^2 + m^2 |df|^2 with d along the graph, mean
features, source = member nearest to the mean position, pieces merged into the most similar neighbour), same seeds, same
rule for the end of the rounds. Distances: an exact assignment by one Dijkstra for each seed, pruned by the envelope
(the same theorem as ours; a plain window of 2S would be slower), compiled by numba and run on all its threads. What it
does not have is what is ours: warm-started rounds, a cache-friendly order of the points, one tree entry for coincident
points.

    clustering.py points.npz --seeds seeds.npy --cell S --out labels.npy

`points.npz` holds `position` float64 (n, 3) and `features` float32 (n, w). Prints one JSON object.
"""

import argparse
import heapq  # noqa: F401  (numba compiles it)
import json
import os
import resource
import time

import numba as nb
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

SLACK = 1.0 + 1e-12
NONE = -1


def neighbour_graph(position, k, workers):
    """Symmetric union of k nearest neighbours as (indptr, indices, lengths); zero-length edges are kept."""
    tree = cKDTree(position)
    start = time.perf_counter()
    distance, index = tree.query(position, k + 1, workers=workers)
    knn_seconds = time.perf_counter() - start
    n = len(position)
    rows = np.repeat(np.arange(n, dtype=np.int64), k + 1)
    columns = index.ravel().astype(np.int64)
    keep = rows != columns
    rows, columns, lengths = rows[keep], columns[keep], distance.ravel()[keep]
    a, b = np.minimum(rows, columns), np.maximum(rows, columns)
    _, first = np.unique(a * n + b, return_index=True)
    a, b, lengths = a[first], b[first], lengths[first]
    rows = np.concatenate([a, b])
    columns = np.concatenate([b, a])
    lengths = np.concatenate([lengths, lengths])
    order = np.argsort(rows, kind="stable")
    indptr = np.zeros(n + 1, dtype=np.int64)
    np.cumsum(np.bincount(rows, minlength=n), out=indptr[1:])
    return indptr, columns[order].astype(np.int32), lengths[order], knn_seconds


@nb.njit(cache=True)
def nearest_source(indptr, indices, lengths, sources, distance, label):
    heap = [(0.0, np.int64(0), np.int64(sources[0]))]
    heap.pop()
    for j in range(len(sources)):
        v = sources[j]
        if label[v] == NONE:
            distance[v] = 0.0
            label[v] = j
            heapq.heappush(heap, (0.0, np.int64(j), np.int64(v)))
    while len(heap) > 0:
        d, j, v = heapq.heappop(heap)
        if d > distance[v] or j != label[v]:
            continue
        for e in range(indptr[v], indptr[v + 1]):
            w = indices[e]
            through = d + lengths[e]
            if through < distance[w] or (through == distance[w] and j < label[w]):
                distance[w] = through
                label[w] = j
                heapq.heappush(heap, (through, j, np.int64(w)))


@nb.njit(cache=True)
def raise_to_envelope(indptr, indices, lengths, radius):
    heap = [(0.0, np.int64(0))]
    heap.pop()
    for v in range(len(radius)):
        for e in range(indptr[v], indptr[v + 1]):
            if radius[v] - lengths[e] > radius[indices[e]]:
                heapq.heappush(heap, (-radius[v], np.int64(v)))
                break
    while len(heap) > 0:
        r, v = heapq.heappop(heap)
        r = -r
        if r < radius[v]:
            continue
        for e in range(indptr[v], indptr[v + 1]):
            w = indices[e]
            if r - lengths[e] > radius[w]:
                radius[w] = r - lengths[e]
                heapq.heappush(heap, (-radius[w], np.int64(w)))


@nb.njit(cache=True)
def search(indptr, indices, lengths, source, bound, distance, seen, turn, reached):
    """All vertices within their bounds of the source; returns how many, their ids in `reached`."""
    heap = [(0.0, np.int64(source))]
    distance[source] = 0.0
    seen[source] = turn
    count = 0
    while len(heap) > 0:
        d, v = heapq.heappop(heap)
        if d > distance[v]:
            continue
        if count < len(reached):
            reached[count] = v
        count += 1
        for e in range(indptr[v], indptr[v + 1]):
            w = indices[e]
            through = d + lengths[e]
            if through <= bound[w] * SLACK and (seen[w] != turn or through < distance[w]):
                seen[w] = turn
                distance[w] = through
                heapq.heappush(heap, (through, np.int64(w)))
    return count


@nb.njit(parallel=True, cache=True)
def assign(indptr, indices, lengths, features, sources, centres, cell, weight, label, cost, bound):
    n = len(label)
    threads = nb.get_num_threads()
    all_label = np.full((threads, n), NONE, np.int32)
    all_cost = np.full((threads, n), np.inf)
    for t in nb.prange(threads):
        distance = np.empty(n)
        seen = np.zeros(n, np.int32)
        reached = np.empty(n, np.int32)
        turn = 0
        for j in range(t, len(sources), threads):
            turn += 1
            count = search(indptr, indices, lengths, sources[j], bound, distance, seen, turn, reached)
            for i in range(count):
                v = reached[i]
                f = 0.0
                for c in range(features.shape[1]):
                    x = features[v, c] - centres[j, c]
                    f += x * x
                d = distance[v] / cell
                total = d * d + weight * f
                if total < all_cost[t, v] or (total == all_cost[t, v] and j < all_label[t, v]):
                    all_cost[t, v] = total
                    all_label[t, v] = j
    for v in nb.prange(n):
        label[v] = NONE
        cost[v] = np.inf
        for t in range(threads):
            if all_label[t, v] == NONE:
                continue
            if all_cost[t, v] < cost[v] or (all_cost[t, v] == cost[v] and all_label[t, v] < label[v]):
                cost[v] = all_cost[t, v]
                label[v] = all_label[t, v]


def update(position, features, label, sources, centres):
    k = len(sources)
    have = label >= 0
    own = label[have]
    size = np.bincount(own, minlength=k)
    some = size > 0
    divisor = np.maximum(size, 1)
    mean = np.stack([np.bincount(own, position[have, a], k) for a in range(3)], 1) / divisor[:, None]
    feature = np.stack([np.bincount(own, features[have, c], k) for c in range(features.shape[1])], 1)
    feature /= divisor[:, None]
    away = np.full(len(label), np.inf)
    away[have] = ((position[have] - mean[own]) ** 2).sum(1)
    by = np.where(have, label, k)
    order = np.lexsort((np.arange(len(label)), away, by))
    first = np.searchsorted(by[order], np.arange(k))
    sources, centres = sources.copy(), centres.copy()
    sources[some] = order[first[some]]
    centres[some] = feature[some]
    return sources, centres.astype(np.float32)


def merge(indptr, indices, features, label, least, most):
    """Pieces, smallest first, into the neighbour of the most similar mean feature."""
    n = len(label)
    rows = np.repeat(np.arange(n), np.diff(indptr))
    same = label[rows] == label[indices]
    inside = coo_matrix((np.ones(same.sum(), bool), (rows[same], indices[same])), (n, n))
    pieces, of = connected_components(inside.tocsr(), directed=False)
    size = np.bincount(of, minlength=pieces).astype(np.int64)
    sums = np.stack([np.bincount(of, features[:, c], pieces) for c in range(features.shape[1])], 1)
    a, b = of[rows[~same]], of[indices[~same]]
    cross = np.unique(a.astype(np.int64) * pieces + b)
    around = [set() for _ in range(pieces)]
    for pair in cross:
        around[pair // pieces].add(int(pair % pieces))
    into = np.arange(pieces)
    heap = [(int(s), i) for i, s in enumerate(size)]
    heapq.heapify(heap)
    count = pieces
    while heap:
        s, i = heapq.heappop(heap)
        if into[i] != i or size[i] != s:
            continue
        if s >= least and count <= most:
            break
        if not around[i]:
            continue
        candidates = sorted(around[i])
        mean = sums[i] / size[i]
        others = sums[candidates] / size[candidates][:, None]
        j = candidates[int(np.argmin(((others - mean) ** 2).sum(1)))]
        for other in around[i]:
            around[other].discard(i)
            if other != j:
                around[other].add(j)
                around[j].add(other)
        around[i] = set()
        around[j].discard(j)
        size[j] += size[i]
        sums[j] += sums[i]
        into[i] = j
        count -= 1
        heapq.heappush(heap, (int(size[j]), j))
    for i in range(pieces):
        root = i
        while into[root] != root:
            root = into[root]
        into[i] = root
    _, out = np.unique(into[of], return_inverse=True)
    return out.astype(np.int32)


def cluster(position, features, seeds, cell, m=0.5, k=10, most=999, rounds=10, workers=1):
    """Labels and a report."""
    seconds = {}
    start = time.perf_counter()
    indptr, indices, lengths, seconds["knn_query"] = neighbour_graph(position, k, workers)
    seconds["graph"] = time.perf_counter() - start
    n = len(position)
    sources = seeds.astype(np.int64)
    centres = features[sources].copy()
    label = np.full(n, NONE, np.int32)
    cost = np.full(n, np.inf)
    objective = []
    start = time.perf_counter()
    for turn in range(rounds):
        distance = np.full(n, np.inf)
        label[:] = NONE
        nearest_source(indptr, indices, lengths, sources, distance, label)
        reached = label >= 0
        bound = np.zeros(n)
        difference = features[reached] - centres[label[reached]]
        upper = (distance[reached] / cell) ** 2 + m * m * (difference.astype(np.float64) ** 2).sum(1)
        bound[reached] = cell * np.sqrt(upper)
        raise_to_envelope(indptr, indices, lengths, bound)
        assign(indptr, indices, lengths, features, sources, centres, cell, m * m, label, cost, bound)
        objective.append(float(cost[np.isfinite(cost)].sum()))
        if turn + 1 == rounds or (turn > 0 and objective[-2] - objective[-1] < 1e-3 * objective[-2]):
            break
        sources, centres = update(position, features, label, sources, centres)
    seconds["assignment"] = time.perf_counter() - start
    start = time.perf_counter()
    # Components without a seed take the label of the nearest labelled point.
    lost = label < 0
    if lost.any():
        label[lost] = label[~lost][cKDTree(position[~lost]).query(position[lost])[1]]
    label = merge(indptr, indices, features.astype(np.float64), label, max(1, int(0.25 * n / len(seeds))), most)
    seconds["merge"] = time.perf_counter() - start
    return label, {"clusters": int(label.max()) + 1, "objective": objective, "seconds": seconds}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("points")
    parser.add_argument("--seeds", required=True)
    parser.add_argument("--cell", type=float, required=True)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--out", required=True)
    arguments = parser.parse_args()
    nb.set_num_threads(arguments.threads)
    data = np.load(arguments.points)
    position, features = data["position"], data["features"]
    seeds = np.load(arguments.seeds)
    # Compile on a small part, which is not timed.
    few = np.arange(0, len(position), max(1, len(position) // 2000))
    cluster(position[few], features[few], np.arange(0, len(few), 40), arguments.cell, workers=arguments.threads)
    before = resource.getrusage(resource.RUSAGE_SELF)
    start = time.perf_counter()
    label, report = cluster(
        position, features, seeds, arguments.cell, rounds=arguments.rounds, workers=arguments.threads
    )
    after = resource.getrusage(resource.RUSAGE_SELF)
    report["seconds"]["total"] = time.perf_counter() - start
    report["cpu_seconds"] = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    report["peak_bytes"] = after.ru_maxrss * 1024
    temporary = arguments.out + ".part.npy"
    np.save(temporary, label)
    os.replace(temporary, arguments.out)
    print(json.dumps(report))


if __name__ == "__main__":
    main()
